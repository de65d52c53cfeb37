"""The simulated cluster, by hand."""

from __future__ import annotations

from benchmarks import scaling

MEASURED = {
    "workers": {("1", "round 0"): 0.5},
    "shards": {("1", "round 0"): 10.0, ("8", "round 0"): 26.0},
    "slurm": {("all", "median"): 8.0},
    "scheduler": {
        ("100", "plan"): 6.0,
        ("1000", "plan"): 15.0,
        ("10000", "plan"): 105.0,
        ("all", "submit"): 0.02,
    },
}


def test_a_campaign_and_the_grid_are_simulated_from_what_was_measured() -> None:
    _, _, one, _, sixteen, *_ = scaling.by_cluster(MEASURED).split("\n")
    # Planning 5 s + 0.01 s a job, 0.02 s to submit it, 10 s for each job and for the one that joins, 0.5 s a test.
    assert one == f"| 1 | {(5 + 0.03 + 10 + 5000) / 60:.1f} | 1.4 | 0.07 |"
    assert (
        sixteen
        == f"| 16 | {(5 + 16 * 0.03 + 10 + 625 * 0.5 + 10) / 60:.1f} | {(160 + 5000 + 10) / 3600:.1f} | 0.07 |"
    )
    last = scaling.by_cluster(MEASURED).split("\n")[-1]
    # 20 threads a campaign, each campaign a job.
    assert (
        last
        == f"| 1,120 | {(5 + 56 * 0.03 + 10 + 25) / 60:.1f} | {56 * 35 * 20 / 3600:.1f} | 0.54 |"
    )


def test_a_campaign_on_slurm_stands_beside_its_simulation() -> None:
    cases = {str(count): 400.0 / count for count in scaling.AT_A_TIME}
    measured = {(case, "round 0"): seconds for case, seconds in cases.items()} | {
        (case, "processor 0"): 300.0 for case in cases
    }
    _, _, one, two, *_ = scaling.by_jobs(
        {**MEASURED, "cluster": measured | {("all", "tests"): 160.0}}
    ).split("\n")
    # As above; each core has 16 or 8 jobs in turn, each of 10 tests.
    assert one == f"| 1 | 400 | 1.00 | 300 | {5 + 16 * 0.03 + 16 * (10 + 5) + 10:.0f} |"
    assert two == f"| 2 | 200 | 2.00 | 300 | {5 + 16 * 0.03 + 8 * (10 + 5) + 10:.0f} |"
