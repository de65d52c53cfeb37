"""Every step reads and writes only declared files and keys, and uses all of them.

The tests run a small study of each kind job by job in this process, under an audit hook that sees
every opened file.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import chdir, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

from pipeline import contract
from pipeline.__main__ import main
from pipeline.artefacts import stamps
from pipeline.config import schema
from pipeline.config.composing import compose
from pipeline.config.declared import declared
from pipeline.contract import order_of, perform, step_of
from pipeline.detectors import onnx
from pipeline.detectors.yolo import weights
from pipeline.detectors.yolo.export import onnx_of
from pipeline.workflow.jobs import Jobs, flat, step_names
from pipeline.workflow.stamping import Stamps
from tests.studies import ROOT, StudyFolder

WEIGHTS = "models/uniform/weights.safetensors"
# At 10 s every test fails: a region has replays, which read the simulator and the detector.
SMALL = {
    "smoke": [
        *(
            "search=[F1]",
            "campaign.tests=4",
            "samplers.mixed.batch_size=2",
            "comparison.tests=2",
            "base_set.images=40",
        ),
        *(
            "retraining.iterations=1",
            "retraining.added_frames=8",
            "retraining.batch_size=4",
            "regions.min_failures=2",
            "report.replays=2",
        ),
        *(
            "campaign.transfer=[mixed]",
            "samplers.random.batch_size=2",
            "campaign.failure_threshold_s=10",
        ),
        *(
            "~arms.random",
            "+arms.balanced=balanced_scenes",
            "retraining.searches=own",
            "campaign.shards=2",
        ),
    ],
    "detectors": [
        *(
            "search=[F1]",
            "campaign.tests=4",
            "comparison.tests=2",
            "seeds=[0]",
            "report.replays=2",
            "samplers.mixed.batch_size=2",
        ),
        *(
            "campaign.failure_threshold_s=10",
            "regions.min_failures=2",
            "calibrate=true",
            "base_set.images=40",
        ),
        *(
            "simulator=analytic",
            "goal=detectors",
            "+tested.one=one.onnx",
            f"+tested.other={WEIGHTS}",
            "comparison.second_iou=0.3",
        ),
    ],
    "front_car": [
        "front_car.images=33",
        "front_car.test_images=1",
        "front_car.iterations=1",
        "front_car.batch_size=4",
    ],
}


SEARCH = {"define_space", "campaign", "measure", "cluster", "compare"}
FRONT_CAR = {name for name in step_names() if name.startswith("front_car")}
STEPS = {
    "smoke": set(step_names()) - FRONT_CAR - {"detector_report", "calibrate", "export"},
    "detectors": SEARCH
    | {"detector_report", "evidence", "render_base", "export", "calibrate", "second_iou"},
    "front_car": FRONT_CAR,
}
UNREAD: dict[str, set[tuple[str, str]]] = {
    "smoke": set(),
    "detectors": set(),
    "front_car": set(),
}
"""Keys that only other studies need."""


@dataclass
class Watch:
    """Records the opened files of a folder and the keys read from the config, while it is on."""

    root: Path
    on: bool = False
    read: set[str] = field(default_factory=set)
    written: set[str] = field(default_factory=set)
    keys: set[tuple[str, str]] = field(default_factory=set)

    def opened(self, path: Any) -> None:
        """Record a file that a library opens outside Python."""
        self.hook("open", (path, "r", os.O_RDONLY))

    def hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.on and event == "open" and isinstance(arguments[0], str | os.PathLike):
            path = Path(os.path.abspath(arguments[0]))
            if (
                path.is_dir() or path.suffix == stamps.SUFFIX
            ):  # To flush a folder, and to check a file that a step reads.
                return
            tested = path.parent == self.root and path.suffix == ".onnx"
            if (
                tested
                or path.is_relative_to(self.root / "data")
                or path.is_relative_to(self.root / "models")
            ):
                writes = (
                    bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
                    if isinstance(arguments[2], int)
                    else False
                )
                (self.written if writes else self.read).add(os.path.relpath(path, self.root))

    @contextmanager
    def watching(self) -> Iterator[None]:
        self.read, self.written, self.keys, self.on = set(), set(), set(), True
        try:
            yield
        finally:
            self.on = False


def covers(declared: list[str], path: str) -> bool:
    """Whether a path is declared, or lies in a declared folder."""
    folders = tuple(name for name in declared if name.endswith("/"))
    return path in declared or path.startswith(folders)


@pytest.fixture
def watch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Watch:
    watch = Watch(tmp_path)
    sys.addaudithook(watch.hook)

    def looked_up(section: Any, name: str) -> Any:
        if watch.on and name in type(section).model_fields:
            watch.keys.add((type(section).__name__, name))
        return object.__getattribute__(section, name)

    def unwatched(config: schema.Config, keys: Iterable[str]) -> schema.Config:
        watch.on = False
        part = declared(config, keys)
        watch.on = True
        return part

    def dumped(section: BaseModel, *, include: Any = None, **options: Any) -> dict[str, Any]:
        if watch.on:
            watch.keys |= {
                (type(section).__name__, name) for name in include or type(section).model_fields
            }
        return dump(section, include=include, **options)

    dump = BaseModel.model_dump
    monkeypatch.setattr(BaseModel, "__getattribute__", looked_up)
    monkeypatch.setattr(BaseModel, "model_dump", dumped)
    monkeypatch.setattr(contract, "declared", unwatched)
    for module, name in ((onnx, "_session"), (weights, "safe_open")):
        monkeypatch.setattr(module, name, noting(watch, getattr(module, name)))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return watch


def noting(watch: Watch, opens: Callable[..., Any]) -> Callable[..., Any]:
    def noted(path: Any, *rest: Any, **named: Any) -> Any:
        watch.opened(path)
        return opens(path, *rest, **named)

    return noted


@pytest.mark.parametrize("study", SMALL)
def test_every_step_reads_and_writes_what_it_declares(
    study: str, tmp_path: Path, watch: Watch
) -> None:
    overrides = ["base.weights=models/uniform", *SMALL[study]]
    onnx_of(ROOT / "models" / "uniform", tmp_path).rename(tmp_path / "one.onnx")
    (tmp_path / "models").symlink_to(ROOT / "models")
    read: dict[tuple[str, str], bool] = {}
    performed = set()
    with chdir(tmp_path):
        jobs = Jobs(compose("default" if study == "detectors" else study, overrides), step_names())
        stamps = Stamps(jobs)
        for target, outputs in jobs.in_order():
            wildcards = dict(target.wildcards)
            order = order_of(
                target.step, jobs.config, wildcards, stamps.stamp(target.step, wildcards)
            )
            with watch.watching():
                perform(order, jobs.config)
            inputs = relative(flat(order.reads))
            allowed = [*outputs, *ALSO.get(target.step, ()), f"data/{jobs.config.study}/journal/"]
            assert not [path for path in watch.read if not covers([*inputs, *allowed], path)], (
                f"{target} reads undeclared files"
            )
            assert not [path for path in watch.written if not covers(allowed, finished(path))], (
                f"{target} writes undeclared files"
            )
            needed = {
                name: files
                for name, files in order.reads.items()
                if (target.step, name) not in SOMETIMES
            }
            for path in relative(flat(needed)):
                assert any(covers([path], read) for read in watch.read), (
                    f"{target} declares {path} and does not read it"
                )
            assert all(Path(path).exists() for path in outputs), (
                f"{target} declares files that it does not write"
            )
            for key in jobs.contracts[target.step].depends(jobs.config, wildcards):
                read[target.step, key] = (
                    read.get((target.step, key), False) or read_of(key) in watch.keys
                )
            performed.add(target.step)
    # What the jobs that share a step's work read, that step declares for its stamp.
    unread = {
        (name, key)
        for (name, key), seen in read.items()
        if not seen and not read.get((str(jobs.contracts[name].parts), key))
    }
    assert unread == UNREAD[study], "steps declare these keys and do not read them"
    assert performed == STEPS[study]


SOMETIMES = {("report", "detectors"), ("detector_report", "detectors"), ("campaign", "model")}
"""Inputs that a study may need only in part: only versions that change an outcome have a replay,
and joined shards are not executed."""


def relative(paths: list[str]) -> list[str]:
    """Paths from the working directory; folders keep their slash."""
    return [os.path.relpath(path) + "/" * path.endswith("/") for path in paths]


ALSO = {"track": ("data/mlflow/",)}
"""Output folders of a step outside the study's folder."""


