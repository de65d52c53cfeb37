"""Command `coverage`: scores the coverage of any data set and proposes points to add.

It also plans, verifies and exports covering arrays.
"""

from __future__ import annotations

import argparse
import json
from math import inf
from pathlib import Path

from pipeline.artefacts.data_set import IMAGE_SETS
from pipeline.core.names import in_one_line
from pipeline.errors import InputError
from pipeline.progress import Progress

HELP = "Score the coverage of any data set, propose points, plan and verify covering arrays."

SECONDS = {"propose": 20.0, "plan": 30.0}


def arguments(parser: argparse.ArgumentParser) -> None:
    """`coverage score|propose|plan|verify|export`."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    score = _verb(
        verbs, "score", "How well points cover every combination of categories of any k conditions."
    )
    _add_projection(score, points_required=True)
    score.add_argument(
        "--figures",
        type=Path,
        help="folder for a heat map of every plane and the growth of coverage",
    )
    propose = _verb(verbs, "propose", "The next points that raise coverage most.")
    _add_projection(propose, points_required=False)
    propose.add_argument("--count", type=int, help="how many (default: 1)")
    propose.add_argument(
        "--complete",
        action="store_true",
        help="as many as full coverage needs: the fewest, or few and a bound",
    )
    propose.add_argument(
        "--exact",
        action="store_true",
        help="use 0-1 programming: the optimum, or the best found in time and a bound",
    )
    propose.add_argument(
        "--heavy-first", action="store_true", help="prefer heavy cells to many cells"
    )
    propose.add_argument("--output", type=Path, help="CSV or parquet file for the points")
    plan = _verb(
        verbs,
        "plan",
        "A covering array: few points with every combination of categories of any conditions.",
    )
    plan.add_argument(
        "--strength",
        type=int,
        default=2,
        help="number of conditions to combine, 1 to 6 (default: %(default)s)",
    )
    plan.add_argument(
        "--effort",
        choices=("quick", "polish"),
        default="quick",
        help="polish searches for --seconds (default: %(default)s)",
    )
    plan.add_argument(
        "--cpu-seconds",
        type=float,
        help="time limit of polish in processor time, for the same effort on a busy machine",
    )
    plan.add_argument("--include", type=Path, help="table of points that must be in the plan")
    plan.add_argument("--output", type=Path, help="CSV or parquet file for the plan")
    for timed, verb, limited in ((propose, "propose", "--exact"), (plan, "plan", "polish")):
        timed.add_argument(
            "--seconds", type=float, help=f"time limit of {limited} (default: {SECONDS[verb]})"
        )
        timed.add_argument("--seed", type=int, default=0, help="random seed (default: %(default)s)")
    verify = _verb(
        verbs,
        "verify",
        "Check a plan independently of the code that made it; exit code 1 if it is not valid.",
    )
    verify.add_argument("--points", type=Path, required=True, help="the plan: CSV or parquet")
    verify.add_argument(
        "--strength",
        type=int,
        default=2,
        help="number of conditions to combine (default: %(default)s)",
    )
    export = _verb(verbs, "export", "Write a space as a PICT or ACTS model, or as a space file.")
    export.add_argument(
        "--output",
        type=Path,
        required=True,
        help="file to write; .txt is PICT, .xml ACTS, .yaml a space file",
    )
    export.add_argument(
        "--format",
        choices=("pict", "acts", "acts-xml", "space"),
        help="the format, if the file's name does not show it",
    )


def _verb(
    verbs: argparse._SubParsersAction[argparse.ArgumentParser], name: str, text: str
) -> argparse.ArgumentParser:
    added = verbs.add_parser(name, help=text, description=text)
    added.add_argument(
        "--space",
        type=Path,
        required=True,
        help="space file, PICT model, ACTS model or OpenODD file",
    )
    added.add_argument("--json", action="store_true", help="print one JSON object")
    return added


def _add_projection(parser: argparse.ArgumentParser, points_required: bool) -> None:
    parser.add_argument(
        "--points",
        type=Path,
        required=points_required,
        help=f"CSV, parquet, {IMAGE_SETS}",
    )
    parser.add_argument(
        "--metadata",
        type=Path,
        help="for images: a table with file_name and the conditions of each image",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="reject a table with rows that are partial or break a constraint",
    )
    parser.add_argument(
        "--k", type=int, default=2, help="number of conditions to combine (default: %(default)s)"
    )
    parser.add_argument(
        "--operator",
        choices=("product", "sum", "max"),
        default="product",
        help="how weights combine (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Run the subcommand and print its result; 1 if `verify` finds the plan not valid."""
    from pipeline.report.coverage_answers import VERBS

    check_options(options)
    check_outputs(options)
    try:
        with Progress(f"coverage {options.verb}") as progress:
            answer, text = VERBS[options.verb](options, progress)
    except InputError as error:
        raise InputError(in_one_line(str(error))) from error
    print(json.dumps(answer, ensure_ascii=False) if options.json else text)
    return 0 if answer.get("valid", True) else 1


def check_options(options: argparse.Namespace) -> None:
    """InputError for wrong and useless options; fills in the defaults that --complete excludes."""
    if getattr(options, "complete", False):
        for option in ("count", "exact", "seconds"):
            if (given := getattr(options, option)) is not None and given is not False:
                raise InputError(
                    f"--complete proposes as many points as are needed; leave out --{option}"
                )
    if getattr(options, "metadata", None) and options.points is None:
        raise InputError("--metadata gives the conditions of images; name the images by --points")
    if getattr(options, "cpu_seconds", None) is not None and options.seconds is not None:
        raise InputError("--seconds and --cpu-seconds both limit polish; give one of them")
    for option in ("seconds", "cpu-seconds", "seed"):
        if not 0 <= (given := getattr(options, option.replace("-", "_"), None) or 0) < inf:
            raise InputError(f"--{option} must be at least 0 and finite, got {given}")
    polishes = getattr(options, "effort", "polish") == "polish"
    for option in ("seconds", "cpu-seconds"):
        if not polishes and getattr(options, option.replace("-", "_")) is not None:
            raise InputError(f"--{option} limits polish; add --effort polish")
    if not getattr(options, "exact", True) and options.seconds is not None:
        raise InputError("--seconds limits --exact; add --exact")
    options.count = 1 if getattr(options, "count", None) is None else options.count
    if getattr(options, "seconds", None) is None:
        options.seconds = SECONDS.get(options.verb, 0.0)


def check_outputs(options: argparse.Namespace) -> None:
    """InputError for a file that cannot be written, or that is also an input."""
    from pipeline.artefacts.files import check_output
    from pipeline.artefacts.model_export import format_of
    from pipeline.artefacts.table_file import check_format

    if output := getattr(options, "output", None):
        format_of(output, options.format) if options.verb == "export" else check_format(output)
        check_output(output)
        for name in ("space", "points", "include", "metadata"):
            given = getattr(options, name, None)
            if given is not None and given.exists() and output.exists() and output.samefile(given):
                raise InputError(f"--output: expected another file than --{name}, got {output}")
    if figures := getattr(options, "figures", None):
        check_output(figures, folder=True)
