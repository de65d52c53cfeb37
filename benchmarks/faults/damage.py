"""Flips random bits in the artefacts of a finished study, and tells who sees them.

The study is a tiny one on the analytic simulator, with a model version and a few images beside it. Each flip changes one bit of one file,
which is then read the way the steps read it, and compared with its stamp as `verify` does.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.report import Row
from pipeline.artefacts import stamps, tables
from pipeline.artefacts.comparison_results import Comparison, read_changes
from pipeline.artefacts.dataset import Record, read_dataset, write_image, write_truth
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.model_card import read_card, read_curve
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.white_box_results import WhiteBoxMeasures
from pipeline.config.composing import compose
from pipeline.contract import order_of, perform
from pipeline.core.lineage import VERSION_FILES
from pipeline.core.truth import Truth
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of
from pipeline.detectors.yolo.weights import load_weights
from pipeline.errors import InputError
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.stamping import Stamps

SHIPPED = Path(__file__).resolve().parents[2] / "models" / "uniform"
OVERRIDES = [
    *(
        "simulator=analytic",
        "detector=oracle",
        "goal=detectors",
        "+tested.one=one.onnx",
        "+tested.other=other.onnx",
        "held_out=[F1star]",
    ),
    *(
        "search=[F1]",
        "strategies=[random]",
        "seeds=[0]",
        "campaign.tests=20",
        "comparison.tests=20",
        "report.replays=0",
    ),
    *("comparison.second_iou=null", "base.weights=models/uniform"),
]
IMAGES = 4
READERS: dict[str, Callable[[Path], Any]] = {
    "tests.parquet": tables.read_tests,
    "comparison.parquet": tables.read_tests,
    "second_iou.parquet": tables.read_tests,
    "signals.parquet": tables.read_signals,
    "detections.parquet": tables.read_detections,
    "frames.parquet": tables.read_frames,
    "timings.parquet": tables.read_timings,
    "space/*.json": read_space,
    "measures.json": lambda path: read(path, Measures),
    "comparison.json": lambda path: read(path, Comparison),
    "regions/*/*.json": lambda path: read(path, FailureRegions),
    "white_box.json": lambda path: read(path, WhiteBoxMeasures),
    "changes.csv": read_changes,
    "filter/*/*.csv": read_filter,
    "model.json": read_card,
    "weights.safetensors": load_weights,
    "model.onnx": OnnxDetector,
    "curve.csv": read_curve,
    "truth.coco.json": lambda path: read_dataset(path.parent, "train"),
    "images/train/*.jpg": lambda path: read_dataset(path.parents[2], "train"),
}
"""How the steps read each kind of file; no step reads the others, such as pages and plots."""


def damage(flips: int, seed: int) -> list[Row]:
    """A row for each kind of file; a flip that nobody sees is wrong."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        counts = damaged(tiny_study(), flips, np.random.default_rng(seed))
    return [
        Row(
            "bit flip",
            kind,
            counts[kind, "flips"],
            counts[kind, "unseen"],
            {
                who: counts[kind, way]
                for who, way in (
                    ("seen by readers", "read"),
                    ("seen by verify", "verify"),
                    ("unseen", "unseen"),
                )
            },
        )
        for kind in sorted({kind for kind, _ in counts})
    ]


def tiny_study() -> Path:
    """A finished study in the working directory; returns its folder."""
    Path("models").symlink_to(SHIPPED.parent)
    for name in ("one.onnx", "other.onnx"):  # The oracle needs none.
        Path(name).write_text(name)
    jobs = Jobs(compose("default", OVERRIDES), step_names())
    stamps = Stamps(jobs)
    for target, _ in jobs.in_order():
        wildcards = dict(target.wildcards)
        perform(
            order_of(target.step, jobs.config, wildcards, stamps.stamp(target.step, wildcards)),
            jobs.config,
        )
    root = Path(jobs.folders.root)
    shutil.copytree(SHIPPED, root / "models/base", ignore=shutil.ignore_patterns("README.md"))
    onnx_of(root / "models/base", root / "models/base")
    stamp(
        root / "models/base/model.json.stamp",
        *(root / "models/base" / name for name in VERSION_FILES.values()),
    )
    _images(root / "base_set")
    return root


def stamp(path: Path, *outputs: Path) -> None:
    """Stamp files that no step made."""
    path.write_text(stamps.made(path, "benchmark", outputs).text())


def _images(root: Path) -> None:
    """A data set of noise."""
    rng, truth = (
        np.random.default_rng(0),
        Truth((20.0, 10.0, 40.0, 50.0), (20.0, 10.0, 40.0, 50.0), 800, 800, 30.0),
    )
    records = [Record("train", index, 96, 64, truth) for index in range(IMAGES)]
    for record in records:
        write_image(
            root,
            record.split,
            record.index,
            rng.integers(0, 255, (64, 96, 3), dtype=np.uint8),
            truth,
        )
    write_truth(root, records)
    stamp(
        root / "truth.coco.json.stamp",
        *(root / name for name in ("truth.coco.json", "dataset.yaml", "images", "labels")),
    )


def damaged(root: Path, flips: int, rng: np.random.Generator) -> Counter[tuple[str, str]]:
    """Flip single bits, one file after the other in turn; counts by kind of file and by who sees the flip."""
    files = list(artefacts(root))
    counts: Counter[tuple[str, str]] = Counter()
    for flip in range(flips):
        kind, file = files[flip % len(files)]
        whole = file.read_bytes()
        file.write_bytes(flipped(whole, int(rng.integers(8 * len(whole)))))
        seen = {
            "read": kind in READERS and not readable(kind, file),
            "verify": any(found == file for found, _ in stamps.damaged(root)),
        }
        file.write_bytes(whole)
        counts.update([(kind, "flips"), *((kind, way) for way, it in seen.items() if it)])
        counts.update([(kind, "unseen")] if not any(seen.values()) else [])
    return counts


def artefacts(root: Path) -> Iterator[tuple[str, Path]]:
    """Every file of a study that is not empty, with its kind: a key of `READERS`, or its suffix."""
    for file in sorted(
        path
        for path in root.rglob("*")
        if path.is_file() and path.stat().st_size and "journal" not in path.parts
    ):
        yield next((kind for kind in READERS if file.match(kind)), f"*{file.suffix}"), file


def readable(kind: str, file: Path) -> bool:
    """Whether a file's reader takes it; any other error than one that names the file ends the benchmark."""
    try:
        READERS[kind](file)
    except InputError as error:
        if str(file) not in str(error):
            raise
        return False
    return True


def flipped(data: bytes, bit: int) -> bytes:
    """The data with one other bit."""
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
