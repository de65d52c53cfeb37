"""Command `test-detector`: finds the failures of any detectors and compares them."""

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

WORDS = """ONNX files (ours, YOLOv5, YOLOv8/11 or end-to-end), weights.safetensors of our versions,
or what the study's detector takes; and Hydra overrides, such as campaign.tests=40 search=[F1,F5]
detector=mine"""
LONGEST_STEM = 40
"""Characters of a file's name that a detector's name keeps."""
HELP = "Find the failures of any detector, and compare several; trains nothing."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
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
    """Compose the study, check every detector on three images, and let Snakemake run it.

    The same call resumes it.
    """
    # pathlib would raise an error for a word that is too long for a file's name.
    overrides = [word for word in options.words if "=" in word and not os.path.isfile(typed(word))]
    files = [typed(word) for word in options.words if word not in overrides]
    # Nothing is retrained, so the strategies need not feed the study's arms.
    chosen = compose(options.study, ["goal=base", *overrides])
    if not files:
        # A function in a Python file may be the detector.
        if "function" not in chosen.detector:
            raise InputError("name the file of a detector, as in `test-detector best.onnx`")
        files = [source_of(chosen.detector["function"])]
    check(chosen, files)
    lock = hold("test-detector")
    config = study_of(files, chosen, options.calibrate)
    folders = Folders(config)
    params = Path(folders.root, "params.yaml")
    call = f"python -m pipeline test-detector {' '.join(options.words)}"
    write_bytes(params, dump(config, call + " --calibrate" * options.calibrate).encode())
    withdraw_damaged(Path(folders.root))
    cores = "all" if options.cores is None else str(options.cores)
    environment = {**os.environ, VERDICT_FOLLOWS: "1"}
    command = [sys.executable, "-m", "snakemake", "--configfile", str(params), "--cores", cores]
    # If this process is killed, Snakemake lives on.
    done = subprocess.run(command, env=environment, pass_fds=lock, check=False)
    if done.returncode:
        return done.returncode
    print(table(config))
    print(f"Next: open {' '.join(goal for goal in folders.goals if goal.endswith('.html'))}")
    return 0


def study_of(files: Sequence[Path], chosen: Config, calibrate: bool = False) -> Config:
    """The study of some detectors.

    It is named after the first and the content of all: many exports are called best.onnx.

    Args:
        files: the detectors' files, at least one.
        chosen: the study whose scenarios, strategies and budgets it takes.
        calibrate: whether the detectors' confidences are calibrated first.

    Raises:
        InputError: two detectors have the same content.
    """
    digests = [sha256(path) for path in files]
    stems = []
    for path in files:
        own_version = path.suffix == WEIGHTS_SUFFIX
        title = path.resolve().parent.name if own_version else path.name.removesuffix(".onnx")
        stems.append(re.sub("[^A-Za-z0-9]", "_", title).strip("_")[:LONGEST_STEM] or "detector")
    names = [
        stem if stems.count(stem) == 1 else f"{stem}_{digest[:4]}"
        for stem, digest in zip(stems, digests, strict=True)
    ]
    if len(set(names)) < len(names):
        raise InputError(
            f"expected different detectors, got {', '.join(map(str, files))} with the same content"
        )
    content = digests[0]
    if len(digests) > 1:
        content = hashlib.sha256("".join(digests).encode()).hexdigest()
    changes = {
        "study": f"{names[0].lower()}-{content[:8]}",
        "goal": "detectors",
        "tested": dict(zip(names, map(str, files), strict=True)),
        "calibrate": calibrate,
    }
    return validate({**chosen.model_dump(mode="json"), **changes}, "conf/")


def check(config: Config, models: Sequence[Path]) -> None:
    """Run each detector on three images in a separate process.

    Raises:
        InputError: a detector violates its contract; the message names the first violated rule.
    """
    from pipeline.execution.worker import Broken, Pool

    with Pool(1, partial(_checker, config), config.limits) as pool:
        for index, outcome in pool.run(models):
            if isinstance(outcome, Broken):
                raise InputError(f"{models[index]}: {outcome.reason} on the first images")


def _checker(config: Config, calls: Calls) -> Callable[[Path], None]:
    """A function that checks the detector of a file, in a worker process."""
    from pipeline.detectors.yolo.export import export_version
    from pipeline.execution.guarded import GuardedDetector
    from pipeline.testing import check_detector

    width, height = int(config.camera.get("width", 320)), int(config.camera.get("height", 192))

    def check_file(model: Path) -> None:
        try:
            with tempfile.TemporaryDirectory() as folder:
                file = model
                if model.suffix == WEIGHTS_SUFFIX:
                    file = Path(folder, "model.onnx")
                    export_version(model, model.with_name(VERSION_FILES["card"]), file)
                detector = GuardedDetector(make_detector(config.detector, file), calls)
                check_detector(detector, width, height)
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

    return check_file


def table(config: Config) -> str:
    """Failures by detector, scenario and strategy, unnecessary braking and the regions.

    For several detectors, the verdict follows. Errors count in no rate.
    """
    from pipeline.artefacts.calibration_results import DetectorCalibration
    from pipeline.artefacts.comparison_results import Comparison
    from pipeline.artefacts.region_results import FailureRegions
    from pipeline.artefacts.results import read
    from pipeline.artefacts.search_results import Measures
    from pipeline.report.failure_tables import base_rate_sentence, braking_in_search
    from pipeline.report.formats import aligned, percent
    from pipeline.report.verdict import verdict_table

    folders = Folders(config)
    counted = f"{'tests':>6}{'errors':>8}{'fail':>6}{'contact':>9}{'late':>6}"
    counted += f"{'false positives':>17}{'unnecessary':>13}"
    width = 2 + max(8, *map(len, config.tested))
    lines = [f"{'detector':{width}}{'scenario':10}{'strategy':12}{counted}   failure rate"]
    measures = read(Path(folders.root, "measures.json"), Measures)
    for row in measures.strategies:
        modes = row.modes
        counts = f"{row.tests:>6}{row.errors:>8}{row.failures:>6}{modes.contact:>9}{modes.late:>6}"
        counts += f"{modes.false_positives:>17}{modes.false_activation:>13}"
        search = f"{row.version:{width}}{row.scenario:10}{row.strategy:12}"
        lines.append(f"{search}{counts}   {percent(row.rate)}")
    if config.audited:
        lines += [base_rate_sentence(measures.of(version).base_rates) for version in config.tested]
    for path in folders.calibrations(config.tested):
        lines.append(calibration_sentence(read(Path(path), DetectorCalibration)))
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


def calibration_sentence(calibration: DetectorCalibration) -> str:
    """How well a detector is calibrated, or why it is not."""
    version = calibration.version
    if not calibration.fitted:
        correct = f"{calibration.right} of {calibration.detections} detections are correct"
        return f"{version} could not be calibrated: {correct}"
    before, after = calibration.errors["uncalibrated"], calibration.errors["calibrated"]
    change = f"expected calibration error {before:.3f} before, {after:.3f} after"
    return f"{version} is calibrated on {calibration.images} images: {change}"
