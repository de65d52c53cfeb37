"""The retraining experiment: which study is a piece, and its answer by hand."""

from __future__ import annotations

import shlex
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks import retraining
from benchmarks.shared import ERROR, TEST
from pipeline.__main__ import main
from pipeline.artefacts import stamps
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import write_tests
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.stamping import Stamps
from tests.analysis.fabricated import make_tests
from tests.studies import ROOT

TESTS = 40
SETTINGS = f"comparison.tests={TESTS} comparison.seed=60"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with the shipped detectors, in which pieces are small default studies."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    PARAMS.touch()
    monkeypatch.setattr(retraining, "STUDY", "default")
    bases = {"all": SETTINGS, "fewer": f"{SETTINGS} ~arms.random"}
    monkeypatch.setattr(retraining, "BASES", bases)


def composed(base: str, *more: str) -> Config:
    """Execute the plan's command that composes a piece of seed 1, with more overrides."""
    lines = retraining.plan().splitlines()
    command = lines[lines.index(f"# {base}, seed 1: missing") + 1]
    assert main([*shlex.split(command)[3:], *more]) == 0
    return load()


def execute(config: Config, versions: list[str] | None = None, seed: int = 60) -> None:
    """Fabricate the held-out tests of a study: each version fails in another fog."""
    strategy = config.comparison.strategy
    for rank, version in enumerate(versions or map(str, config.versions)):
        for scenario in config.held_out:
            space = config.space(scenario)
            keys = {"scenario": scenario, "strategy": strategy, "version": version, "seed": seed}
            points = space.sample(TESTS, np.random.default_rng(seed))
            folder = Path(Folders(config).root, "held_out", scenario, strategy, version, str(seed))
            rows = make_tests(space, keys, points, 5.0 * rank)
            write_tests(folder / "tests.parquet", rows, space)
    jobs = Jobs(config, step_names())
    today = Stamps(jobs)
    for path in Folders(config).held_out("tests.parquet"):
        if Path(path).exists():
            job = jobs.maker(path)
            assert job is not None
            name, stamp = Path(jobs.outputs(job)[-1]), today.stamp(job.step, dict(job.wildcards))
            name.write_text(stamps.made(name, stamp, [Path(path)]).text())


@pytest.mark.usefixtures("project")
def test_only_tests_of_the_piece_are_published() -> None:
    config = composed("fewer")
    execute(config)
    # An earlier piece in the same folder had another arm and other held-out tests.
    execute(config, versions=["random"])
    execute(config, seed=0)
    table = pd.read_csv(retraining.keep(("fewer", 1)))
    assert list(table) == [*TEST, *sorted(map(str, config.versions))] and "random" not in table
    assert len(table) == TESTS * len(config.held_out)
    assert retraining.published().keys() == {("fewer", 1)}
    assert "# fewer, seed 1: published" in retraining.plan()


@pytest.mark.usefixtures("project")
def test_a_study_of_another_piece_is_rejected_by_the_first_key() -> None:
    execute(composed("all"))
    message = r"params\.yaml, piece fewer 1: arms\.random: expected nothing, got 'random'; compose"
    with pytest.raises(SystemExit, match=message):
        retraining.keep(("fewer", 1))
    composed("all", "campaign.tests=7")
    with pytest.raises(SystemExit, match=r"piece all 1: campaign\.tests: expected 100, got 7;"):
        retraining.keep(("all", 1))
    assert not retraining.FOLDER.exists()


@pytest.mark.usefixtures("project")
def test_an_unfinished_study_is_rejected() -> None:
    execute(composed("all"), versions=["base"])
    message = r"held_out/.*/tests\.parquet: expected the tests of a finished study, got no file"
    with pytest.raises(SystemExit, match=message):
        retraining.keep(("all", 1))


@pytest.mark.usefixtures("project")
def test_tests_of_other_settings_are_rejected_although_params_yaml_is_the_piece() -> None:
    execute(composed("all", "retraining.iterations=7"))
    composed("all")
    message = r"held_out/.*/control/60/tests\.parquet: expected .* got .*other settings"
    with pytest.raises(SystemExit, match=message):
        retraining.keep(("all", 1))
    assert not retraining.FOLDER.exists()


