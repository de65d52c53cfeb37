"""What is known of a campaign's tests beside their frames.

These are how each ended, its failure region and its conditions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.artefacts.dataset import Split
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import TESTS, campaign_of, read_tests
from pipeline.core.space import Value

VALIDATION = 0.1
"""Share of the tests whose frames are for validation, as in the base set."""
Tags = Mapping[str, Value]
NOTHING: Tags = {"outcome": "", "cause": "", "region": ""}


def tags_of_tests(frames: Path) -> dict[str, Tags]:
    """The tags of each test of a frames.parquet.

    These are outcome (`failure`, `pass` or `error`), cause, region, and the scenario's variables.

    They come from tests.parquet beside it and from the study's regions; without these files there
    are none. An empty region: none.
    """
    path = frames.with_name("tests.parquet")
    if not path.is_file():
        return {}
    tests = read_tests(path)
    # The region of each failure in one, from the study's folder that holds the campaign.
    campaign = campaign_of(tests, frames)
    regions: dict[str, str] = {}
    for folder in frames.absolute().parents:
        file = folder / "regions" / campaign.version / f"{campaign.scenario}.json"
        if file.is_file():
            for region in read(file, FailureRegions).regions:
                regions |= dict.fromkeys(region.members, region.name)
            break
    variables = tests.columns.difference([column.name for column in TESTS], sort=False)
    tags: dict[str, Tags] = {}
    for _, row in tests.iterrows():
        outcome = "failure" if row["failure"] else "pass"
        outcome = outcome if row["status"] == "ok" else "error"
        tags[str(row["test_id"])] = {
            "outcome": outcome,
            "cause": row["cause"] if outcome == "failure" else "",
            "region": regions.get(row["test_id"], ""),
            **{str(name): row[name] for name in variables},
        }
    return tags


def splits_of(tests: Sequence[str]) -> dict[str, Split]:
    """A tenth of the tests for validation, at least one of several; a test's frames stay together.

    Equal names give equal splits.
    """
    order = sorted(tests, key=lambda test: hashlib.sha256(test.encode()).hexdigest())
    count = max(1, round(VALIDATION * len(order))) if len(order) > 1 else 0
    return {test: "val" if place < count else "train" for place, test in enumerate(order)}
