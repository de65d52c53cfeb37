"""Flips random bits in the artefacts of a finished study, and counts who sees them.

The study is a tiny one on the analytic simulator, with a model version and a few images beside it.
Each flip changes one bit of one file, which is then read the way the steps read it, and compared
with its stamp as `verify` does.
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
    *("simulator=analytic", "detector=oracle", "goal=detectors"),
    *("+tested.one=one.onnx", "+tested.other=other.onnx", "held_out=[F1star]"),
    *("search=[F1]", "strategies=[random]", "seeds=[0]", "campaign.tests=20"),
    *("comparison.tests=20", "report.replays=0", "comparison.second_iou=null"),
    "base.weights=models/uniform",
]
READ, VERIFIED, UNSEEN = "seen by readers", "seen by verify", "unseen"
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
    rows = []
    for kind in sorted({kind for kind, _ in counts}):
        outcomes = {way: counts[kind, way] for way in (READ, VERIFIED, UNSEEN)}
        rows.append(Row("bit flip", kind, counts[kind, "flips"], counts[kind, UNSEEN], outcomes))
    return rows


def tiny_study() -> Path:
    """A finished study in the working directory, with a model version; returns its folder."""
    Path("models").symlink_to(SHIPPED.parent)
    for name in ("one.onnx", "other.onnx"):  # The oracle needs none.
        Path(name).write_text(name)
    jobs = Jobs(compose("default", OVERRIDES), step_names())
    today = Stamps(jobs)
    for target, _ in jobs.in_order():
        wildcards = dict(target.wildcards)
        job_stamp = today.stamp(target.step, wildcards)
        perform(order_of(target.step, jobs.config, wildcards, job_stamp), jobs.config)
    root = Path(jobs.folders.root)
    base = root / "models/base"
    shutil.copytree(SHIPPED, base, ignore=shutil.ignore_patterns("README.md"))
    onnx_of(base, base)
    stamp(base / "model.json.stamp", *(base / name for name in VERSION_FILES.values()))
    noise_images(root / "base_set")
    return root


def stamp(path: Path, *outputs: Path) -> None:
    """Stamp files that no step made."""
    path.write_text(stamps.made(path, "benchmark", outputs).text())


def noise_images(root: Path) -> None:
    """Write a data set of noise."""
    rng, box = np.random.default_rng(0), (20.0, 10.0, 40.0, 50.0)
    truth = Truth(box, box, 800, 800, 30.0)
    for index in range(IMAGES):
        image = rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)
        write_image(root, "train", index, image, truth)
    write_truth(root, [Record("train", index, 96, 64, truth) for index in range(IMAGES)])
    names = ("truth.coco.json", "dataset.yaml", "images", "labels")
    stamp(root / "truth.coco.json.stamp", *(root / name for name in names))


def damaged(root: Path, flips: int, rng: np.random.Generator) -> Counter[tuple[str, str]]:
    """Flip single bits in one file after the other; counts by kind of file and who sees it."""
    files = list(artefacts(root))
    counts: Counter[tuple[str, str]] = Counter()
    for flip in range(flips):
        kind, file = files[flip % len(files)]
        whole = file.read_bytes()
        file.write_bytes(flipped(whole, int(rng.integers(8 * len(whole)))))
        read = kind in READERS and not readable(kind, file)
        verified = file in [path for path, _ in stamps.damaged(root)]
        file.write_bytes(whole)
        counts[kind, "flips"] += 1
        counts[kind, READ] += read
        counts[kind, VERIFIED] += verified
        counts[kind, UNSEEN] += not (read or verified)
    return counts


def artefacts(root: Path) -> Iterator[tuple[str, Path]]:
    """Every file of a study that is not empty, with its kind: a key of `READERS`, or its suffix."""
    for file in sorted(root.rglob("*")):
        if file.is_file() and file.stat().st_size and "journal" not in file.parts:
            yield next((kind for kind in READERS if file.match(kind)), f"*{file.suffix}"), file


def readable(kind: str, file: Path) -> bool:
    """Whether a file's reader takes it; an error that does not name the file is raised."""
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
