"""Prints tables of docs/results from the outcomes that are published beside them.

    python benchmarks/published.py oracle | base-rates | learning | length | digests | blamed | again | stricter

`python tools/results.py write` puts them into the pages.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import fill

import pandas as pd
from outcomes import ERROR, FAILED
from who_fails import GROUPS

from pipeline.artefacts.files import sha256
from pipeline.core.statistics import wilson_interval

RESULTS = Path("docs/results")
STRATEGIES = Path("benchmarks/strategies")
THESIS_RANDOM = (1, 4, 2, 0, 0, 0, 6, 0)
"""Failures of 1,000 random tests, F1 to F8 (thesis Table 6.3)."""
THESIS_TESTS = 1000
LINE = 138
LENGTHS = (500, *range(1000, 10_000, 1000))


def main() -> None:
    tables: dict[str, Callable[[], str]] = {
        "oracle": oracle,
        "base-rates": base_rates,
        "learning": learning,
        "length": length,
        "digests": digests,
        "blamed": blamed,
        "again": again,
        "stricter": stricter,
    }
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", choices=list(tables))
    print(tables[parser.parse_args().table]())


def oracle() -> str:
    """Failures of the visible-pixel oracle in random tests."""
    rows = pd.read_csv(RESULTS / "fairness-oracle.csv")
    failures, tests, excused = (
        int(rows[name].sum()) for name in ("failures", "tests", "not_solvable")
    )
    lines = [
        f"{failures} of {tests:,} tests fail, {excused} of them not solvable.",
        "",
        *header("scenario", "failures", "rate, 95 %", "of these not solvable", "false activations"),
    ]
    for row in rows.itertuples():
        braking = "–" if str(row.scenario).startswith("F") else str(row.false_activations)
        lines.append(
            f"| {label(str(row.scenario))} | {row.failures} | {rate(row.failures, row.tests)} | {row.not_solvable} | {braking} |"
        )
    return "\n".join(lines)


def base_rates() -> str:
    """Failures of the shipped bases in random tests, beside the thesis'."""
    bases = [
        pd.read_csv(RESULTS / f"fairness-{name}.csv").set_index("scenario")
        for name in ("thesis", "default", "long-tailed")
    ]
    lines = header(
        "scenario",
        "uniform, `study=thesis`",
        "uniform, default settings",
        "long-tailed, default settings",
        "the thesis",
    )
    for place, scenario in enumerate(bases[0].index):
        counts = [
            (int(rows.loc[scenario, "failures"]), int(rows.loc[scenario, "tests"]))
            for rows in bases
        ]
        lines.append(line(str(scenario), [*counts, (THESIS_RANDOM[place], THESIS_TESTS)]))
    totals = [(int(rows["failures"].sum()), int(rows["tests"].sum())) for rows in bases]
    alone = int(bases[-1]["false_positives"].sum())
    last = f"{alone} of the {totals[-1][0]} failures of the long-tailed base come from false positives alone."
    return "\n".join(
        [
            *lines,
            line("all", [*totals, (sum(THESIS_RANDOM), THESIS_TESTS * len(THESIS_RANDOM))]),
            "",
            last,
        ]
    )


def blamed() -> str:
    """Whom the long-tailed base fails on F3 and everywhere, what its false positives are, and what an IoU of 0.3 changes."""
    tests = pd.read_csv(RESULTS / "fairness-long-tailed.csv.gz")
    tests = tests[tests["outcome"] != ERROR]
    lines = header("pedestrian", "F3", "F1 to F8")
    for group in GROUPS:
        ours = tests[tests["group"] == group]
        counts = [
            (int(rows["outcome"].sum()), len(rows))
            for rows in (ours[ours["scenario"] == "F3"], ours)
        ]
        lines.append(line(group, counts))
    alone = tests[tests["failure_mode"] == "false_positives"]
    kinds = {
        name: int((alone[f"false_positives_{name}"] > 0).sum())
        for name in ("far", "localisation", "duplicate")
    }
    said = (
        f"{len(alone)} of {tests['outcome'].sum()} failures come from false positives alone. Of these tests, "
        f"{kinds['localisation']} have boxes on the pedestrian that fit too poorly to match, {kinds['duplicate']} a second box on "
        f"the pedestrian, and {kinds['far']} a box elsewhere."
    )
    looser = pd.read_csv(RESULTS / "fairness-long-tailed-iou-0.3.csv.gz")
    both = [rows[rows["scenario"].isin(looser["scenario"])] for rows in (tests, looser)]
    before, after = (
        f"{(rows['outcome'] == FAILED).sum()} failures, {(rows['failure_mode'] == 'false_positives').sum()} of false positives alone"
        for rows in both
    )
    names = " and ".join(looser["scenario"].unique())
    changed = f"With `campaign.match_iou=0.3`, the same tests of {names} have {after}, instead of {before}."
    return "\n".join([*lines, "", fill(said, LINE), "", fill(changed, LINE)])