def finished(path: str) -> str:
    """The final name of a temporary file."""
    folder, name = os.path.split(path)
    return (
        os.path.join(folder, name[1:].rsplit(".", 2)[0])
        if name.startswith(".") and name.endswith(".tmp")
        else path
    )


def read_of(key: str) -> tuple[str, str]:
    """The attribute that a read of a config key looks up."""
    section, _, rest = key.partition(".")
    annotation = schema.Config.model_fields[section].annotation
    if rest and isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation.__name__, rest.split(".")[0]
    return "Config", section


def test_an_undeclared_key_cannot_be_read() -> None:
    part = schema_part("comparison.alpha")
    assert part.comparison.alpha == 0.05
    with pytest.raises(
        AttributeError,
        match=r"^'tests' of HeldOutSequence is read but not declared; add it to the step's "
        r"sections$",
    ):
        _ = part.comparison.tests
    with pytest.raises(
        AttributeError,
        match=r"^'seeds' of Config is read but not declared; add it to the step's sections$",
    ):
        _ = part.seeds
    with pytest.raises(KeyError):
        schema_part("scenarios.F1").scenarios["F2"]


def test_a_section_is_whole_even_if_a_key_in_it_is_declared_too() -> None:
    for keys in (("campaign", "campaign.tests"), ("campaign.tests", "campaign")):
        assert schema_part(*keys).campaign == compose("default", []).campaign


