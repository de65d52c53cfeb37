"""Step `campaign`: one strategy tests one model version on one scenario, batch by batch, in closed loop."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hydra.utils import instantiate
from threadpoolctl import threadpool_limits

from pipeline.artefacts import campaign as tables
from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.space import read_space
from pipeline.config import Config
from pipeline.core import kpi
from pipeline.core.space import Floats, Space
from pipeline.progress import Progress
from pipeline.protocols import InputError, Sampler
from pipeline.steps.execution import Workers
from pipeline.steps.journal import Journal, Outcome

NUMBERS = ("adj_ttc_s", "ttc_s", "impact_speed_mps", "smallest_gap_m", "post_encroachment_s", "first_detection_s", "first_detection_m")
NO_KPI: dict[str, Any] = {
    **dict.fromkeys(kpi.Kpi.__annotations__, 0),
    **dict.fromkeys(NUMBERS, np.nan),
    "failure": False,
    "failure_mode": "none",
    "contact": False,
}


def run(
    config: Config,
    *,
    scenario: str,
    strategy: str,
    version: str,
    seed: int,
    space: Path,
    model: Path,
    earlier: Sequence[Path],
    out: Path,
    journal: Path,
    threads: int,
    progress: Progress,
) -> None:
    """Execute the campaign and write tests, signals, frames and timings.parquet beside `out`, which is tests.parquet.

    earlier: tests.parquet of other scenarios' campaigns that the strategy is told of. journal: folder of the finished tests while the
    campaign is under way.

    The files but the timings depend on the config, the model and `earlier` alone: not on `threads`, nor on how often the run was killed.
    """
    if not model.exists():
        raise InputError(f"{model}: expected the detector of version '{version}', found none; train it first")
    info, logical = read_space(space)
    held_out = scenario in config.held_out
    tests = config.comparison.tests if held_out else config.campaign.tests
    detector = {**config.detector, "model": str(model)}
    body = config.scenarios[scenario].model_dump()
    keep_every = 0 if held_out else config.campaign.keep_every
    known = [sha256(path) for path in earlier]
    own_seed = sampler_seed(scenario, seed, "base" if held_out else version)
    settings = [config.simulator, body, config.detector, config.samplers[strategy], own_seed, tests, keep_every]
    depends = json.dumps([settings, sha256(model), known, program_sha256()], sort_keys=True)
    log = Journal(journal, hashlib.sha256(depends.encode()).hexdigest())
    if log.discarded:
        progress.note("the journal belonged to another configuration, model or code and was discarded")
    # Partial, because Hydra would turn the space, a dataclass, into a config.
    history = {"earlier": [_history(path, logical) for path in earlier]} if earlier else {}
    sampler = instantiate(config.samplers[strategy], _partial_=True, _convert_="all")(space=logical, seed=own_seed, **history)
    workers = Workers(threads, config.simulator, body, detector, keep_every)
    try:
        results, points, sampler_s = _search(sampler, logical, tests, log, workers, config.campaign.failure_threshold_s, progress)
    finally:
        workers.close()
    keys = {"scenario": info.name, "strategy": strategy, "version": version, "seed": seed}
    _write(out, keys, logical, points, results, sampler_s, config)
    log.remove()


def sampler_seed(scenario: str, seed: int, version: str = "base") -> int:
    """The seed of a campaign's sampler. Scenarios share a space: the same seed would ask each of them for the same tests, and eight
    campaigns of 120 would be 120 different ones. So would a search of a retrained version, which has learnt from them.
    """
    name = scenario if version == "base" else f"{scenario} {version}"
    return int.from_bytes(hashlib.sha256(f"{name} {seed}".encode()).digest()[:4], "big") >> 1


def _history(path: Path, space: Space) -> tuple[Floats, Floats]:
    """The points and KPIs of a campaign's tests, as its sampler was told them."""
    tests = tables.read_tests(path)
    return encode_tests(tests, space), tests["adj_ttc_s"].to_numpy(float)


