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


def test_a_campaign_is_simulated_from_the_measured_figures() -> None:
    _, _, single, _, sixteen, *_ = scaling.by_cluster(MEASURED).split("\n")
    # Planning 5 s + 0.01 s a job, 0.02 s to submit it, 10 s for each job and for the last one,
    # 0.5 s a test.
    assert single == f"| 1 | {(5 + 0.03 + 10 + 5000) / 60:.1f} | 1.4 | 0.07 |"
    minutes, hours = (5 + 16 * 0.03 + 10 + 625 * 0.5 + 10) / 60, (160 + 5000 + 10) / 3600
    assert sixteen == f"| 16 | {minutes:.1f} | {hours:.1f} | 0.07 |"


def test_a_campaign_on_slurm_stands_beside_its_simulation() -> None:
    measured = {("all", "tests"): 160.0}
    for count in scaling.AT_A_TIME:
        measured[str(count), "round 0"] = 400.0 / count
        measured[str(count), "processor 0"] = 300.0
    _, _, single, double, *_ = scaling.by_jobs({**MEASURED, "cluster": measured}).split("\n")
    # As above; each core has 16 or 8 jobs in turn, each of 10 tests.
    assert single == f"| 1 | 400 | 1.00 | 300 | {5 + 16 * 0.03 + 16 * (10 + 5) + 10:.0f} |"
    assert double == f"| 2 | 200 | 2.00 | 300 | {5 + 16 * 0.03 + 8 * (10 + 5) + 10:.0f} |"
