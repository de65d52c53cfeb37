"""Mutated configs never end in a traceback.

Each is rejected in one line that names the key, or is valid by the ranges of the schema.
"""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import pytest
from pydantic import Field
from snakemake.settings.types import ConfigSettings, StorageSettings

from benchmarks.faults import configs as config_faults
from benchmarks.faults.configs import Mutation, counted, fits, hint_at, outcome
from pipeline.config.components import check_components
from pipeline.config.composing import compose, validate
from pipeline.errors import InputError
from pipeline.workflow.jobs import step_names
from pipeline.workflow.plan import plan


def test_mutated_configs_are_refused_by_name_or_valid() -> None:
    found, wrong = counted(120, seed=1)
    assert not [line for line in wrong if "refused by another key's rule" not in line]
    results = [result for _, result in found]
    assert {"refused", "accepted"} <= set(results) and found.total() == 120


def test_the_fuzzer_sees_a_wrong_acceptance_and_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = json.loads(compose("smoke", []).model_dump_json())
    assert outcome(Mutation("none", "", plain, True), tmp_path) == "accepted"
    assert outcome(Mutation("none", "", plain, False), tmp_path) == "wrongly accepted"
    wrong = {**plain, "study": "a/b"}
    assert outcome(Mutation("name", "study", wrong, False), tmp_path) == "refused"
    assert outcome(Mutation("name", "seeds", wrong, False), tmp_path).startswith(
        "refused, key not named: params.yaml: study: expected"
    )
    monkeypatch.setattr(config_faults, "check_components", lambda config: 1 / 0)
    assert (
        outcome(Mutation("none", "", plain, True), tmp_path)
        == "traceback: ZeroDivisionError: division by zero"
    )


@pytest.mark.parametrize(
    ("value", "hint", "right"),
    [
        (3, int, True),
        (True, int, False),
        (3.0, int, False),
        (3, float, True),
        (float("nan"), float, False),
        ("3", float, False),
        ([1, 2], tuple[int, ...], True),
        ([1, "2"], tuple[int, ...], False),
        (None, int | None, True),
        (1, Annotated[float, Field(gt=0, lt=1)], False),
        (0.5, Annotated[float, Field(gt=0, lt=1)], True),
        ({}, Any, None),
    ],
)
def test_the_judge_knows_types_and_ranges(value: Any, hint: Any, right: bool | None) -> None:
    assert fits(value, hint) is right


def test_the_judge_finds_a_keys_range() -> None:
    assert fits(100_001, hint_at(("campaign", "tests"))) is False
    assert fits(100_000, hint_at(("campaign", "tests"))) is True
    assert fits(70, hint_at(("simulator", "camera", "width"))) is False
    assert fits(200, hint_at(("scenarios", "F1", "ego", "speed_kmh"))) is False
    assert fits("a/b", hint_at(("tracking", "model_name"))) is None
    assert fits("../../x", hint_at(("tracking", "model_name"))) is False


def test_snakemake_refuses_an_edited_file_before_any_job(
    capsys: pytest.CaptureFixture[str],
) -> None:
    plain = json.loads(compose("smoke", []).model_dump_json())
    plain["detector"]["threshold"] = 2
    workflow: Any = SimpleNamespace(
        is_main_process=False, storage_settings=StorageSettings(), config_settings=ConfigSettings()
    )
    with pytest.raises(SystemExit, match="2"):
        plan(plain, workflow, step_names())
    assert capsys.readouterr().err == "error: detector.threshold: expected less than 1, got 2\n"
    with pytest.raises(SystemExit, match="2"):
        plan({**plain, "study": "a`id`\n" + "x" * 10_000}, workflow, step_names())
    said = capsys.readouterr().err
    assert (
        said.startswith("error: params.yaml: study: expected letters, digits and _")
        and said.count("\n") == 1
        and len(said) < 300
    )
    workflow.config_settings = SimpleNamespace(configfiles=[Path("data/mine/params.yaml")])
    with pytest.raises(SystemExit, match="2"):
        plan({**plain, "goal": "win"}, workflow, step_names())
    assert capsys.readouterr().err.startswith(
        "error: data/mine/params.yaml: goal: expected 'report', 'base', "
    )


def test_a_scenario_has_the_variables_that_its_simulator_needs() -> None:
    plain = json.loads(compose("smoke", []).model_dump_json())
    changes: list[tuple[dict[str, Any], str]] = [
        (
            {"fog": None},
            "key 'scenarios.F1.space.fog' is missing: .*MujocoWorld needs this variable",
        ),
        (
            {"animation": {"kind": "categorical", "values": ["dancing"]}},
            "scenarios.F1.space.animation: .* takes values among walking,",
        ),
        (
            {"rain": {"kind": "continuous", "low": 0, "high": 300, "step": 10}},
            r"space.rain: .* takes numbers in \[0.0, 100.0\]",
        ),
        (
            {"seed": plain["scenarios"]["F1"]["space"]["fog"]},
            "scenarios.F1.space: 'seed' is a column of every table of tests already",
        ),
    ]
    for change, message in changes:
        changed = json.loads(json.dumps(plain))
        space = {**changed["scenarios"]["F1"]["space"], **change}
        changed["scenarios"]["F1"]["space"] = {name: body for name, body in space.items() if body}
        with pytest.raises(InputError, match=message):
            check_components(validate(changed, "params.yaml"))
