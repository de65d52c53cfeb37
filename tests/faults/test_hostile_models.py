"""Detectors and simulators that hang, crash or take all memory cost one test each, with a reason,
and never become a KPI.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.commands.simulate import concrete_scenario
from pipeline.config.composing import compose
from pipeline.config.sections import Limits
from pipeline.core.loop import run_test
from pipeline.errors import InputError
from pipeline.execution import worker
from pipeline.execution.journal import Journal, Outcome, write
from pipeline.execution.worker import CONTEXT, Broken, Done, Make, Pool, Worker, in_order
from pipeline.execution.workers import Execution, Setup, Workers, episode
from pipeline.progress import Progress
from pipeline.steps import calibrate
from tests.campaigns import analytic_study, folder, journal, key
from tests.data_sets import VISIBLE, images
from tests.faults import hostile
from tests.faults.hostile import ACTS, Hostile, Numbered
from tests.studies import ROOT

LOOSE = Limits(test_s=600, frame_s=600, memory_mb=8000)
ORACLE = ["simulator=analytic", "detector=oracle"]


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def hostile_setup(root: Path, limits: Limits) -> Setup:
    """What executes tests with the hostile detector."""
    config = compose("smoke", ORACLE)
    model = root / "model"
    model.write_bytes(b"")
    simulator, detector = (
        {"_target_": "tests.faults.hostile.Numbered"},
        {"_target_": "tests.faults.hostile.Hostile"},
    )
    return Setup(
        simulator, config.scenarios["F1"], detector, model, config.car, limits, keep_every=4
    )


def executed(root: Path, limits: Limits, numbers: range) -> dict[int, Outcome]:
    """The outcome of each test with the hostile detector, by its number."""
    config, setup = compose("smoke", ORACLE), hostile_setup(root, limits)
    log, workers = Journal(root / "journal", "x", Progress("hostile")), Workers(1, setup)
    jobs = [
        Execution(n, log.path(n), concrete_scenario(config.space("F1"), [f"fog={n}"]))
        for n in numbers
    ]
    try:
        assert sorted(workers.execute(jobs)) == list(numbers)
    finally:
        workers.close()
    return {n: log.read(n) for n in numbers}


def test_each_harm_is_an_error_of_its_test_alone(tmp_path: Path) -> None:
    found = executed(tmp_path, LOOSE.model_copy(update={"frame_s": 2}), range(10))
    assert {n: outcome.reason for n, outcome in found.items() if outcome.is_error} == {
        n: reason for n, (_, reason) in ACTS.items()
    }
    config = compose("smoke", ORACLE)
    world = Numbered(config.scenarios["F1"], config.car.vehicle)
    for n in set(found) - set(ACTS):
        concrete = concrete_scenario(config.space("F1"), [f"fog={n}"])
        alone = Outcome.of(run_test(world, Hostile(""), config.car, concrete, keep_every=4), 0)
        assert len(alone.frames)
        pd.testing.assert_frame_equal(pd.DataFrame(alone.frames), pd.DataFrame(found[n].frames))
        assert all(
            column.tobytes() == found[n].signals[name].tobytes()
            for name, column in alone.signals.items()
        )


def test_a_campaign_of_errors_alone_has_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = analytic_study(
        tmp_path, "campaign.tests=3", "detector._target_=tests.faults.hostile.Fails"
    )
    assert study.run("campaign", **key("random")) == 1
    message = (
        "F1, random, base, seed 3: all 3 tests ended in an error, so there is no result; "
        "3 times: Fails.detect failed: RuntimeError: no"
    )
    assert f"blindspot step campaign: {message}" in capsys.readouterr().err
    assert not (folder(study, "random") / "tests.parquet").exists() and not journal(study).exists()


def test_a_detector_that_crashes_is_refused_before_any_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model.bin"
    model.write_bytes(b"")
    assert (
        main(
            [
                "test-detector",
                str(model),
                *ORACLE,
                "detector._target_=tests.faults.hostile.Segfault",
            ]
        )
        == 2
    )
    assert (
        f"blindspot test-detector: {model}: process died (SIGSEGV) on the first images"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("fog", "reason"),
    [(2, "detect timed out after 2 s"), (3, "process died (SIGSEGV)"), (5, ACTS[5][1])],
)
def test_a_single_scenario_has_the_limits_of_a_test(tmp_path: Path, fog: int, reason: str) -> None:
    limits = LOOSE.model_copy(update={"frame_s": 2})
    with pytest.raises(InputError, match=f"^the scenario cannot be executed: {re.escape(reason)}$"):
        episode(
            hostile_setup(tmp_path, limits),
            concrete_scenario(compose("smoke", ORACLE).space("F1"), [f"fog={fog}"]),
        )


@pytest.mark.parametrize(
    ("harm", "reason"),
    [("Hangs", "detect timed out after 2 s"), ("Fails", ACTS[4][1].replace("Hostile", "Fails"))],
)
def test_a_calibration_has_the_limits_of_a_test(tmp_path: Path, harm: str, reason: str) -> None:
    config = compose(
        "smoke", [*ORACLE, "limits.frame_s=2", f"detector._target_=tests.faults.hostile.{harm}"]
    )
    model = tmp_path / "model"
    with pytest.raises(
        InputError, match=f"^{model} fails on validation image 1: {re.escape(reason)}$"
    ):
        calibrate.detect_all(config, model, images(VISIBLE), lambda *_: None)


def test_a_task_whose_process_dies_is_computed_again_once(tmp_path: Path) -> None:
    assert list(in_order(partial(hostile.dies_once, tmp_path), range(4), 2)) == [0, 1, 4, 9]
    with pytest.raises(
        InputError,
        match=r"^part 1 of 1: process died \(SIGSEGV\), twice; the same command resumes$",
    ):
        list(in_order(hostile.dies, range(1), 1))


def test_work_without_processes_is_refused_unless_there_is_none() -> None:
    assert list(in_order(hostile.dies, [], 2)) == []
    with pytest.raises(ValueError, match="^count must be at least 1 process, got 0$"):
        list(in_order(hostile.dies, range(1), 0))


def test_a_process_that_cannot_start_ends_the_work() -> None:
    said = r"^a worker process cannot start: process died \(exit code 3\)$"
    with Pool(1, hostile.unmakeable) as pool, pytest.raises(InputError, match=said):
        list(pool.run([1]))


def test_limits_hold_while_a_process_starts_however_large_its_task_is() -> None:
    said = "^a worker process cannot start: took more than 500 MB of memory$"
    with (
        Pool(1, hostile.greedy, LOOSE.model_copy(update={"memory_mb": 500})) as pool,
        pytest.raises(InputError, match=said),
    ):
        list(pool.run([bytes(5 * hostile.MB)]))


@pytest.mark.parametrize(
    ("limits", "harm", "reason"),
    [
        ({"test_s": 1}, hostile.sleep, "timed out after 1 s"),
        ({"memory_mb": 400}, hostile.eat, "took more than 400 MB of memory"),
    ],
)
def test_a_process_over_a_limit_is_ended(
    limits: dict[str, float], harm: object, reason: str
) -> None:
    with Pool(1, hostile.harms, LOOSE.model_copy(update=limits)) as pool:
        ((_, result),) = pool.run([harm])  # type: ignore[list-item]
    assert isinstance(result, Broken) and result.reason == reason


def test_an_outcome_that_was_written_before_its_process_died_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, workers = (
        Journal(tmp_path / "journal", "x", Progress("test")),
        Workers(1, hostile_setup(tmp_path, LOOSE)),
    )
    write(log.path(0), Outcome.error("of the test itself"), {})
    monkeypatch.setattr(
        Pool, "run", lambda self, jobs: iter([(0, Broken("process died", again=True))])
    )
    assert list(workers.execute([Execution(0, log.path(0), {})])) == [0]
    assert log.read(0).reason == "of the test itself"


def test_the_limit_of_a_test_does_not_count_the_start_of_its_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, theirs = CONTEXT.Pipe()
    monkeypatch.setattr(CONTEXT, "Pipe", lambda: (ours, Mock()))
    monkeypatch.setattr(CONTEXT, "Process", Mock())
    started: Worker[str, None] = Worker(Mock())
    started.give("task")
    limits = LOOSE.model_copy(update={"test_s": 5})
    assert started.look(9, limits) is None
    theirs.send(None)
    assert started.look(0, limits) is None and theirs.poll() and theirs.recv() == "task"
    assert started.look(4, limits) is None
    assert started.look(4, limits) == Broken("timed out after 5 s", again=False)


def test_the_time_in_which_a_run_was_suspended_does_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter([0.0, 3600.0])
    monkeypatch.setattr(worker, "time", Mock(monotonic=lambda: next(clock)))
    monkeypatch.setattr(
        worker,
        "Worker",
        lambda _: Mock(connection=CONTEXT.Pipe()[0], look=lambda seconds, _: Done(seconds)),
    )
    make: Make[int, float] = Mock()
    with Pool(1, make) as suspended:
        assert list(suspended.run([7])) == [(0, worker.LONGEST_TICK_S)]


def test_a_process_works_with_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENCV_FOR_THREADS_NUM", "4")
    with Pool(1, hostile.counting) as pool:
        ((_, threads),) = pool.run([0])
    assert isinstance(threads, list) and len(threads) > 1 and set(threads) == {1}


def test_a_leak_ends_its_process_but_no_task() -> None:
    with Pool(1, hostile.leaking, LOOSE.model_copy(update={"memory_mb": 500})) as pool:
        done = [result for _, result in sorted(pool.run(range(6)))]
    assert len(done) == 6 and all(isinstance(result, int) and result < 6 for result in done)
