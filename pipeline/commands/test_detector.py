"""Command `test-detector`: finds the failures of any detectors, and compares several; trains nothing."""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.artefacts.files import sha256, write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.run_lock import hold
from pipeline.commands.verify import withdraw_damaged
from pipeline.config.arguments import whole
from pipeline.config.components import make_detector
from pipeline.config.composing import compose, dump, validate
from pipeline.config.project import typed
from pipeline.config.schema import Config
from pipeline.contract import VERDICT_FOLLOWS
from pipeline.core.lineage import VERSION_FILES, WEIGHTS_SUFFIX
from pipeline.detectors.function import source_of
from pipeline.errors import InputError, SimulationError

if TYPE_CHECKING:
    from pipeline.artefacts.calibration_results import DetectorCalibration
    from pipeline.execution.worker import Calls

WORDS = """ONNX files (ours, YOLOv5, YOLOv8/11 or end-to-end), weights.safetensors of our versions, or what the study's detector takes; and
Hydra overrides, such as campaign.tests=40 search=[F1,F5] detector=mine"""
LONGEST_STEM = 40
"""Characters of a file's name that a detector's name keeps."""
HELP = "Find the failures of any detector, and compare several; trains nothing."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="+", metavar="FILE|key=value", help=WORDS)
    parser.add_argument(
        "--study",
        default="default",
        help="study with the scenarios, strategies and budgets (default: %(default)s)",
    )
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help="calibrate each detector's confidences on rendered images first",
    )
    parser.add_argument("--cores", type=whole(1), help="cores to use (default: all)")


def run(options: argparse.Namespace) -> int:
    """Compose the study, check every detector on three images, and let Snakemake run it; the same call resumes it."""
    # pathlib would raise an error for a word that is too long for a file's name.
    overrides = [word for word in options.words if "=" in word and not os.path.isfile(typed(word))]
    files = [typed(word) for word in options.words if word not in overrides]
    chosen = compose(
        options.study, ["goal=base", *overrides]
    )  # Nothing is retrained, so the strategies need not feed the study's arms.
    files = files or _function_file(chosen)
    check(chosen, files)
    lock = hold("test-detector")
    config = study_of(files, chosen, options.calibrate)
    folders = Folders(config)
    params = Path(folders.root, "params.yaml")
    write_bytes(
        params,
        dump(
            config,
            f"python -m pipeline test-detector {' '.join(options.words)}{' --calibrate' * options.calibrate}",
        ).encode(),
    )
    withdraw_damaged(Path(folders.root))
    cores = "all" if options.cores is None else str(options.cores)
    environment = {**os.environ, VERDICT_FOLLOWS: "1"}
    command = [sys.executable, "-m", "snakemake", "--configfile", str(params), "--cores", cores]
    done = subprocess.run(
        command, env=environment, pass_fds=lock, check=False
    )  # If this process is killed, Snakemake lives on.
    if done.returncode:
        return done.returncode
    print(table(config))
    print(f"Next: open {' '.join(goal for goal in folders.goals if goal.endswith('.html'))}")
    return 0


def _function_file(config: Config) -> list[Path]:
    """The file of the function that is the detector, which needs no other; InputError if the detector is none."""
    if "function" not in config.detector:
        raise InputError("name the file of a detector, as in `test-detector best.onnx`")
    return [source_of(config.detector["function"])]


def study_of(files: Sequence[Path], chosen: Config, calibrate: bool = False) -> Config:
    """The study of some detectors, named after the first and the content of all: many exports are called best.onnx.

    chosen: the study whose scenarios, strategies and budgets it takes. calibrate: whether their confidences are calibrated first.
    """
    digests = [sha256(path) for path in files]
    titles = [
        path.resolve().parent.name
        if path.suffix == WEIGHTS_SUFFIX
        else path.name.removesuffix(".onnx")
        for path in files
    ]
    stems = [
        re.sub("[^A-Za-z0-9]", "_", title).strip("_")[:LONGEST_STEM] or "detector"
        for title in titles
    ]
    names = [
        stem if stems.count(stem) == 1 else f"{stem}_{digest[:4]}"
        for stem, digest in zip(stems, digests, strict=True)
    ]
    if len(set(names)) < len(names):
        raise InputError(
            f"expected different detectors, got {', '.join(map(str, files))} with the same content"
        )
    together = (
        digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    )
    tested = dict(zip(names, map(str, files), strict=True))
    named = {
        "study": f"{names[0].lower()}-{together[:8]}",
        "goal": "detectors",
        "tested": tested,
        "calibrate": calibrate,
    }
    return validate({**chosen.model_dump(mode="json"), **named}, "conf/")


