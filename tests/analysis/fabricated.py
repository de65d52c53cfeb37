"""A small study fabricated by formula, for tests of the steps after the campaigns."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from onnx import TensorProto, helper, numpy_helper

from pipeline.artefacts.dataset import encode_jpeg
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import CurvePoint, ModelCard, write_card, write_curve
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import ScenarioInfo, write_space
from pipeline.artefacts.tables import (
    DETECTIONS,
    FRAMES,
    TESTS,
    write_detections,
    write_frames,
    write_signals,
    write_tests,
)
from pipeline.artefacts.white_box_results import WhiteBoxMeasures, WhiteBoxSet
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.contract import Files, order_of, perform
from pipeline.core.identity import CampaignId
from pipeline.core.samplers.pairwise import PairwiseSampler
from pipeline.core.signals import SIDES, SIGNALS
from pipeline.core.space import Floats, Space

VERSIONS = ("base", "control", "random", "adaptive")
OVERRIDES = [
    "simulator=analytic",
    "detector=oracle",
    "seeds=[0,1]",
    "campaign.tests=60",
    "comparison.tests=60",
    "comparison.seed=0",
]
OVERRIDES += ["retraining.rounds=1", "retraining.seeds=[0]"]
# A version fails at night in fog above this value.
FOG_FROM = {"base": 12.0, "control": 18.0, "random": 50.0, "adaptive": 88.0}


IMAGES = [
    encode_jpeg(np.random.default_rng(step).integers(0, 255, (48, 80, 3), dtype=np.uint8))
    for step in range(5)
]
TRUTH = (30.0, 10.0, 42.0, 38.0)
"""Box around every fabricated pedestrian."""


def make_tests(
    space: Space, keys: dict[str, Any], points: Floats, fog_from: float = 45.0
) -> pd.DataFrame:
    """Rows of tests.parquet.

    A test fails at night in fog from `fog_from` on; one test in 50 is an error.
    """
    fog = points[:, space.names.index("fog")]
    altitude = points[:, space.names.index("sun_altitude")]
    near = np.maximum((fog_from - fog) / 60, (altitude - 2) / 60)
    failed = near <= 0
    error = (np.arange(len(points)) % 50 == 49) & ~failed
    adjusted = np.where(
        failed, 0.02 + 0.05 * (np.arange(len(points)) % 2), 0.12 + np.clip(near, 0, 1.5)
    )
    modes = np.where(
        failed, np.array(["contact", "late", "false_positives"])[np.arange(len(points)) % 3], "none"
    )
    columns: dict[str, Any] = {column.name: 0 for column in TESTS}
    table = pd.DataFrame(columns, index=range(len(points)))
    table = table.assign(
        **keys,
        test_id=[str(test) for test in CampaignId(**keys).tests(len(points))],
        index=np.arange(len(points)),
        batch=np.arange(len(points)) // 20,
        status=np.where(error, "error", "ok"),
        reason=np.where(error, "planted", ""),
        adj_ttc_s=np.where(error, np.nan, adjusted),
        ttc_s=np.where(error, np.nan, adjusted),
        failure=failed,
        failure_mode=modes,
        cause=np.select(
            [modes == "none", modes == "false_positives", np.arange(len(points)) % 2 == 1],
            ["none", "false_positives", "not_solvable"],
            "box",
        ),
        contact=modes == "contact",
    )
    for column, variable in enumerate(space.variables):
        table[variable.name] = [variable.decode(value) for value in points[:, column]]
    return table


def adaptive_points(space: Space, count: int, rng: np.random.Generator) -> Floats:
    """Points that lie more and more at night in fog."""
    points = space.sample(count, rng)
    late = np.arange(count) >= 20
    points[late, space.names.index("fog")] = rng.uniform(40, 100, late.sum())
    points[late, space.names.index("sun_altitude")] = rng.uniform(-20, 15, late.sum())
    return points


def make_frames(tests: pd.DataFrame) -> pd.DataFrame:
    """Rows of frames.parquet: per test an empty, far, faint, partly hidden and good frame."""
    one_test = pd.DataFrame(
        {
            "step": range(5),
            "visible_pixels": [0, 12, 200, 60, 400],
            "whole_pixels": [0, 12, 200, 900, 400],
            "contrast": [0.0, 30.0, 4.0, 30.0, 30.0],
            "image": IMAGES,
        }
    )
    frames = pd.concat([one_test.assign(test_id=test) for test in tests["test_id"]])
    frames = frames.reset_index(drop=True)
    for column in FRAMES:
        if column.name not in frames:
            frames[column.name] = 0
    shown = frames["visible_pixels"] > 0
    for side, value in zip(SIDES, TRUTH, strict=True):
        frames[f"visible_{side}"] = np.where(shown, value, np.nan)
    return frames[[column.name for column in FRAMES]]


def make_detections(frames: pd.DataFrame) -> pd.DataFrame:
    """Rows of detections.parquet: per frame a box that is reported and one that is not."""
    rows = pd.DataFrame(
        {"test_id": np.repeat(frames["test_id"], 2), "step": np.repeat(frames["step"], 2)}
    ).reset_index(drop=True)
    for side, value in zip(SIDES, TRUTH, strict=True):
        rows[side] = value + 2.0
    return rows.assign(score=np.tile([0.9, 0.3], len(frames)), in_path=True)[
        [column.name for column in DETECTIONS]
    ]


def make_signals(tests: pd.DataFrame) -> pd.DataFrame:
    """Rows of signals.parquet: two steps per test.

    The pedestrian shows in the first, 20 m away in even tests and 2 m away in odd ones.
    """
    rows = pd.DataFrame({"test_id": np.repeat(tests["test_id"], 2), "step": [0, 1] * len(tests)})
    for signal in SIGNALS:
        rows[signal.name] = signal.kind(0)
    first = rows["step"] == 0
    near = np.repeat(tests["index"].to_numpy() % 2 == 1, 2)
    return rows.assign(
        ego_speed_mps=10.0,
        conflict_distance_m=np.where(near, 2.0, 20.0),
        visible_pixels=np.where(first, 500, 0),
        contrast=np.where(first, 40.0, 0.0),
    )


def make_onnx(score: float) -> bytes:
    """A detector that reports one person with this score in the middle of every image."""
    image = helper.make_tensor_value_info("image", TensorProto.UINT8, ["images", 192, 320, 3])
    outputs = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
        for name, shape in {"boxes": [1, 1, 4], "scores": [1, 1]}.items()
    ]
    values = {
        "boxes": np.array([[[150, 80, 170, 120]]], np.float32),
        "scores": np.array([[score]], np.float32),
    }
    nodes = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))
        for name, value in values.items()
    ]
    model = helper.make_model(
        helper.make_graph(nodes, "one", [image], outputs),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=9,
    )
    return bytes(model.SerializeToString())


@cache
def default_config() -> Config:
    """The config of a fabricated study that chooses none."""
    return compose("default", OVERRIDES)


@dataclass
class FabricatedStudy:
    """A study in a separate folder: fabricated campaigns and model versions, usual layout."""

    folder: Path
    config: Config = field(default_factory=default_config)

    @property
    def files(self) -> Folders:
        return Folders(self.config)

    @property
    def root(self) -> Path:
        return self.folder / self.files.root

    def paths(self, files: Sequence[str]) -> list[Path]:
        return [self.folder / path for path in files]

    @property
    def search_tests(self) -> list[Path]:
        return self.paths(self.files.search("tests.parquet"))

    @property
    def held_out_tests(self) -> list[Path]:
        return self.paths(self.files.held_out("tests.parquet"))

    @property
    def cards(self) -> list[Path]:
        return self.paths(self.files.models("model.json"))

    @property
    def regions(self) -> list[Path]:
        return self.paths([self.files.regions("base", name) for name in self.config.search])

    def run(self, step: str, reads: Mapping[str, Files] | None = None, **wildcards: str) -> None:
        """Perform a step. reads: files that replace those of the study."""
        with chdir(self.folder):
            order = order_of(step, self.config, wildcards, "made")
            perform(replace(order, reads={**order.reads, **(reads or {})}), self.config)

    def make(self) -> FabricatedStudy:
        """Write spaces, campaigns and model versions."""
        return self._copy(_made()) if self.config is default_config() else self.write()

    def make_analysed(self) -> FabricatedStudy:
        """`make` and `analyse`, for the default config."""
        return self._copy(_analysed())

    def _copy(self, source: TemporaryDirectory[str]) -> FabricatedStudy:
        shutil.copytree(source.name, self.folder, dirs_exist_ok=True)
        return self

    def write(self) -> FabricatedStudy:
        """`make`, without the copy that the process keeps."""
        for name in (*self.config.search, *self.config.held_out):
            scenario = self.config.scenarios[name]
            worlds = (world for _, world in scenario.worlds)
            info = ScenarioInfo(
                name,
                scenario.label,
                scenario.description,
                8084,
                *worlds,
                asks_to_brake=scenario.asks_to_brake,
            )
            write_space(self.folder / self.files.space(name), info, self.config.space(name))
        for path in self.search_tests:
            self._search(path)
        for name in self.config.held_out:
            self._held_out(name)
        for rank, (version, path) in enumerate(zip(VERSIONS, self.cards, strict=True)):
            self._model(version, path, rank)
        sets = [
            WhiteBoxSet(
                name=name, images=9, neuron=1, multisection=0.5, strong=0.1, top=0.4, pairs=0.9
            )
            for name in self.config.strategies
        ]
        write(
            self.root / "white_box.json",
            WhiteBoxMeasures(layers=2, neurons=48, training_images=20, sets=tuple(sets)),
        )
        return self

    def analyse(self) -> FabricatedStudy:
        """Run the steps from `measure` to `compare`."""
        for name in self.config.search:
            self.run("cluster", version="base", scenario=name)
        for strategy in self.config.strategies:
            self.run("filter", kind="filter", strategy=strategy, version="base")
        self.run("measure")
        self.run("compare")
        return self

    def _search(self, path: Path) -> None:
        scenario, strategy, version, seed = path.parts[-5:-1]
        space, count = self.config.space(scenario), self.config.campaign.tests
        rng = np.random.default_rng([int(seed), len(strategy), ord(scenario[-1])])
        points = (
            space.sample(count, rng) if strategy == "random" else adaptive_points(space, count, rng)
        )
        keys = {"scenario": scenario, "strategy": strategy, "version": version, "seed": int(seed)}
        tests = make_tests(space, keys, points)
        write_tests(path, tests, space)
        frames = make_frames(tests.head(6))
        write_frames(path.with_name("frames.parquet"), frames)
        write_detections(path.with_name("detections.parquet"), make_detections(frames))
        write_signals(path.with_name("signals.parquet"), make_signals(tests))

    def _held_out(self, name: str) -> None:
        space, count = self.config.space(name), self.config.comparison.tests
        sampler = PairwiseSampler(space, 0, batch_size=count)
        points = sampler.ask()
        for path in (path for path in self.held_out_tests if path.parts[-5] == name):
            keys = {"scenario": name, "strategy": "pairwise", "version": path.parts[-3], "seed": 0}
            tests = make_tests(space, keys, points, FOG_FROM[path.parts[-3]])
            write_tests(path, tests, space)
            write_tests(path.with_name("second_iou.parquet"), tests, space)

    def _model(self, version: str, path: Path, rank: int) -> None:
        card = ModelCard(
            version=version,
            parent=None if version == "base" else "base",
            architecture={"widths": [16, 32]},
            parameters=1_000_000,
            input_size=(320, 192),
            seed=0,
            data={"base_set": "ab" * 32},
            training={"iterations": 100.0 + rank},
            metrics={
                "precision": 0.9,
                "recall": 0.84,
                "ap50": 0.88 + 0.01 * rank,
                "ap50_95": 0.5,
                "false_positives_an_image": 0.08,
            },
            calibration={"slope": 1.0, "offset": 0.0},
            reliability={
                name: ((0.2, 0.3, 20), (0.9, 0.85, 80)) for name in ("uncalibrated", "calibrated")
            },
            weights_sha256=f"{rank}" * 64,
            towns=(),
            people=(),
        )
        write_card(path, card)
        path.with_name("weights.safetensors").write_bytes(f"weights {rank}".encode())
        path.with_name("model.onnx").write_bytes(make_onnx(rank / 10))
        write_curve(
            path.with_name("curve.csv"),
            [CurvePoint(10, 3e-4, 1.5, 0.3, 0.8), CurvePoint(20, 1e-5, 1.2, 0.2, 0.85)]
            if rank
            else [],
        )


@cache
def _made() -> TemporaryDirectory[str]:
    """The study of the default config, written once in a process: many tests begin with it."""
    store = TemporaryDirectory()
    FabricatedStudy(Path(store.name)).write()
    return store


@cache
def _analysed() -> TemporaryDirectory[str]:
    store = TemporaryDirectory()
    FabricatedStudy(Path(store.name)).make().analyse()
    return store
