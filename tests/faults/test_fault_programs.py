"""How the fault programs judge a run.

Tests what counts as repaired, and which job of SLURM a line of Snakemake names.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.faults.cluster import SUBMITTED
from benchmarks.faults.repairs import judged
from benchmarks.faults.report import Row, keep
from benchmarks.faults.study import Run


def test_faults_without_an_outcome_are_not_left_out(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^bit flip, \*\.png: 20 faults without an outcome"):
        keep([Row("bit flip", "*.png", 20, 20, {"seen by readers": 0})], tmp_path / "faults.csv")
    assert not (tmp_path / "faults.csv").exists()


FILES = [Path("data/smoke/space/F1.json"), Path("data/smoke/measures.json")]
NAMED = [f"{file}: damaged or edited; the next run makes it again" for file in FILES]


@pytest.mark.parametrize(
    ("code", "said", "differences", "way"),
    [
        (0, NAMED, [], "made again"),
        (0, NAMED[:1], [], "unseen"),
        (0, NAMED, ["measures.json"], "unseen"),
        (2, NAMED, ["measures.json"], "named"),
        (2, NAMED[1:], ["space/F1.json"], "unseen"),
        (1, NAMED, ["measures.json"], "unseen"),
    ],
)
def test_damage_is_repaired_only_if_each_file_is_named(
    code: int, said: list[str], differences: list[str], way: str
) -> None:
    assert judged(Run([("set-up", 0.0)], code, said, 1.0), FILES, differences) == way


@pytest.mark.parametrize(
    ("line", "name"),
    [
        (
            "Job 7 has been submitted with SLURM jobid 41"
            " (log: /x/.snakemake/slurm_logs/rule_campaign/campaigns_F1/41.log).",
            "campaign",
        ),
        (
            "Job 93898ad7-7dea has been submitted with SLURM jobid 41"
            " (log: /x/slurm_logs/group_spaces_define_space/41.log).",
            "spaces_define_space",
        ),
    ],
)
def test_a_line_of_snakemake_names_the_job_of_slurm(line: str, name: str) -> None:
    found = SUBMITTED.search(line)
    assert found is not None
    assert (found["number"], found["name"], Path(found["log"]).name) == ("41", name, "41.log")
