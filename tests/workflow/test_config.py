"""The schema of the configuration rejects wrong input by name."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from pydantic import ValidationError

from pipeline.__main__ import main
from pipeline.config import composing
from pipeline.config.composing import CONF, compose, dump, functional_scenario, load
from pipeline.errors import InputError
from pipeline.scenarios.functional import FunctionalScenario

STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_composes_and_survives_a_round_trip(study: str, tmp_path: Path) -> None:
    config = compose(study, [])
    path = tmp_path / "params.yaml"
    path.write_text(dump(config, "test"))
    assert load(path) == config
    assert config.study == study


@pytest.mark.parametrize("group", ["detector", "simulator"])
def test_every_choice_of_a_group_composes(group: str) -> None:
    for path in (CONF / group).glob("*.yaml"):
        needed = ["detector.function=math.sqrt"] if path.stem == "function" else []
        assert getattr(compose("smoke", [f"{group}={path.stem}", *needed]), group)["_target_"]


def test_a_camera_is_chosen_by_its_name() -> None:
    usual, fine = (
        compose("default", words).simulator["camera"] for words in ([], ["camera=640x384"])
    )
    assert (usual["width"], usual["height"]) == (320, 192)
    assert fine == {**usual, "width": 640, "height": 384}
    assert "camera" not in compose("smoke", ["simulator=analytic"]).simulator


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("camera=640x38", "there is no conf/camera/640x38.yaml; did you mean '640x384'?"),
        ("camera=640", "there is no conf/camera/640.yaml; did you mean '640x384'?"),
        ("=640", "expected key=value, got '=640'"),
        (
            "search=[F5",
            "search: expected a value that Hydra reads, got '[F5'; is a bracket or a quotation "
            "mark missing?",
        ),
        ("+search=[", "+search: expected a value that Hydra reads, got '['"),
        ("search=F5", "search: expected a list in square brackets, got 'F5'"),
        ("search=[]", "search: expected at least 1, got []"),
        ("campaign.testss=3", "unknown key 'campaign.testss'; did you mean 'campaign.tests'?"),
        ("+campaign.testss=3", "unknown key 'campaign.testss'; did you mean 'tests'?"),
        ("campaign.tests=0", "campaign.tests: expected at least 1, got 0"),
        ("strategies=[random,forst]", "strategies: there is no 'forst'; did you mean 'forest'?"),
        (
            "arms.adaptive=pairwise",
            "arms.adaptive: 'pairwise' is not in strategies, so it supplies no frames; add it to "
            "strategies, set arms",
        ),
        (
            "strategies=[mixed]",
            "arms.random: 'random' is not in strategies, so it supplies no frames",
        ),
        (
            "arms={}",
            "arms={} changes nothing, because an override only adds keys; ~arms.KEY removes one",
        ),
        ("strategies=[]", "strategies: expected at least 1, got []"),
        ("+arms.base=random", "arms: 'base' is the version before retraining; choose another name"),
        (
            "+arms.new-one=random",
            "arms.new-one: expected letters, digits and _, at most 60, for use in paths, got "
            "'new-one'",
        ),
        (
            "retraining={searches:own,seeds:[1]}",
            "retraining.seeds must be [0], the seeds of the search, because retraining.searches "
            "is 'own', got [1]",
        ),
        ("search=[F1,F22]", "search: there is no conf/scenario/F22.yaml; did you mean 'F2'?"),
        ("held_out=[F1]", "held_out must not be searched, but both lists have F1"),
        (
            "scenarios.F1star.town=${scenarios.F1.town}",
            "held_out: F1star has the town of F1 (style and seed), which is searched, so training "
            "would use it",
        ),
        (
            "scenarios.F1star.people=1",
            "held_out: F1star has the people of F1 (people: 1), which is searched, so training "
            "would use them",
        ),
        (
            "scenarios.F1.people=0",
            "conf/scenario/F1.yaml: scenarios.F1.people: expected at least 1, got 0",
        ),
        (
            "+scenarios.F1.space.blueprint={kind:categorical,values:['W 01']}",
            "conf/scenario/F1.yaml: scenarios.F1.space: 'blueprint' comes from `people`, the "
            "number of a population",
        ),
        ("base_set.rare.children=0", "base_set.rare.children: expected more than 0, got 0"),
        ("base_set.rare.crouching=1.5", "base_set.rare.crouching: expected at most 1, got 1.5"),
        ("seeds=[3,3]", "conf/: seeds: expected different entries, got 3 twice"),
        ("retraining.seeds=[0,1,0]", "retraining.seeds: expected different entries, got 0 twice"),
        ("search=[F1,F2,F1]", "search: expected different entries, got 'F1' twice"),
        ("held_out=[F1star,F1star]", "held_out: expected different entries, got 'F1star' twice"),
        (
            "strategies=[random,mixed,random]",
            "strategies: expected different entries, got 'random' twice",
        ),
        (
            "campaign.transfer=[mixed,mixed]",
            "campaign.transfer: expected different entries, got 'mixed' twice",
        ),
        (
            "+sampler@samplers.my-forest=forest",
            "samplers.my-forest: expected letters, digits and _, at most 60",
        ),
        (
            "+detector.model=my.onnx",
            "detector.model is set by the study; leave it out: `python -m pipeline test-detector "
            "FILE` tests",
        ),
        (
            "scenarios.F1.space.fog.low=200",
            "scenarios.F1.space: variable 'fog': low must be below high, got 200",
        ),
        (
            "+scenarios.F1.constraints=[['animation != crouchin']]",
            "conf/scenario/F1.yaml: scenarios.F1: constraint 'animation != crouchin': category "
            "must be one of walking, texting, crouching, "
            "limping, drunk, stumble; got 'crouchin'; did you mean 'crouching'?",
        ),
        (
            "+scenarios.F1.constraints=[['pedestrian_speed = 1.4']]",
            "got '1.4'; did you mean '1.5'?",
        ),
        (
            "+scenarios.F1.constraints=[['rain = 0'],['rain = 10','fog = 0'],['fog != 0']]",
            "conf/scenario/F1.yaml: scenarios.F1: constraints: these contradict each other, so no "
            "point is left: "
            "[rain = 0]; [rain = 10, fog = 0]; [fog != 0]",
        ),
        (
            "+scenarios.F1.constraints=['if fog > 50 then animation = crouchin']",
            "constraint 'if fog > 50 then animation = crouchin', character 30: category must be "
            "one of walking, texting, crouching,",
        ),
        (
            "+scenarios.F1.space.wind={kind: continuous, low: 0, high: 20, step: 5, unit: m/s}",
            "scenarios.F1.space.wind: pipeline.simulators.mujoco.world.MujocoWorld does not use "
            "this variable",
        ),
        (
            "+scenarios.F1.constraints=[['rain = 50'],['fog = 50'],['sun_azimuth = "
            "30'],['sun_altitude = 30'],['pedestrian_shift = 0'],"
            "['pedestrian_speed = 1'],['blueprint = W 01']]",
            "scenarios.F1.constraints: they exclude almost the whole space: none of",
        ),
        (
            "front_car.space.constraints=['current_lane <= lane']",
            "character 17: expected a number or a variable after <=, got 'lane'",
        ),
        (
            "front_car.space.constraints=['current_lane >= lanes']",
            "must exclude the second of one lane",
        ),
        (
            "front_car.space.constraints=[['lanes = 1'],['lanes = 2']]",
            "these contradict each other, so no point is left: [lanes = 1]",
        ),
        (
            "scenarios.F1.ego.speed_kmh=-3",
            "scenarios.F1.ego.speed_kmh: expected more than 0, got -3",
        ),
        (
            "scenarios.F1.actors.bus.y_m=-9",
            "conf/scenario/F1.yaml: scenarios.F1: actors.bus: is off the road at (-8.5, -9.0) "
            "after 0 s",
        ),
        (
            "scenarios.F1.actors.bus.x_m=-40",
            "actors.bus: is off the road at (-40.0, -5.2) after 0 s",
        ),
        (
            "scenarios.F1.actors.bus.kind=tram",
            "scenarios.F1.actors.bus.kind: expected 'hatchback', 'saloon',",
        ),
        (
            "+scenarios.F1.actors.bus.speed_kmh=-1",
            "scenarios.F1.actors.bus.speed_kmh: expected at least 0",
        ),
        (
            "+scenarios.F1.actors.ego={kind: saloon, x_m: 60, y_m: 1.75}",
            "F1.actors: 'ego' is the name of a body that every world has",
        ),
        (
            "+scenarios.F1.actors.pedestrian_head={kind: saloon, x_m: 60, y_m: 1.75}",
            "F1.actors: 'pedestrian_head' is the name of a body that every world has",
        ),
        (
            "+scenarios.F1.actors.street_main={kind: saloon, x_m: 60, y_m: 1.75}",
            "F1.actors: 'street_main' is the name of a body that every world has",
        ),
        (
            "scenarios.F1.actors.oncoming.x_m=16.5",
            "actors.parked_far: overlaps oncoming at the start",
        ),
        (
            "+scenarios.F1.ego.path=[[-80,-9],[0,-1.75],[80,5.5]]",
            "scenarios.F1: ego.path: leaves the road at (-",
        ),
        (
            "+scenarios.F1.ego.path=[[-80,-1.75],[2,-1.75],[3,4],[4,-1.75]]",
            "scenarios.F1: ego.path: corners of radius 7.75 m do not fit",
        ),
        (
            "front_car.space.constraints=[]",
            "must exclude the second of one lane: add [lanes = 2, current_lane != 2]",
        ),
        (
            "front_car.space.constraints=[['lanes = 4']]",
            "constraint 'lanes = 4': category must be one of 1, 2; got '4'",
        ),
        (
            "front_car.space.variables.weather=[sunny,snowy]",
            "variables.weather must be among sunny, cloudy, rainy; got snowy",
        ),
        ("+front_car.space.variables.fog=[thin]", "variables must be weather, lane_orientation,"),
        (
            "+scenarios.F1.pedestrian.at=[0,2]",
            "pedestrian.at: (0.0, 2.0) must lie on the ego's path, but lies 3.75 m beside it",
        ),
        ("scenarios.F1.town.seed=x", "scenarios.F1.town.seed: expected a whole number"),
        ("+scenarios.F1.town.sed=1", "unknown key 'scenarios.F1.town.sed'; did you mean 'seed'?"),
        (
            "+samplers.forest.explor=0.1",
            "unknown key 'samplers.forest.explor'; did you mean 'explore'?",
        ),
        (
            "samplers.forest._target_=pipeline.nowhere.Sampler",
            "samplers.forest._target_: there is no 'pipeline.nowhere.Sampler'",
        ),
        (
            "campaign.transfer=[random]",
            "campaign.transfer: 'random' (pipeline.core.samplers.random.RandomSampler) takes no "
            "tests of other",
        ),
        ("campaign.transfer=[pairwise]", "campaign.transfer: there is no 'pairwise'"),
        (
            "tracking.experiment=../../../../x",
            "tracking.experiment: expected letters, digits and _, joined by - or /, at most 60",
        ),
        ("tracking.experiment=a//b", "tracking.experiment: expected letters,"),
        (
            "tracking.model_name=a/b",
            "tracking.model_name: expected letters, digits and _, joined by -, at most 60",
        ),
        (f"tracking.model_name={'x' * 5000}", f"at most 60, for use in paths, got '{'x' * 79}…"),
        (
            "base.weights=../elsewhere",
            "base.weights: expected a path inside the project (link outside files into it)",
        ),
        ("filter.overrules=/etc/passwd", "filter.overrules: expected a path inside the project"),
        (
            "+tested.mine='a{1}.onnx'",
            "tested.mine: expected a path without braces, which are Snakemake's wildcards, "
            "got 'a{1}.onnx'",
        ),
        (
            "~detector.threshold",
            "key 'detector.threshold' is missing: the study judges and brakes by it, too",
        ),
        (
            "simulator.camera.width=abc",
            "simulator.camera.width: expected a whole number, got 'abc'",
        ),
        ("simulator.camera.width=0", "simulator.camera.width: expected at least 64, got 0"),
        (
            "simulator.camera.hfov_deg=200",
            "simulator.camera.hfov_deg: expected at most 120, got 200",
        ),
        ("simulator.camera.rate_hz=0", "simulator.camera.rate_hz: expected at least 2, got 0"),
        (
            "simulator.camera.rate_hz=45",
            "simulator.camera.rate_hz: expected a whole number of 5 ms steps between two images, "
            "as at 40 or 50 Hz, got 45",
        ),
        (
            "+simulator.camera.widht=64",
            "unknown key 'simulator.camera.widht'; did you mean 'width'?",
        ),
        ("+simulator.vehicle=1", "simulator.vehicle is set by the study; leave it out"),
        ("detector.threshold=2", "detector.threshold: expected less than 1, got 2"),
        ("detector=function", "overrides: Missing mandatory value: function"),
        (
            "samplers.forest.batch_size=-3",
            "samplers.forest: batch_size must be in [1, 1000], got -3",
        ),
        (
            "samplers.forest.batch_size='20'",
            "samplers.forest.batch_size: expected a whole number, got '20'",
        ),
        ("samplers.coverage.k=99", "samplers.coverage: k must be in [1, 6], got 99"),
        ("samplers.coverage.k=6", "samplers.coverage: k must be smaller, as the space has"),
        (
            "samplers.forest._target_=builtins.type",
            "expected a class with ask and tell, a Sampler, got 'builtins.type'",
        ),
        (
            "detector._target_=pipeline.protocols.Detector",
            "detector._target_: expected a class with detect, a Detector that can be instantiated",
        ),
        (
            "detector._target_=os.system",
            "detector._target_: expected a class with detect, a Detector, got 'os.system'",
        ),
        (
            "scenarios.F1.space.rain.kind=continous",
            "rain.kind: expected one of continuous, integer, categorical, got 'continous'",
        ),
        (
            "scenarios.F1.space.rain.low=x",
            "conf/scenario/F1.yaml: scenarios.F1.space: rain.low: expected a number, got 'x'",
        ),
        ("campaign.tests='80'", "campaign.tests: expected a whole number, got '80'"),
        ("campaign.tests=true", "campaign.tests: expected a whole number, got True"),
        (
            "campaign.failure_threshold_s=nan",
            "campaign.failure_threshold_s: expected a finite number, got nan",
        ),
        (
            "scenarios.F1star.label=F2",
            "scenarios.F1star.label: F2 has the label 'F2', too; choose another",
        ),
        (
            "+exposure.variables.rian={kind: normal, mean: 0, deviation: 1, source: a public "
            "statistic}",
            "exposure for F1: ",
        ),
        (
            "base_set.validation_share=1.5",
            "base_set.validation_share: expected less than 0.9, got 1.5",
        ),
    ],
)
def test_wrong_input_is_named(override: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        compose("default", [override])


def test_a_missing_file_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    trained = ["front_car", "base.source=trained"]
    for missing, (study, *overrides) in {
        "weights.safetensors": trained,
        "model.json": trained,
        "curve.csv": ["default"],
    }.items():
        with pytest.raises(
            InputError,
            match=r"^base\.weights: expected the folder of a detector, found no file "
            rf"mine/{missing}$",
        ):
            compose(study, ["base.weights=mine", *overrides])
        (tmp_path / "mine" / missing).write_text("content")
    compose("default", ["base.weights=mine", "goal=detectors", "+tested.mine=mine"])
    with pytest.raises(
        InputError,
        match=r"^tested\.new: expected the file or folder of a detector, found no new\.onnx$",
    ):
        compose(
            "default",
            ["base.weights=mine", "goal=detectors", "+tested.mine=mine", "+tested.new=new.onnx"],
        )


def test_a_wrong_key_is_named_beside_a_new_one() -> None:
    with pytest.raises(InputError, match=r"^unknown key 'campaign\.tset'; did you mean"):
        compose("default", ["goal=detectors", "+tested.mine=a.onnx", "campaign.tset=3"])


def test_a_town_with_other_streets_is_the_same_town() -> None:
    with pytest.raises(InputError, match=r"held_out: F1star has the town of F1 \(style and seed\)"):
        compose("default", ["scenarios.F1star.town.style=urban", "scenarios.F1star.town.seed=11"])


def test_scenarios_of_a_comparison_share_a_space() -> None:
    with pytest.raises(InputError, match="held_out: F2star and F1star have different spaces"):
        compose("default", ["held_out=[F1star,F2star]", "scenarios.F2star.space.fog.high=50"])


def test_scenarios_of_a_comparison_share_their_constraints() -> None:
    with pytest.raises(InputError, match="held_out: F2star and F1star have different spaces"):
        compose(
            "default",
            ["held_out=[F1star,F2star]", "+scenarios.F2star.constraints=[['rain = 0','fog = 0']]"],
        )


@pytest.mark.parametrize("strategy", ["evolutionary", "network", "forest"])
def test_no_strategy_that_learns_chooses_the_held_out_tests(strategy: str) -> None:
    with pytest.raises(InputError, match=f"comparison.strategy: '{strategy}' learns from results"):
        compose("default", [f"comparison.strategy={strategy}"])


def test_an_unknown_study_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compose", "study=defualt"]) == 2
    assert "there is no study 'defualt'; did you mean 'default'?" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_is_told_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compose", "study=defualt", "--out", str(tmp_path / "nodir/x.yaml")]) == 2
    assert (
        f"nodir/x.yaml: expected a file to write to, got one in {tmp_path / 'nodir'}, which is "
        "not a folder" in capsys.readouterr().err
    )


def test_a_missing_params_file_names_the_command_that_makes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "params.yaml"
    assert main(["step", "define-space", "--scenario", "F1", "--params", str(missing)]) == 2
    assert "compose study=default" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"study: a\nstudy: b\n", "line 2: not valid YAML (the key 'study' appears twice)"),
        (b"study: caf\xe9\n", "expected UTF-8 text, got the byte 0xe9 at 10"),
        (
            b"a: &x [1]\nb: [*x, *x]\n",
            "line 2: not valid YAML (the alias *x is not allowed: write out the value)",
        ),
        (b"true: 1\n", "line 1: not valid YAML (expected text as a key, got 'true')"),
        (b"a: 2024-02-30\n", "not valid YAML (day is out of range for month)"),
        (b"a: 2024-02-28\n", "expected text, numbers, lists and mappings alone"),
        (b"a: " + b"[" * 5000, "nested too deeply"),
        (b"[1, 2]", "expected keys with values, got [1, 2]"),
        (b"", "expected keys with values, got None"),
    ],
)
def test_a_file_that_is_no_config_is_named(text: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}.*{re.escape(message)}"):
        load(path)


def test_a_wrong_file_of_conf_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(CONF, tmp_path / "conf")
    monkeypatch.setattr(composing, "CONF", tmp_path / "conf")
    camera = tmp_path / "conf" / "camera" / "320x192.yaml"
    for text, message in (
        (b"width: 1\nwidth: 2\n", "the key 'width' appears twice"),
        (b"width: \xe9\n", "expected UTF-8 text"),
    ):
        camera.write_bytes(b"# @package simulator.camera\n" + text)
        with pytest.raises(InputError, match=f"^{re.escape(str(camera))}.*{message}"):
            compose("default", [])


def test_a_study_that_cannot_be_composed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(CONF, tmp_path / "conf")
    monkeypatch.setattr(composing, "CONF", tmp_path / "conf")
    (tmp_path / "conf" / "study" / "mine.yaml").write_text("# @package _global_\ngoal: base\n")
    with pytest.raises(InputError, match=r"^conf/study/mine\.yaml: "):
        compose("mine", [])


def test_a_scenario_of_one_variable_is_refused() -> None:
    plain = functional_scenario("F1").model_dump()
    changed = {**plain, "people": None, "space": {"fog": plain["space"]["fog"]}}
    with pytest.raises(
        ValidationError, match="space: expected at least two variables, `people` included, got 1"
    ):
        FunctionalScenario.model_validate(changed)


def test_the_boxes_that_brake_are_those_that_are_judged() -> None:
    with pytest.raises(
        InputError,
        match=r"^conf/: aeb\.brakes_from: boxes brake from a score of 0\.05 and are false "
        r"positives from detector\.threshold=0\.8; .*aeb\.why_below_threshold why they differ$",
    ):
        compose("default", ["aeb.brakes_from=0.05"])
    config = compose("default", ["aeb.brakes_from=0.05", "aeb.why_below_threshold=a second stage"])
    assert config.car.aeb.brakes_from == 0.05
    assert compose("thesis", []).car.aeb.brakes_from == 0.25
    assert "threshold" not in compose("thesis", ["detector=oracle"]).detector
    assert compose("thesis", []).vehicle.cruise == "hold"
