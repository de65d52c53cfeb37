"""A piece of an experiment is published from exactly the study that its plan describes."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import longer
import numpy as np
import pandas as pd
import pieces
import pytest
import retraining
import rounds
import teaching
import what_is_left
import where_it_pays
from matplotlib.figure import Figure
from outcomes import TEST

from pipeline.__main__ import main
from pipeline.artefacts import stamps
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import write
from pipeline.artefacts.tables import write_tests
from pipeline.config.composing import PARAMS, compose, load
from pipeline.config.schema import Config
from pipeline.detectors.calibrated import calibrated
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.stamping import Stamps
from tests.analysis.fabricated import make_tests
from tests.studies import ROOT

TESTS = 40
SETTINGS = f"comparison.tests={TESTS} comparison.seed=60"
TINY = pieces.Experiment(
    "tiny", "default", {("all", 1): SETTINGS, ("fewer", 1): f"{SETTINGS} ~arms.random"}
)


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A project of its own, with the shipped detectors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    PARAMS.touch()


def composed(experiment: pieces.Experiment, piece: pieces.Piece, *more: str) -> Config:
    """Execute the plan's command that composes a piece. more: what a person added to it."""
    lines = experiment.plan().splitlines()
    (at,) = (
        number
        for number, line in enumerate(lines)
        if line.startswith(f"# {piece[0]}, seed {piece[1]}:")
    )
    assert main([*shlex.split(lines[at + 1])[3:], *more]) == 0
    return load()


def execute(config: Config, versions: list[str] | None = None, seed: int = 60) -> None:
    """Fabricate the held-out tests of a study: each version fails in another fog."""
    for rank, version in enumerate(versions or map(str, config.versions)):
        for scenario in config.held_out:
            space = config.space(scenario)
            keys = {
                "scenario": scenario,
                "strategy": config.comparison.strategy,
                "version": version,
                "seed": seed,
            }
            rows = make_tests(
                space, keys, space.sample(TESTS, np.random.default_rng(seed)), 5.0 * rank
            )
            path = (
                Path(Folders(config).root)
                / "held_out"
                / scenario
                / config.comparison.strategy
                / version
                / str(seed)
            )
            write_tests(path / "tests.parquet", rows, space)
    stamp(config)


def stamp(config: Config) -> None:
    """Mark the files that are there as made by the study."""
    jobs = Jobs(config, step_names())
    today = Stamps(jobs)
    for path in Folders(config).held_out("tests.parquet"):
        if Path(path).exists():
            job = jobs.maker(path)
            assert job is not None
            name = Path(jobs.outputs(job)[-1])
            name.write_text(
                stamps.made(name, today.stamp(job.step, dict(job.wildcards)), [Path(path)]).text()
            )


def test_only_what_the_piece_made_is_published() -> None:
    config = composed(TINY, ("fewer", 1))
    execute(config)
    # An earlier piece in the same folder had another arm and other held-out tests.
    execute(config, versions=["random"])
    execute(config, seed=0)
    table = pd.read_csv(TINY.keep(("fewer", 1)))
    assert list(table) == [*TEST, *sorted(map(str, config.versions))] and "random" not in table
    assert len(table) == TESTS * len(config.held_out)
    assert TINY.published().keys() == {("fewer", 1)}


def test_a_study_of_another_piece_is_refused_by_the_first_key() -> None:
    execute(composed(TINY, ("all", 1)))
    with pytest.raises(
        SystemExit,
        match=r"params\.yaml, piece fewer 1: arms\.random: expected nothing, got 'random'; compose",
    ):
        TINY.keep(("fewer", 1))
    composed(TINY, ("all", 1), "campaign.tests=7")
    with pytest.raises(SystemExit, match=r"piece all 1: campaign\.tests: expected 100, got 7;"):
        TINY.keep(("all", 1))
    with pytest.raises(SystemExit, match="expected a piece that `plan` lists, got all 2"):
        TINY.keep(("all", 2))
    assert not TINY.folder.exists()