def check(config: Config, models: Sequence[Path]) -> None:
    """Run each detector on three images in a process of its own; InputError that names the first rule of its contract that one violates."""
    from pipeline.execution.worker import Broken, Pool

    with Pool(1, partial(_checker, config), config.limits) as pool:
        for index, outcome in pool.run(models):
            if isinstance(outcome, Broken):
                raise InputError(f"{models[index]}: {outcome.reason} on the first images")


def _checker(config: Config, calls: Calls) -> Callable[[Path], None]:
    from pipeline.execution.guarded import GuardedDetector
    from pipeline.testing import check_detector

    width, height = int(config.camera.get("width", 320)), int(config.camera.get("height", 192))

    def check_one(model: Path) -> None:
        try:
            with tempfile.TemporaryDirectory() as folder:
                file = _exported(model, Path(folder)) if model.suffix == WEIGHTS_SUFFIX else model
                check_detector(
                    GuardedDetector(make_detector(config.detector, file), calls), width, height
                )
        except AssertionError as error:
            raise InputError(f"{model}: {error}") from error
        except SimulationError as error:
            raise InputError(str(error)) from error
        except InputError:
            raise
        except Exception as error:  # A foreign class may raise anything.
            raise InputError(
                f"{model}: the detector cannot be made: {type(error).__name__}: {error}"
            ) from error

    return check_one


def _exported(weights: Path, folder: Path) -> Path:
    """The ONNX file of a version of ours, made in `folder`."""
    from pipeline.detectors.yolo.export import export_version

    export_version(weights, weights.with_name(VERSION_FILES["card"]), folder / "model.onnx")
    return folder / "model.onnx"


def table(config: Config) -> str:
    """Failures by detector, scenario and strategy, unnecessary braking, the regions and, for several detectors, the verdict. Errors are in
    no rate."""
    from pipeline.artefacts.calibration_results import DetectorCalibration
    from pipeline.artefacts.comparison_results import Comparison
    from pipeline.artefacts.region_results import FailureRegions
    from pipeline.artefacts.results import read
    from pipeline.artefacts.search_results import Measures
    from pipeline.report.failure_tables import base_rate_sentence, braking_in_search
    from pipeline.report.formats import aligned, percent
    from pipeline.report.verdict import verdict_table

    folders = Folders(config)
    counted = f"{'tests':>6}{'errors':>8}{'fail':>6}{'contact':>9}{'late':>6}{'false positives':>17}{'unnecessary':>13}"
    width = 2 + max(8, *map(len, config.tested))
    lines = [f"{'detector':{width}}{'scenario':10}{'strategy':12}{counted}   failure rate"]
    measures = read(Path(folders.root, "measures.json"), Measures)
    for row in measures.strategies:
        modes = row.modes
        counts = f"{row.tests:>6}{row.errors:>8}{row.failures:>6}{modes.contact:>9}{modes.late:>6}{modes.false_positives:>17}"
        counts += f"{modes.false_activation:>13}"
        lines.append(
            f"{row.version:{width}}{row.scenario:10}{row.strategy:12}{counts}   {percent(row.rate)}"
        )
    if config.audited:
        lines += [base_rate_sentence(measures.of(version).base_rates) for version in config.tested]
    for path in folders.calibrations(config.tested):
        lines.append(_calibrated(read(Path(path), DetectorCalibration)))
    if braking := braking_in_search(measures):
        lines += ["", "Unnecessary braking\n", *aligned(braking), ""]
    for version in config.tested:
        for scenario in config.search:
            for region in read(Path(folders.regions(version, scenario)), FailureRegions).regions:
                inside = f"{region.failures_inside} of {region.support} tests inside fail"
                lines.append(f"{version} on {scenario}, {region.name}: {region.rule} ({inside})")
                lines += [f"  {region.why.sentence}"] if region.why else []
    if len(config.tested) > 1:
        comparison = Path(folders.compared["comparison"])
        lines += ["", verdict_table(read(comparison, Comparison))]
    return "\n".join(lines)


def _calibrated(found: DetectorCalibration) -> str:
    if not found.fitted:
        return f"{found.version} could not be calibrated: {found.right} of {found.detections} detections are correct"
    before, after = found.errors["uncalibrated"], found.errors["calibrated"]
    return f"{found.version} is calibrated on {found.images} images: expected calibration error {before:.3f} before, {after:.3f} after"
