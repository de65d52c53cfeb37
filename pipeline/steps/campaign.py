"""Step `campaign`: one strategy tests one model version on one scenario, batch by batch, in closed loop."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from hydra.utils import instantiate

from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.scenario_space import read_space
from pipeline.config.schema import Config
from pipeline.errors import InputError
from pipeline.execution.campaign import _history, _search, _write, sampler_seed
from pipeline.execution.journal import Journal
from pipeline.execution.workers import Workers
from pipeline.progress import Progress


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
