"""When is a search worth it? The benefit of adaptive data for weak and strong bases, and for few and many executions.

    python benchmarks/where_it_pays.py plan                       the commands of every piece, and which are published
    python benchmarks/where_it_pays.py keep long_tailed-30 0      publish the piece that data/default holds, and draw the figure anew
    python benchmarks/where_it_pays.py answer | draw              the page's table, its figure

A piece is the default study with another base detector or another number of tests. The ten default studies, published already, are the
pieces in the middle: base `long_tailed`, 100 tests a scenario.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd
from default_study import PUBLISHED as DEFAULT
from default_study import SEEDS as DEFAULT_SEEDS
from matplotlib.figure import Figure
from outcomes import mean_difference, p_text, smallest_p, student_p, valid
from pieces import Experiment, Piece

from pipeline.report.style import legend_below, panels, series_colours, styled

BASES = {
    # The settings of study=thesis: any confidence brakes, and a box matches from an IoU of 0.3. They leave 0.2 % of random tests failing.
    "rare": "base.weights=models/uniform base_set.rare.children=1 base_set.rare.crouching=1 campaign.match_iou=0.3 aeb.brakes_from=0.05"
    " ~arms.control comparison.tests=400",
    "after_random": "base.weights=models/published/random",
    "strong": "base.weights=models/published/adaptive",
    "uniform": "base.weights=models/uniform base_set.rare.children=1 base_set.rare.crouching=1",
    "long_tailed": "",
    "weak": "base.source=trained training.crop_iterations=800 training.frame_iterations=500",
}
"""The overrides of each base, from the strongest to the weakest."""
PIECES: dict[tuple[str, int], Sequence[int]] = {
    ("rare", 300): range(900, 903),  # Asked last.
    ("strong", 100): (0, 1, 3, 4, 5),  # Not 2: the base learnt from searches with this seed.
    ("after_random", 100): range(6, 11),  # Asked after `strong`, hence with other held-out tests.
    ("uniform", 100): range(3),
    ("long_tailed", 30): range(3),
    ("long_tailed", 300): range(3),
    ("long_tailed", 1000): range(2),
    ("weak", 100): range(3),
}
"""The seeds of the searches by base and tests a scenario."""
DEFAULT_KIND = ("long_tailed", 100)
CONFIRMING = ("after_random", 100)
"""The row that was asked alone, whether it confirms another."""
LEARNT = ("strong", "after_random")
"""The bases that have learnt from tests. The versions of their pieces face more held-out tests, right after the piece itself."""
MORE = {f"{base}-more": "published" for base in LEARNT}
"""The kinds of these pieces, and their study."""


def compositions() -> dict[Piece, str]:
    """The arguments of `compose` by piece."""
    found = {}
    for (base, tests), seeds in PIECES.items():
        for seed in seeds:
            found[f"{base}-{tests}", seed] = (
                f"comparison.seed={seed} campaign.tests={tests} {BASES[base]}"
            )
            if base in LEARNT:
                tested = [
                    f"tested.{name}=data/default/retrained/models/{name}/weights.safetensors"
                    for name in ("random", "adaptive")
                ]
                found[f"{base}-more", seed] = (
                    f"comparison.seed={100 + seed} held_out=[F1star,F2star] ~tested.base {' '.join(tested)}"
                )
    return found


EXPERIMENT = Experiment(
    "where_it_pays",
    "default",
    compositions(),
    figure=lambda pieces: figure(rates(pieces)),
    study_of=MORE,
)


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """A row for each base and number of tests."""
    heading = [
        "base",
        "tests a scenario",
        "searches",
        "base fails, %",
        "`random` fails, %",
        "`adaptive` fails, %",
    ]
    heading += ["`adaptive` minus `random`, points (95 %)"]
    lines = [
        f"{len(pieces)} of {len(EXPERIMENT.compose)} pieces are published, and the ten default studies.",
        "",
        f"| {' | '.join(heading)} |",
        "|---" * len(heading) + "|",
    ]
    differences = {}
    for (base, tests), failed in rates(pieces).items():
        differences[base, tests] = ahead = failed["adaptive"] - failed["random"]
        lines.append(
            f"| `{base}` | {tests:,} | {len(failed)} | {_means(failed, 'base', 'random', 'adaptive')} | {mean_difference(ahead)} |"
        )
    confirming = differences.pop(CONFIRMING, None)
    smallest = smallest_p(
        {f"`{base}` with {tests:,}": found for (base, tests), found in differences.items()}
    )
    lines += ["", f"Smallest p of the differences, {smallest}."]
    if confirming is not None:
        lines[-1] += f" That of `{CONFIRMING[0]}`, asked alone, is {p_text(student_p(confirming))}."
    return "\n".join(lines + more_tests(pieces))


def more_tests(pieces: Mapping[Piece, pd.DataFrame]) -> list[str]:
    """A row for each base that has learnt from tests, for both, and for both on each scenario: more held-out tests of the same versions."""
    rows = {
        f"`{base}`": [table for (kind, _), table in pieces.items() if kind == f"{base}-more"]
        for base in LEARNT
    }
    both = [table for tables in rows.values() for table in tables]
    if not both:
        return []
    rows["both"] = both
    for name in both[0]["scenario"].unique():
        rows["both, on " + name.replace("star", r"\*")] = [
            table[table["scenario"] == name] for table in both
        ]
    heading = [
        "more tests, base",
        "searches",
        "`random` fails, %",
        "`adaptive` fails, %",
        "`adaptive` minus `random`, points (95 %)",
        "p",
    ]
    lines = ["", f"| {' | '.join(heading)} |", "|---" * len(heading) + "|"]
    for name, tables in rows.items():
        if tables:
            failed = pd.DataFrame([100 * valid(table).mean() for table in tables])
            ahead = failed["adaptive"] - failed["random"]
            cells = [
                name,
                len(tables),
                _means(failed, "random", "adaptive"),
                mean_difference(ahead),
                p_text(student_p(ahead)),
            ]
            lines.append(f"| {' | '.join(map(str, cells))} |")
    return lines


def _means(failed: pd.DataFrame, *versions: str) -> str:
    return " | ".join(f"{failed[version].mean():.1f}" for version in versions)


def rates(pieces: Mapping[Piece, pd.DataFrame]) -> dict[tuple[str, int], pd.DataFrame]:
    """For each base and number of tests, the percentage of held-out tests that each version fails: (searches, versions)."""
    default = [pd.read_csv(DEFAULT / f"{seed}.csv.gz") for seed in DEFAULT_SEEDS]
    found = {}
    for base, tests in sorted(
        [*PIECES, DEFAULT_KIND], key=lambda kind: (list(BASES).index(kind[0]), kind[1])
    ):
        kind = f"{base}-{tests}"
        tables = (
            default
            if (base, tests) == DEFAULT_KIND
            else [table for (of, _), table in pieces.items() if of == kind]
        )
        if tables:
            found[base, tests] = pd.DataFrame([100 * valid(table).mean() for table in tables])
    return found


def left(failed: pd.DataFrame, version: str) -> pd.Series:
    """The failures that a version leaves, in percent of the base's, for each search."""
    return 100 * failed[version] / failed["base"]