def schema_part(*keys: str) -> schema.Config:
    return declared(compose("default", []), keys)


def test_the_profile_gives_threads_to_the_steps_that_take_them() -> None:
    threads = yaml.safe_load((ROOT / "profiles/default/config.yaml").read_text())["set-threads"]
    assert set(threads) == {name for name in step_names() if step_of(name).parallel}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["step", "measure"], "stopped; finished tests are kept, and the same command resumes"),
        (["versions"], "stopped"),
    ],
)
def test_ctrl_c_ends_a_command_in_one_line(
    words: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.commands.step.run", interrupted)
    monkeypatch.setattr("pipeline.commands.versions.run", interrupted)
    assert main(words) == 130
    assert capsys.readouterr().err == f"blindspot {' '.join(words)}: {message}\n"


@pytest.mark.parametrize(
    ("step", "message"),
    [("retrain", "'base' is not retrained"), ("export", "'base' is no tested detector")],
)
def test_a_version_that_a_step_cannot_make_is_named(
    step: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert StudyFolder.composed(tmp_path, "smoke").run(step, version="base") == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["render-base"], "render-base: a step of a study; type: python -m pipeline step render-"),
        (["step", "define-space", "--scenario", "F99"], "step define-space: --scenario: there is"),
    ],
)
def test_a_step_has_a_door_of_its_own(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with chdir(StudyFolder.composed(tmp_path, "smoke").root):
        assert main(words) == 2
    assert capsys.readouterr().err.startswith(f"blindspot {message}")


def test_a_command_named_like_a_step_does_not_run_the_step(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["campaign", "--kind", "campaigns", "--seed", "0"])
    assert exit_.value.code == 2
    assert "the step of a study is `step campaign`" in capsys.readouterr().err


def test_the_steps_are_listed_with_their_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["step"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(step_names())
    assert "render-base          Render the random base training set." in lines
