"""Step `campaign`: one strategy tests one model version on one scenario, batch by batch, in closed loop."""

from __future__ import annotations

import hashlib
import json

from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.scenario_space import read_space
from pipeline.config.schema import Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.errors import InputError

TABLES = ("tests", "signals", "frames", "timings")
HELD_OUT = "held_out"


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    return {
        "space": folders.space(wildcards["scenario"]),
        "model": folders.model(wildcards["version"], "model.onnx"),
        "earlier": folders.earlier(**wildcards),
    }


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """The size of the search is none of the comparison's, but all executions are judged alike."""
    held_out = wildcards["kind"] == HELD_OUT
    budget = ("comparison.tests",) if held_out else ("campaign.tests", "campaign.keep_every")
    return ("scenarios.{scenario}", "samplers.{strategy}", "simulator", "detector", "campaign.failure_threshold_s", *budget)


STEP = Step(
    "Execute a test campaign in closed loop; a campaign that was killed resumes.",
    reads=_reads,
    writes=lambda folders: {
        name: f"{folders.root}/{{kind}}/{{scenario}}/{{strategy}}/{{version}}/{{seed}}/{name}.parquet" for name in TABLES
    },
    sections=_sections,
    wildcards={"kind": "campaigns|held_out|retrained/campaigns"},
    parallel=True,
)


def run(job: Job) -> None:
    """Execute the campaign and write its tables.

    The tables but the timings depend on the config, the model and `earlier` alone: not on the threads, nor on how often the run was killed.
    """
    from hydra.utils import instantiate

    from pipeline.execution.campaign import _history, _search, _write, sampler_seed
    from pipeline.execution.journal import Journal
    from pipeline.execution.workers import Workers

    config, model = job.config, job.input("model")
    scenario, strategy, version, seed = (job.wildcards[name] for name in ("scenario", "strategy", "version", "seed"))
    if not model.exists():
        raise InputError(f"{model}: expected the detector of version '{version}', found none; train it first")
    info, logical = read_space(job.input("space"))
    held_out = job.wildcards["kind"] == HELD_OUT
    tests = config.comparison.tests if held_out else config.campaign.tests
    detector = {**config.detector, "model": str(model)}
    body = config.scenarios[scenario].model_dump()
    keep_every = 0 if held_out else config.campaign.keep_every
    earlier = job.inputs("earlier")
    own_seed = sampler_seed(scenario, int(seed), "base" if held_out else version)
    settings = [config.simulator, body, config.detector, config.samplers[strategy], own_seed, tests, keep_every]
    depends = json.dumps([settings, sha256(model), [sha256(path) for path in earlier], program_sha256()], sort_keys=True)
    log = Journal(job.scratch, hashlib.sha256(depends.encode()).hexdigest())
    if log.discarded:
        job.progress.note("the journal belonged to another configuration, model or code and was discarded")
    # Partial, because Hydra would turn the space, a dataclass, into a config.
    history = {"earlier": [_history(path, logical) for path in earlier]} if earlier else {}
    sampler = instantiate(config.samplers[strategy], _partial_=True, _convert_="all")(space=logical, seed=own_seed, **history)
    workers = Workers(job.threads, config.simulator, body, detector, keep_every)
    try:
        results, points, sampler_s = _search(sampler, logical, tests, log, workers, config.campaign.failure_threshold_s, job.progress)
    finally:
        workers.close()
    keys = {"scenario": info.name, "strategy": strategy, "version": version, "seed": int(seed)}
    _write(job.output("tests"), keys, logical, points, results, sampler_s, config)
    log.remove()