def figure(found: Mapping[tuple[str, int], pd.DataFrame]) -> Figure:
    """The share of the base's failures that each version leaves, by number of tests and by base, from the strongest to the weakest.

    A small dot is a search, a large one the mean; a line joins the means of one base. The intervals of a few searches are in the table:
    here they would hide the dots.
    """
    with styled():
        drawn, [[executions, strength]] = panels(1, 2, width=4.6, height=3.4)
        axes = {
            executions: {
                f"{tests:,}": failed
                for (base, tests), failed in found.items()
                if base == DEFAULT_KIND[0]
            },
            strength: {
                "\n".join(
                    [
                        base,
                        f"{failed['base'].mean():.1f} %",
                        *([] if tests == DEFAULT_KIND[1] else [f"{tests} tests"]),
                    ]
                ): failed
                for (base, tests), failed in found.items()
                if tests == DEFAULT_KIND[1] or base != DEFAULT_KIND[0]
            },
        }
        for axis, points in axes.items():
            for name, colour in series_colours(["random", "adaptive"]).items():
                shift = (
                    -0.06 if name == "random" else 0.06
                )  # Side by side, so that neither hides the other.
                shares = [left(failed, name) for failed in points.values()]
                line = "o-" if axis is executions else "o"
                axis.plot(
                    [x + shift for x in range(len(points))],
                    [each.mean() for each in shares],
                    line,
                    color=colour,
                    label=name,
                )
                for x, each in enumerate(shares):
                    axis.scatter(
                        [x + shift] * len(each), each, color=colour, s=18, alpha=0.5, linewidths=0
                    )
            axis.set_xticks(range(len(points)), labels=list(points))
        executions.set(
            xlabel="tests a scenario, base long_tailed",
            ylabel="failures left, % of the base's",
            ylim=(0, None),
        )
        strength.set(
            xlabel=f"held-out tests that the base fails; {DEFAULT_KIND[1]} tests, or as stated"
        )
        legend_below(drawn, [executions, strength])
    return drawn


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