def test_an_unfinished_study_is_refused() -> None:
    config = composed(TINY, ("all", 1))
    execute(config, versions=["base"])
    with pytest.raises(
        SystemExit,
        match=r"held_out/.*/tests\.parquet: expected the tests of a finished study, got no file",
    ):
        TINY.keep(("all", 1))


def test_tests_of_other_settings_are_refused_although_params_yaml_is_the_piece() -> None:
    execute(composed(TINY, ("all", 1), "retraining.iterations=7"))
    composed(TINY, ("all", 1))
    with pytest.raises(
        SystemExit,
        match=r"held_out/.*/control/60/tests\.parquet: expected .* params\.yaml, got .*other settings",
    ):
        TINY.keep(("all", 1))
    assert not TINY.folder.exists()


@pytest.mark.parametrize("script", [retraining, rounds, longer, teaching, where_it_pays])
def test_what_the_plan_composes_is_the_piece(script: ModuleType) -> None:
    experiment = script.EXPERIMENT
    piece = list(experiment.compose)[-1]
    composed(experiment, piece)
    with pytest.raises(SystemExit, match="expected the tests of a finished study"):
        experiment.keep(piece)


def test_a_kill_leaves_no_piece_without_what_its_page_shows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def killed(config: Config, version: str, scenarios: list[str]) -> pd.DataFrame:
        assert version == "adaptive" and scenarios == list(config.held_out) and TINY.folder.is_dir()
        raise KeyboardInterrupt

    monkeypatch.setattr(pieces, "what_is_left", killed)

    execute(composed(TINY, ("all", 1)))
    with pytest.raises(KeyboardInterrupt):
        pieces.Experiment("tiny", "default", TINY.compose, explained=lambda kind: "adaptive").keep(
            ("all", 1)
        )
    assert not TINY.published()


def test_the_figure_shows_the_piece_that_is_kept() -> None:
    drawn: list[pieces.Piece] = []

    def figure(found: Mapping[pieces.Piece, pd.DataFrame]) -> Figure:
        drawn.extend(found)
        return Figure()

    execute(composed(TINY, ("all", 1)))
    pieces.Experiment("tiny", "default", TINY.compose, figure=figure).keep(("all", 1))
    assert drawn == [("all", 1)] and TINY.folder.with_suffix(".png").exists()


def test_what_is_left_counts_the_failures_of_the_version_and_scenario(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = composed(TINY, ("all", 1))
    execute(config)
    executed: list[pd.DataFrame] = []

    def failures(config: Config, scenario: str, tests: pd.DataFrame, *_: object) -> int:
        executed.append(tests)
        return 0

    monkeypatch.setattr(what_is_left, "make_detector", lambda section, path: None)
    monkeypatch.setattr(what_is_left, "_failures", failures)
    scenario = config.held_out[0]
    counts = what_is_left.what_is_left(config, "adaptive", [scenario])
    assert {(*row,) for table in executed for row in table[["scenario", "version"]].to_numpy()} == {
        (scenario, "adaptive")
    }
    assert counts.loc["failures", scenario] == len(executed[0]) > 0


def test_what_is_left_drives_a_calibrated_study_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("base.onnx").touch()
    config = compose("smoke", ["goal=detectors", "+tested.base=base.onnx", "calibrate=true"])
    made = DetectorCalibration(
        version="base",
        slope=2,
        offset=1,
        detector_sha256="",
        images_sha256="",
        images=1,
        detections=2,
        right=1,
        reliability={},
        errors={},
    )
    write(Path(Folders(config).calibration("base")), made)
    execute(config, seed=config.comparison.seed)
    used: list[object] = []
    monkeypatch.setattr(what_is_left, "make_detector", lambda section, path: used.append(section))
    monkeypatch.setattr(what_is_left, "_failures", lambda *_: 0)
    what_is_left.what_is_left(config, "base", [config.held_out[0]])
    assert used == [calibrated(config.detector, made.scaling)]
