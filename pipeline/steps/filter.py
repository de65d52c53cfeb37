"""Step `filter`: judges which campaign frames are fit for training, with the reason for each.

Adaptive strategies search for tests in which the pedestrian is hard to see, so many labels are
right although no person could find the pedestrian. The thesis (section 7.2) removed such images by
eye; here measured visibility decides, and a person can overrule it.
"""

from __future__ import annotations

import pandas as pd

from pipeline.artefacts.filter_table import read_overrules, write_filter
from pipeline.artefacts.tables import read_frames
from pipeline.config.schema import Config
from pipeline.contract import Job, Step, Wildcards


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """Only a person's table needs the list of campaigns, because it may name frames of any."""
    if not config.filter.overrules:
        return ("filter",)
    campaigns = ("goal", "search", "seeds", "strategies", "arms", "campaign.tests")
    return ("filter", *campaigns, "retraining.rounds", "retraining.seeds")


STEP = Step(
    "Decide which campaign frames are used for training.",
    reads=lambda folders, wildcards: {
        "frames": folders.search(
            "frames.parquet", strategy=wildcards["strategy"], version=wildcards["version"]
        ),
        "overrules": folders.overrules,
    },
    writes=lambda folders: {"table": f"{folders.root}/{{kind}}/{{strategy}}/{{version}}.csv"},
    sections=_sections,
    wildcards={"kind": "filter|retrained/filter"},
)


def run(job: Job) -> None:
    """Judge every kept frame of a strategy's campaigns against a version and write the table.

    Raises:
        InputError: a row of a person's table (`filter.overrules`) names a frame that does not
            exist.
    """
    from pipeline.learning.frame_filter import judge, judged_elsewhere, overrule

    config, tables, frames = job.config, [], job.inputs("frames")
    for done, path in enumerate(frames, 1):
        tables.append(judge(read_frames(path), config.filter))
        job.progress(done, len(frames), "/".join(path.parts[-5:-1]))
    table = pd.concat(tables, ignore_index=True)
    for path in job.inputs("overrules"):
        elsewhere = judged_elsewhere(config, job.wildcards["strategy"], job.wildcards["version"])
        table = overrule(table, read_overrules(path), elsewhere, path)
    write_filter(job.output("table"), table)