def again() -> str:
    """Failures of the long-tailed base in more random tests, and those from false positives alone, there and in both lists together."""
    first, more = (
        pd.read_csv(RESULTS / f"fairness-long-tailed{name}.csv.gz") for name in ("", "-again")
    )
    lines = header("scenario", "failures", "of these, from false positives alone")
    for name, rows in [
        *more.groupby("scenario"),
        ("all", more),
        ("all, with the first 2,400", pd.concat([first, more])),
    ]:
        valid = rows[rows["outcome"] != ERROR]
        failed = valid[valid["outcome"] == FAILED]
        alone = int((failed["failure_mode"] == "false_positives").sum())
        lines.append(line(str(name), [(len(failed), len(valid)), (alone, len(failed))]))
    return "\n".join(lines)


def stricter() -> str:
    """Failures and those from false positives alone: of both bases, and of one with stricter thresholds."""
    same = {
        "uniform, 0.8": "default",
        "long-tailed, 0.8": "long-tailed",
        "long-tailed, 0.9": "long-tailed-0.9",
    }
    lists = {**same, "long-tailed, 0.87, fresh tests": "long-tailed-0.87"}
    lines = header("base, threshold", "failures", "on F3", "from false positives alone")
    for name, file in lists.items():
        rows = pd.read_csv(RESULTS / f"fairness-{file}.csv.gz")
        valid = rows[rows["outcome"] != ERROR]
        failed, third = valid[valid["outcome"] == FAILED], valid[valid["scenario"] == "F3"]
        alone = int((failed["failure_mode"] == "false_positives").sum())
        counts = [
            (len(failed), len(valid)),
            (int((third["outcome"] == FAILED).sum()), len(third)),
            (alone, len(failed)),
        ]
        lines.append(line(name, counts))
    return "\n".join(lines)


def line(name: str, counts: Sequence[tuple[int, int]]) -> str:
    return f"| {name} | {' | '.join(f'{failures} of {tests:,}, {rate(failures, tests)}' for failures, tests in counts)} |"


def learning() -> str:
    """Average precision at the end of each training in learning.csv."""
    rows = pd.read_csv(RESULTS / "learning.csv").groupby(["training", "images"], sort=False).tail(1)
    lines = header("training", "images shown", "AP50", "AP50-95", "CPU-s")
    for row in rows.sort_values("shown", kind="stable").itertuples():
        lines.append(
            f"| {row.training} | {row.shown:,} | {row.new_ap50:.3f} | {row.new_ap50_95:.3f} | {row.cpu_s:.0f} |"
        )
    return "\n".join(lines)


def length() -> str:
    """The uniform base's average precision after some batches."""
    curve = pd.read_csv("models/uniform/curve.csv").set_index("iteration")["ap50"]
    return "\n".join(
        [
            *header("batches", "AP50"),
            *(f"| {batches:,} | {curve[batches]:.2f} |" for batches in LENGTHS),
        ]
    )


def digests() -> str:
    """What the pages rest on: the digest of each folder's files, and of the shipped weights."""
    parents = RESULTS, STRATEGIES / "data", STRATEGIES / "results"
    places = [
        *(path for parent in parents[:2] for path in sorted(parent.iterdir()) if path.is_dir()),
        parents[2],
    ]
    lines = header("outcomes and weights", "files", "SHA-256")
    for place in places:
        files = sorted(path for path in place.rglob("*") if path.is_file())
        listed = "".join(f"{path.relative_to(place).as_posix()} {sha256(path)}\n" for path in files)
        lines.append(
            f"| `{place}/` | {len(files)} | `{hashlib.sha256(listed.encode()).hexdigest()}` |"
        )
    lines += [
        f"| `{path}` | 1 | `{sha256(path)}` |"
        for path in sorted(Path("models").rglob("weights.safetensors"))
    ]
    return "\n".join(lines)


def header(*names: str) -> list[str]:
    return [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]


def rate(failures: int, tests: int) -> str:
    """Percentage with its Wilson interval."""
    low, high = wilson_interval(failures, tests)
    return f"{failures / tests:.1%} ({100 * low:.1f} to {100 * high:.1f})".replace("%", " %")


def label(scenario: str) -> str:
    return scenario.replace("star", r"\*")


if __name__ == "__main__":
    main()