@pytest.mark.parametrize("base", retraining.BASES)
def test_the_plan_composes_each_base(
    base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    PARAMS.touch()
    composed(base)
    with pytest.raises(SystemExit, match="expected the tests of a finished study"):
        retraining.keep((base, 1))


def piece(tests: int = 100, **failed: int) -> pd.DataFrame:
    """A published piece: of each version, the first tests fail."""
    keys = {
        "scenario": "F1star",
        "index": range(tests),
        "animation": "walking",
        "blueprint": "W 01",
    }
    return pd.DataFrame(
        {
            **keys,
            **{
                version: (np.arange(tests) < count).astype(int) for version, count in failed.items()
            },
        }
    )


def long_tailed(
    adaptive: list[int], random: list[int], base: int = 50
) -> dict[tuple[str, int], pd.DataFrame]:
    pairs = enumerate(zip(adaptive, random, strict=True))
    return {
        ("long_tailed", seed): piece(base=base, random=other, adaptive=count)
        for seed, (count, other) in pairs
    }


def rows(answer: str, version: str) -> list[list[str]]:
    """The cells of a version's row in the table of each base."""
    lines = [line for line in answer.splitlines() if line.startswith(f"| `{version}`")]
    return [line.strip("| ").split(" | ") for line in lines]


def row(answer: str, version: str) -> list[str]:
    (cells,) = rows(answer, version)
    return cells


def test_means_and_intervals_by_hand() -> None:
    answer = retraining.answer(long_tailed(adaptive=[10, 12, 14], random=[20, 20, 20]))
    assert (
        "3 of 10 pieces are published." in answer
        and "3 searches, 100 held-out tests each" in answer
    )
    # Differences -10, -8, -6: mean -8, standard error 2 / sqrt(3), t quantile 4.303.
    assert row(answer, "random") == [
        "`random`",
        "20, 20, 20",
        "20.0",
        "-8.0 (-13.0 to -3.0)",
        "0.020",
        "fewer",
    ]
    assert row(answer, "adaptive")[2] == "12.0 (7.0 to 17.0)"


def test_equal_within_a_tenth_of_the_base_is_equivalent() -> None:
    close = retraining.answer(long_tailed(adaptive=[10, 11, 10, 9], random=[10, 10, 11, 10]))
    apart = retraining.answer(long_tailed(adaptive=[1, 20, 10, 9], random=[10, 10, 11, 10]))
    assert row(close, "random")[-1] == "equivalent" and row(apart, "random")[-1] == "not shown"


def test_one_search_shows_nothing() -> None:
    assert row(retraining.answer(long_tailed(adaptive=[0], random=[50])), "random")[-2:] == [
        "1.000",
        "not shown",
    ]


@pytest.mark.parametrize("ahead", [-5, 0, 1])
def test_equal_differences_have_no_spread_and_show_nothing(ahead: int) -> None:
    with warnings.catch_warnings(action="error"):  # SciPy warns of a test without spread.
        answer = retraining.answer(long_tailed(adaptive=[10 + ahead, 20 + ahead], random=[10, 20]))
    assert row(answer, "random")[-3:] == [f"{ahead:.1f}", "1.000", "not shown"]


def test_an_equivalence_is_judged_alone() -> None:
    """As the docstring says: Holm's method leaves the interval as it is."""
    searches = long_tailed(adaptive=[10, 11, 10, 9], random=[50, 51, 50, 50])
    for table, count in zip(searches.values(), [11, 10, 10, 9], strict=True):
        table["control"] = (np.arange(100) < count).astype(int)
    alone = row(retraining.answer(searches), "control")
    searches |= {("uniform", seed): table for (_, seed), table in searches.items()}
    assert (
        rows(retraining.answer(searches), "control") == [alone, alone] and alone[-1] == "equivalent"
    )


def test_a_test_with_an_error_counts_for_no_version() -> None:
    searches = long_tailed(adaptive=[10, 12], random=[20, 20])
    for table in searches.values():
        table.loc[0, "base"] = ERROR
    assert row(retraining.answer(searches), "adaptive")[1] == "9, 11"


def test_secondary_questions_share_their_alpha() -> None:
    """Holm: two p-values of 0.04 are 0.08 each; the primary question stays as it is."""
    contrasts = [
        retraining.Contrast(-1.0, -2.0, -0.1, 0.0, p_value) for p_value in (0.04, 0.04, 0.001)
    ]
    retraining.adjust(contrasts)
    assert [round(each.p_value, 6) for each in contrasts] == [0.08, 0.08, 0.003]
    # The largest of three secondary p-values is left as it is, the middle one doubles.
    alone = long_tailed(adaptive=[10, 14, 11], random=[50, 51, 50], base=20)
    both = {**alone, **{("uniform", seed): table for (_, seed), table in alone.items()}}
    assert [cells[-2] for cells in rows(retraining.answer(alone), "base")] == ["0.020"]
    assert [cells[-2] for cells in rows(retraining.answer(both), "base")] == ["0.040", "0.040"]


def test_a_failure_stays_if_nearly_all_versions_that_learnt_from_tests_have_it() -> None:
    searches = long_tailed(adaptive=[10, 12, 14, 10, 10], random=[9, 20, 20, 20, 20])
    for table in searches.values():
        table["control"] = table["base"]  # Learnt from no tests.
        table["index"] += 1
        table.loc[50:, "scenario"] = "F2star"
        table.loc[50:, "adaptive"] = 1
    searches["long_tailed", 0].loc[0, "base"] = ERROR  # Counts for no version of this search.
    cells = {
        line.split(" | ")[0]: line.split(" | ")[1:]
        for line in retraining.answer(searches).splitlines()
        if line.startswith("| ")
    }
    assert cells["| failures"] == ["F1\\*", "F2\\*", "all |"]
    assert cells["| mean of `base`"] == ["50.0", "0.0", "50.0 |"]
    # Ten versions: all have the tests 0 to 8, nine of them test 9. `adaptive`: 10, 12, 14, 10, 10.
    assert cells["| left by 90 % of the versions that learnt from tests"] == ["10", "0", "10 |"]
    assert cells["| mean of `adaptive`"] == ["11.2", "50.0", "61.2 |"]
