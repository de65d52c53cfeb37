"""The command line: `compose`, every step of the pipeline, and what looks at things. Bad input ends with one message and exit code 2."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.config import composing as configuration
from pipeline.errors import InputError
from pipeline.progress import Progress

Options = dict[str, dict[str, Any]]
ONE: dict[str, Any] = {"type": Path}
MANY: dict[str, Any] = {"type": Path, "nargs": "*"}
TEXT: dict[str, Any] = {"type": str}
NUMBER: dict[str, Any] = {"type": int}

STEPS: dict[str, tuple[str, Options]] = {
    "define-space": ("Write the logical scenario space of a scenario.", {"scenario": TEXT, "out": ONE}),
    "render-base": ("Render the random base training set.", {"out": ONE, "threads": NUMBER}),
    "train": ("Train or adopt the base detector.", {"base-set": ONE, "out": ONE, "checkpoint": ONE, "threads": NUMBER}),
    "campaign": (
        "Execute a test campaign in closed loop; resumes from its journal.",
        {
            "scenario": TEXT, "strategy": TEXT, "version": TEXT, "seed": NUMBER, "space": ONE, "model": ONE, "earlier": MANY, "out": ONE,
            "journal": ONE, "threads": NUMBER,
        },
    ),
    "measure": ("Measure the search campaigns.", {"tests": MANY, "spaces": MANY, "out": ONE, "theta": ONE}),
    "cluster": ("Group the failures of a scenario into regions.", {"tests": MANY, "space": ONE, "out": ONE}),
    "white-box": (
        "Measure which neurons each strategy's frames reach.",
        {"model": ONE, "base-set": ONE, "frames": MANY, "out": ONE, "threads": NUMBER},
    ),
    "filter": ("Decide which campaign frames may be learnt from.", {"frames": MANY, "out": ONE}),
    "retrain": (
        "Retrain a model version on the base set and campaign frames.",
        {
            "version": TEXT, "base-set": ONE, "parent": ONE, "spaces": MANY, "random-filters": MANY, "random-frames": MANY,
            "adaptive-filters": MANY, "adaptive-frames": MANY, "out": ONE, "checkpoint": ONE, "threads": NUMBER,
        },
    ),
    "compare": (
        "Compare all model versions on the held-out sequence.",
        {"tests": MANY, "spaces": MANY, "models": MANY, "measures": ONE, "out": ONE, "table": ONE, "changes": ONE, "metrics": ONE},
    ),
    "track": (
        "Log everything to MLflow and register the model versions.",
        {"models": MANY, "measures": ONE, "comparison": ONE, "campaigns": MANY, "plots": MANY, "store": ONE, "artifacts": ONE, "out": ONE},
    ),
    "report": (
        "Write the report, its plots and replays.",
        {
            "measures": ONE, "white-box": ONE, "comparison": ONE, "table": ONE, "changes": ONE, "regions": MANY, "tests": MANY,
            "later-tests": MANY, "spaces": MANY, "filters": MANY, "models": MANY, "detectors": MANY, "out": ONE, "plots": ONE,
        },
    ),
    "front-car-points": ("Draw random points of the front-car domain and propose points to full coverage.", {"out": ONE}),
    "front-car-snapshots": (
        "Render the snapshots of some points.", {"points": ONE, "version": TEXT, "out": ONE, "threads": NUMBER},
    ),
    "front-car-train": (
        "Train a detector of the forward vehicle.", {"version": TEXT, "snapshots": ONE, "out": ONE, "threads": NUMBER},
    ),
    "front-car-evaluate": ("Test the detectors of the forward vehicle.", {"points": ONE, "test": ONE, "models": MANY, "out": ONE}),
    "front-car-report": (
        "Write the front-car study's page.", {"points": ONE, "snapshots": ONE, "evaluation": ONE, "out": ONE, "plots": ONE},
    ),
}  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    top = argparse.ArgumentParser("python -m pipeline", description="Finds, explains and mends the blind spots of a camera detector.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    compose = commands.add_parser("compose", help="Compose conf/ into params.yaml.")
    compose.add_argument("words", nargs="+", metavar="study=NAME", help="the study, then Hydra overrides such as campaign.tests=100")
    compose.add_argument("--out", type=Path, default=configuration.PARAMS)
    simulate = commands.add_parser("simulate", help="Execute one concrete scenario and write its replay.")
    simulate.add_argument("scenario", help="a file's name in conf/scenario, such as F1")
    simulate.add_argument(
        "assignments", nargs="*", metavar="key=value", help="scenario variables, such as fog=80 'blueprint=M 03'; the rest is plain"
    )
    simulate.add_argument("--model", type=Path, default=Path("models/base"), help="folder of a model version (default: %(default)s)")
    simulate.add_argument("--out", type=Path, default=Path("replay.mp4"), help=".mp4 or .gif (default: %(default)s)")
    sheet = commands.add_parser("contact-sheet", help="Draw a scenario in all weathers and at several distances.")
    sheet.add_argument("scenario", help="a file's name in conf/scenario, such as F1")
    sheet.add_argument("--out", type=Path, default=Path("contact-sheet.png"), help="the picture (default: %(default)s)")
    export = commands.add_parser("export-scenario", help="Write one concrete scenario as OpenSCENARIO and OpenDRIVE.")
    export.add_argument("scenario", help="a file's name in conf/scenario, such as F1")
    export.add_argument("assignments", nargs="*", metavar="key=value", help="scenario variables; the rest is plain")
    export.add_argument("--out", type=Path, default=Path("scenario"), help="both files' name without its end (default: %(default)s)")
    frames = commands.add_parser("export-frames", help="Write a campaign's kept frames as YOLO, COCO and OpenLABEL.")
    frames.add_argument("frames", type=Path, help="frames.parquet of a campaign")
    frames.add_argument("--out", type=Path, default=Path("frames"), help="folder (default: %(default)s)")
    frames.add_argument("--params", type=Path, default=configuration.PARAMS, help="of the study, whose camera it is (default: %(default)s)")
    tested = commands.add_parser("test-detector", help="Search for the failures of any detector; trains nothing.")
    tested.add_argument("model", type=Path, help="ONNX file (ours, YOLOv5, YOLOv8/11 or end to end), or what the study's detector takes")
    tested.add_argument(
        "words", nargs="*", metavar="key=value", help="Hydra overrides, such as campaign.tests=40 search=[F1,F5] detector=mine"
    )
    tested.add_argument("--study", default="default", help="whose scenarios, strategies and budgets (default: %(default)s)")
    tested.add_argument("--out", type=Path, help="folder (default: data/detectors/<name of the model>-<start of its SHA-256>)")
    tested.add_argument("--threads", type=int, default=2, help="tests side by side (default: %(default)s)")
    quantised = commands.add_parser("quantise", help="Write the int8 form of a detector of ours, and what it loses.")
    quantised.add_argument("--model", type=Path, default=Path("models/base"), help="folder of a model version (default: %(default)s)")
    quantised.add_argument(
        "--base-set",
        type=Path,
        default=Path("data/default/base_set/truth.coco.json"),
        help="truth of a base set, whose images set the ranges and give the metrics (default: %(default)s)",
    )
    quantised.add_argument("--out", type=Path, default=Path("int8.onnx"), help="the file (default: %(default)s)")
    versions = commands.add_parser("versions", help="Print the registered model versions with their failures.")
    versions.add_argument("--store", type=Path, default=Path("data/mlflow/mlflow.db"), help="MLflow's database (default: %(default)s)")
    _add_coverage(commands)
    verdict = commands.add_parser("verdict", help="Print the table of the comparison.")
    verdict.add_argument("--comparison", type=Path, required=True)
    for name, (text, options) in STEPS.items():
        step = commands.add_parser(name, help=text, description=text)
        for option, how in options.items():
            step.add_argument(f"--{option}", required=True, **how)
        step.add_argument("--params", type=Path, default=configuration.PARAMS, help="resolved configuration (default: %(default)s)")
        step.add_argument("--log", type=Path, help="file that progress is written to, a line a second at most")
    return top


def _add_coverage(commands: Any) -> None:
    """`coverage score|propose|plan|verify`."""
    top = commands.add_parser("coverage", help="Score any data set's coverage, propose points, plan and verify covering arrays.")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    def verb(name: str, text: str) -> argparse.ArgumentParser:
        added: argparse.ArgumentParser = verbs.add_parser(name, help=text, description=text)
        added.add_argument("--space", type=Path, required=True, help="space file: variables and constraints in YAML")
        added.add_argument("--json", action="store_true", help="print one JSON object")
        return added

    def projected(added: argparse.ArgumentParser, required: bool) -> None:
        added.add_argument("--points", type=Path, required=required, help="CSV, parquet, COCO's JSON or a folder of YOLO labels")
        added.add_argument("--metadata", type=Path, help="for COCO and YOLO: a CSV with file_name and the conditions of each image")
        added.add_argument("--k", type=int, default=2, help="conditions that are looked at together (default: %(default)s)")
        added.add_argument("--operator", choices=("product", "sum", "max"), default="product", help="of weights (default: %(default)s)")

    score = verb("score", "How well points cover every combination of categories of any k conditions.")
    projected(score, required=True)
    score.add_argument("--figures", type=Path, help="folder for a heat map of every plane and the growth of coverage")
    propose = verb("propose", "The next points that raise coverage most.")
    projected(propose, required=False)
    propose.add_argument("--count", type=int, default=1, help="how many (default: %(default)s)")
    propose.add_argument("--complete", action="store_true", help="as many as complete the coverage, and how many it needs at least")
    propose.add_argument("--exact", action="store_true", help="by 0-1 programming: the optimum, or the best in time and a bound")
    propose.add_argument("--heavy-first", action="store_true", help="prefer cells of large weight to many cells")
    propose.add_argument("--output", type=Path, help="CSV for the points")
    plan = verb("plan", "A covering array: few points with every combination of categories of any conditions.")
    plan.add_argument("--strength", type=int, default=2, help="conditions that are combined, 1 to 6 (default: %(default)s)")
    plan.add_argument("--effort", choices=("quick", "polish"), default="quick", help="polish goes on for --seconds (default: %(default)s)")
    plan.add_argument("--include", type=Path, help="table of points that must be in the plan")
    plan.add_argument("--output", type=Path, help="CSV for the plan")
    for timed, seconds in ((propose, 20.0), (plan, 30.0)):
        timed.add_argument("--seconds", type=float, default=seconds, help="time limit of --exact or polish (default: %(default)s)")
        timed.add_argument("--seed", type=int, default=0, help="of everything drawn at random (default: %(default)s)")
    verify = verb("verify", "Check a plan by other means than those that made it; exit code 1 if it is not valid.")
    verify.add_argument("--points", type=Path, required=True, help="the plan: CSV or parquet")
    verify.add_argument("--strength", type=int, default=2, help="conditions that are combined (default: %(default)s)")


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    options = vars(parser().parse_args(arguments))
    command = options.pop("command")
    try:
        if command == "compose":
            _compose(options["words"], options["out"])
        elif command == "simulate":
            from pipeline.commands import simulate

            print(simulate.run(**options))
        elif command == "export-scenario":
            _export_scenario(**options)
        elif command == "export-frames":
            _export_frames(**options)
        elif command == "contact-sheet":
            _contact_sheet(**options)
        elif command == "test-detector":
            _test_detector(**options)
        elif command == "quantise":
            from pipeline.commands import quantise

            print(quantise.run(configuration.compose("default", []), **options))
        elif command == "versions":
            _versions(options["store"])
        elif command == "coverage":
            return _coverage(**options)
        elif command == "verdict":
            _verdict(options["comparison"])
        else:
            _step(command, options)
    except InputError as error:
        print(f"blindspot {command}: {error}", file=sys.stderr)
        return 2
    return 0


def _compose(words: list[str], out: Path) -> None:
    study = [word.removeprefix("study=") for word in words if word.startswith("study=")]
    if len(study) != 1:
        raise InputError(f"name one study, as in `compose study=default`; got {' '.join(words)}")
    config = configuration.compose(study[0], [word for word in words if not word.startswith("study=")])
    out.write_text(configuration.dump(config, f"python -m pipeline compose {' '.join(words)}"))
    print(f"{out}: study {config.study}")


def _contact_sheet(scenario: str, out: Path) -> None:
    import cv2

    from pipeline.simulators.mujoco.contact_sheet import scenario_sheet

    if out.suffix not in (".png", ".jpg"):
        raise InputError(f"--out: a contact sheet is a .png or a .jpg, got {out.name}")
    camera = configuration.compose("default", []).simulator.get("camera", {})
    cv2.imwrite(str(out), scenario_sheet(configuration.functional_scenario(scenario), camera)[..., ::-1])
    print(out)


def _export_scenario(scenario: str, assignments: list[str], out: Path) -> None:
    from pipeline.artefacts.openscenario import write_openscenario
    from pipeline.commands.simulate import concrete_scenario
    from pipeline.core.space import Space

    described = configuration.functional_scenario(scenario)
    for path in write_openscenario(described, concrete_scenario(Space.from_dict(described.space), assignments), out):
        print(path)


def _export_frames(frames: Path, out: Path, params: Path) -> None:
    from pipeline.artefacts.openlabel import export_frames

    camera = configuration.load(params).simulator.get("camera", {})
    print(f"{out}: {export_frames(frames, out, float(camera.get('hfov_deg', 60)), float(camera.get('distortion', 0)))} frames")


def _test_detector(model: Path, words: list[str], study: str, out: Path | None, threads: int) -> None:
    from pipeline.commands import test_detector

    if threads < 1:
        raise InputError(f"--threads must be at least 1, got {threads}")
    config = configuration.compose(study, words)
    test_detector.check(config, model)
    folder = out or test_detector.default_folder(model)
    found = test_detector.run(config, model=model, out=folder, threads=threads)
    print(test_detector.table(found))
    print(f"in {folder}: campaigns/, measures.json, regions/")


def _versions(store: Path) -> None:
    from pipeline.tracking.store import registered

    columns = ("model", "number", "version", "study", "failures", "failures_by_ttc", "tests", "verdict", "alias")
    rows = [columns, *(tuple(row.get(name, "") for name in columns) for row in registered(store))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _coverage(verb: str, json: bool, **options: Any) -> int:
    from json import dumps

    from pipeline.commands import coverage

    for option in ("seconds", "seed"):
        if options.get(option, 0) < 0:
            raise InputError(f"--{option} must be at least 0, got {options[option]}")
    with Progress(f"coverage {verb}") as progress:
        found, text = getattr(coverage, verb)(**options, progress=progress)
    print(dumps(found, ensure_ascii=False) if json else text)
    return 0 if found.get("valid", True) else 1


def _verdict(comparison: Path) -> None:
    from pipeline.artefacts.results import Comparison, read
    from pipeline.report.verdict import verdict_table

    print(verdict_table(read(comparison, Comparison), comparison.with_name("report.html")))


def _step(command: str, options: dict[str, Any]) -> None:
    config, log = configuration.load(options.pop("params")), options.pop("log")
    step = import_module(f"pipeline.steps.{command.replace('-', '_')}")
    with Progress(command, log) as progress:
        try:
            step.run(config, **options, progress=progress)
        except InputError as error:
            progress.record(str(error))
            raise


if __name__ == "__main__":
    sys.exit(main())
