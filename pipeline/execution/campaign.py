"""One campaign: ask a strategy, execute in closed loop, tell it, write the tables."""

from __future__ import annotations

import hashlib
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pipeline.artefacts import tables
from pipeline.artefacts.points import encode_tests
from pipeline.config.schema import Config
from pipeline.core import kpi
from pipeline.core.space import Floats, Space
from pipeline.execution.journal import Journal, Outcome
from pipeline.execution.workers import Workers
from pipeline.progress import Progress
from pipeline.protocols import Sampler

NUMBERS = ("adj_ttc_s", "ttc_s", "impact_speed_mps", "smallest_gap_m", "post_encroachment_s", "first_detection_s", "first_detection_m")


NO_KPI: dict[str, Any] = {
    **dict.fromkeys(kpi.Kpi.__annotations__, 0),
    **dict.fromkeys(NUMBERS, np.nan),
    "failure": False,
    "failure_mode": "none",
    "contact": False,
}


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