def _search(
    sampler: Sampler, space: Space, tests: int, log: Journal, workers: Workers, threshold: float, progress: Progress
) -> tuple[list[Outcome], Floats, list[float]]:
    """Ask, execute what the journal does not hold, tell, until the budget is spent."""
    results: list[Outcome] = []
    asked: list[Floats] = []
    seconds: list[float] = []
    failures = 0
    while len(results) < tests:
        started = time.perf_counter()
        with threadpool_limits(1):  # Sums of several threads depend on their number.
            points = sampler.ask()[: tests - len(results)]
        seconds += [(time.perf_counter() - started) / len(points)] * len(points)
        first = len(results)
        jobs = [(first + i, log.path(first + i), space.decode(point)) for i, point in enumerate(points) if first + i not in log]
        done = first + len(points) - len(jobs)
        progress(done, tests, f"{failures} failures")
        for _ in workers.execute(jobs):
            done += 1
            progress(done, tests, f"{failures} failures")
        batch = [log.read(first + i) for i in range(len(points))]
        values = np.array([np.nan if o.broken else kpi.evaluate(o.signals, threshold).adj_ttc_s for o in batch])
        failures += int(np.sum(values <= threshold))
        sampler.tell(points, values)
        results += batch
        asked.append(points)
    progress(tests, tests, f"{failures} failures")
    return results, np.concatenate(asked), seconds


def _write(
    out: Path, keys: dict[str, Any], space: Space, points: Floats, results: list[Outcome], sampler_s: list[float], config: Config
) -> None:
    batch = int(config.samplers[keys["strategy"]].get("batch_size", 20))
    ids = [f"{keys['scenario']}-{keys['strategy']}-{keys['version']}-{keys['seed']}-{i:05d}" for i in range(len(results))]
    rows = []
    for i, result in enumerate(results):
        values = NO_KPI if result.broken else asdict(kpi.evaluate(result.signals, config.campaign.failure_threshold_s))
        status = {"status": "error" if result.broken else "ok", "reason": result.reason}
        rows.append({"test_id": ids[i], **keys, "index": i, "batch": i // batch, **status, **values, **space.decode(points[i])})
    columns = [name for name, _, _ in tables.TESTS] + list(space.names)
    signals = [_signal_rows(name, result) for name, result in zip(ids, results, strict=True) if not result.broken]
    frames = [
        _frame_row(name, plain, image)
        for name, r in zip(ids, results, strict=True)
        for plain, image in zip(r.frames, r.images, strict=True)
    ]
    timings = {"test_id": ids, "sampler_s": sampler_s, "simulate_s": [result.simulate_s for result in results]}
    tables.write_signals(out.with_name("signals.parquet"), pd.concat(signals) if signals else pd.DataFrame(columns=tables.SIGNAL_COLUMNS))
    tables.write_frames(out.with_name("frames.parquet"), pd.DataFrame(frames, columns=[name for name, _, _ in tables.FRAMES]))
    tables.write_timings(out.with_name("timings.parquet"), pd.DataFrame(timings))
    tables.write_tests(out, pd.DataFrame(rows)[columns], space)


def _signal_rows(test_id: str, result: Outcome) -> pd.DataFrame:
    table = pd.DataFrame({name: result.signals[name] for name in tables.SIGNAL_COLUMNS[2:]})
    table.insert(0, "test_id", test_id)
    table.insert(1, "step", range(len(table)))
    return table


def _frame_row(test_id: str, plain: dict[str, Any], image: bytes) -> dict[str, Any]:
    truth = plain["truth"]
    row: dict[str, Any] = {"test_id": test_id, "step": plain["step"], "image": image}
    for kind in ("visible", "whole"):
        box = truth[f"{kind}_box"] or (np.nan,) * 4
        row |= {f"{kind}_{side}": value for side, value in zip(("left", "top", "right", "bottom"), box, strict=True)}
    row |= {name: truth[name] for name in ("visible_pixels", "whole_pixels", "contrast")}
    return {**row, "false_positives": plain["false_positives"], "confidence": plain["confidence"]}
