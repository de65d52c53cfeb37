"""Command `test-detector`: finds the failures of any detectors, and compares several; trains nothing."""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.artefacts.files import sha256, write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.config.composing import compose, dump, validate
from pipeline.config.schema import Config
from pipeline.contract import VERDICT_FOLLOWS
from pipeline.errors import InputError, SimulationError

WORDS = """ONNX files (ours, YOLOv5, YOLOv8/11 or end to end), or what the study's detector takes; and Hydra overrides, such as
campaign.tests=40 search=[F1,F5] detector=mine"""
HELP = "Search for the failures of any detectors, and compare several; trains nothing."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="+", metavar="FILE|key=value", help=WORDS)
    parser.add_argument("--study", default="default", help="study with the scenarios, strategies and budgets (default: %(default)s)")
    parser.add_argument("--cores", type=int, help="cores to use (default: all)")


def run(options: argparse.Namespace) -> int:
    """Compose the study, check every detector on three images, and let Snakemake run it; the same call resumes it."""
    files = [Path(word) for word in options.words if "=" not in word]
    overrides = [word for word in options.words if "=" in word]
    if not files:
        raise InputError("name the file of a detector, as in `test-detector best.onnx`")
    if options.cores is not None and options.cores < 1:
        raise InputError(f"--cores must be at least 1, got {options.cores}")
    chosen = compose(options.study, overrides)
    for path in files:
        check(chosen, path)
    config = study_of(files, chosen)
    folders = Folders(config)
    params = Path(folders.root, "params.yaml")
    write_bytes(params, dump(config, f"python -m pipeline test-detector {' '.join(options.words)}").encode())
    cores = "all" if options.cores is None else str(options.cores)
    environment = {**os.environ, VERDICT_FOLLOWS: "1"}
    done = subprocess.run([sys.executable, "-m", "snakemake", "--configfile", str(params), "--cores", cores], env=environment, check=False)
    if done.returncode:
        return done.returncode
    print(table(config))
    print(f"Next: open {' '.join(goal for goal in folders.goals if goal.endswith('.html'))}")
    return 0


def study_of(files: Sequence[Path], chosen: Config) -> Config:
    """The study of some detectors, named after the first and the content of all: many exports are called best.onnx.

    chosen: the study whose scenarios, strategies and budgets it takes.
    """
    digests = [sha256(path) for path in files]
    stems = [re.sub(r"\W", "_", path.name.removesuffix(".onnx")).lstrip("_") or "detector" for path in files]
    names = [stem if stems.count(stem) == 1 else f"{stem}_{digest[:4]}" for stem, digest in zip(stems, digests, strict=True)]
    if len(set(names)) < len(names):
        raise InputError(f"expected different detectors, got {', '.join(map(str, files))} with the same content")
    together = digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    tested = dict(zip(names, map(str, files), strict=True))
    named = {"study": f"{names[0].lower()}-{together[:8]}", "goal": "detectors", "tested": tested}
    return validate({**chosen.model_dump(mode="json"), **named}, "conf/")


def check(config: Config, model: Path) -> None:
    """Run the detector on three images; InputError that names the first rule of its contract that it violates."""
    from hydra.utils import instantiate

    from pipeline.testing import check_detector

    camera = config.simulator.get("camera", {})
    width, height = int(camera.get("width", 320)), int(camera.get("height", 192))
    detector = instantiate(config.detector, _partial_=True, _convert_="all")(model=str(model))
    try:
        check_detector(detector, width, height)
    except AssertionError as error:
        raise InputError(f"{model}: {error}") from error
    except SimulationError as error:
        raise InputError(str(error)) from error
    except InputError:
        raise
    except Exception as error:  # A foreign class may raise anything.
        raise InputError(f"{model}: detect failed: {type(error).__name__}: {error}") from error


def table(config: Config) -> str:
    """Print failures by detector, scenario and strategy, the regions and, for several detectors, the verdict. Errors are in no rate."""
    from pipeline.artefacts.comparison_results import Comparison
    from pipeline.artefacts.results import FailureRegions, Measures, read
    from pipeline.report.verdict import verdict_table

    folders = Folders(config)
    counted = f"{'tests':>6}{'errors':>8}{'fail':>6}{'contact':>9}{'late':>6}{'false positives':>17}"
    width = 2 + max(8, *map(len, config.tested))
    lines = [f"{'detector':{width}}{'scenario':10}{'strategy':12}{counted}   failure rate"]
    for row in read(Path(folders.root, "measures.json"), Measures).strategies:
        rate = f"{100 * row.rate.value:.1f} % ({100 * row.rate.low:.1f} to {100 * row.rate.high:.1f})"
        counts = f"{row.tests:>6}{row.errors:>8}{row.failures:>6}{row.modes.contact:>9}{row.modes.late:>6}{row.modes.false_positives:>17}"
        lines.append(f"{row.version:{width}}{row.scenario:10}{row.strategy:12}{counts}   {rate}")
    for version in config.tested:
        for scenario in config.search:
            for region in read(Path(folders.regions(version, scenario)), FailureRegions).regions:
                inside = f"{region.failures_inside} of {region.support} tests inside fail"
                lines.append(f"{version} on {scenario}, {region.name}: {region.rule} ({inside})")
    if len(config.tested) > 1:
        comparison = Path(folders.root, "comparison.json")
        lines += ["", verdict_table(read(comparison, Comparison))]
    return "\n".join(lines)
