"""Step `shard`: a part of a campaign, so that several machines share the campaign.

The strategy of such a campaign does not learn.
"""

from __future__ import annotations

from pipeline.artefacts.folders import SHARDS
from pipeline.artefacts.tables import TABLES
from pipeline.contract import Job, Step
from pipeline.core.shards import Shard
from pipeline.errors import InputError
from pipeline.steps import campaign

STEP = Step(
    "Execute a part of a campaign; a killed part resumes.",
    reads=campaign.reads,
    writes=lambda folders: {
        name: f"{folders.root}/{SHARDS}/{campaign.FOLDER}/{{shard}}/{name}.parquet"
        for name in TABLES
    },
    sections=campaign.sections,
    wildcards={**campaign.KINDS, "shard": Shard.PATTERN},
    parallel=True,
)


def run(job: Job) -> None:
    """Execute the shard's tests and write their tables."""
    from pipeline.execution.campaign import run_campaign

    if job.config.learns(strategy := job.wildcards["strategy"]):
        raise InputError(
            f"strategy: {strategy} learns from all tests, so its campaign has no shards"
        )
    try:
        shard = Shard.named(job.wildcards["shard"])
    except ValueError as error:
        raise InputError(f"shard: {error}") from error
    plan = campaign.planned(job, shard=shard)
    run_campaign(plan, job.output("tests"), job.scratch, job.threads, job.progress)
