"""Failures of a study's versions by group of pedestrians: per search strategy, and on each held-out sequence per version and seed.

Unfinished campaigns are left out, so it also works on a running study. For adaptive against random and control, it prints round by round
the difference of the means, Student's interval over the common seeds and the sign-flip test over the tests. Last comes the number of
failures that no detector could fix with this camera.

python benchmarks/who_fails.py data/retraining
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from outcomes import mean_difference

from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests
from pipeline.core.lineage import Version
from pipeline.core.space import Floats, Space
from pipeline.core.statistics import sign_flip

CHILD_M = 1.45
GROUPS = ("children", "crouching under an umbrella", "crouching", "others")


def groups(space: Space, points: Floats) -> list[str]:
    """The group of pedestrians of each point, one of `GROUPS`."""
    categories = {
        variable.name: (variable, points[:, j].astype(int))
        for j, variable in enumerate(space.variables)
    }
    people, who = categories["blueprint"]
    attributes = {name: np.array(numbers)[who] for name, numbers in people.attributes}
    poses, pose = categories["animation"]
    crouching = np.array(poses.values)[pose] == "crouching"
    conditions = [
        attributes["height_m"] < CHILD_M,
        crouching & (attributes["umbrella"] > 0),
        crouching,
    ]
    return list(np.select(conditions, GROUPS[:-1], GROUPS[-1]))


def read(study: Path, pattern: str) -> pd.DataFrame:
    """The tests of some campaigns, with columns `group` and `not_solvable`."""
    tables = []
    for path in sorted(study.glob(pattern)):
        tests = read_tests(path)
        space = read_space(study / "space" / f"{tests['scenario'].iloc[0]}.json")[1]
        tables.append(
            tests.assign(
                group=groups(space, encode_tests(tests, space)),
                not_solvable=tests["cause"] == "not_solvable",
            )
        )
    if not tables:
        raise SystemExit(f"expected {study / pattern}, found none; run the study first")
    return pd.concat(tables)


def by_version(tests: pd.DataFrame) -> dict[str, dict[int, NDArray[np.int64]]]:
    """Group of versions -> seed -> (n,) failures, 0 or 1, on the common tests; versions without all tests are left out."""
    tests = tests.sort_values(["scenario", "index"])
    found: dict[str, dict[int, NDArray[np.int64]]] = defaultdict(dict)
    full = tests.groupby("version").size().max()
    for version, rows in sorted(
        tests.groupby("version"), key=lambda item: Version.named(item[0]).seed or 0
    ):
        if len(rows) == full:
            found[Version.named(version).group][Version.named(version).seed or 0] = rows[
                "failure"
            ].to_numpy(np.int64)
    return dict(sorted(found.items(), key=lambda item: Version.named(item[0]).round))


def cell(failures: Iterable[NDArray[np.int64]], chosen: NDArray[np.bool_]) -> str:
    counts = [int(one[chosen].sum()) for one in failures]
    return (
        str(counts[0])
        if len(counts) == 1
        else f"{np.mean(counts):.1f} ({', '.join(map(str, counts))})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "study", type=Path, help="data folder of a study with the thesis' eight variables"
    )
    study = parser.parse_args().study

    searched = read(study, "campaigns/*/*/base/*/tests.parquet")
    for strategy, rows in searched.groupby("strategy"):
        counts = rows.groupby("group")["failure"].agg(["sum", "size"]).reindex(GROUPS, fill_value=0)
        failed = rows[rows["failure"]]
        pairs = len(failed[["blueprint", "animation"]].drop_duplicates())
        points = len(
            rows.drop_duplicates(list(read_space(next(study.glob("space/*.json")))[1].names))
        )
        alone = int((failed["failure_mode"] == "false_positives").sum())
        print(
            f"{strategy}: {len(failed)} of {len(rows)} tests fail, {points} different ones, in {pairs} pairs of blueprint and pose; "
            f"{alone} by false positives alone"
        )
        print(
            "  "
            + ", ".join(f"{name} {row['sum']} of {row['size']}" for name, row in counts.iterrows())
        )

    held_out = read(study, "held_out/*/*/*/*/tests.parquet")
    for seed, tests in held_out.groupby("seed"):
        print(f"\nheld-out sequences of seed {seed}\n")
        print_table(tests)


def print_table(tests: pd.DataFrame) -> None:
    """Print failures by version, on one sequence per scenario."""
    versions = by_version(tests)
    one = tests[tests["version"] == tests["version"].mode()[0]].sort_values(["scenario", "index"])
    rows = [(name, (one["scenario"] == name).to_numpy()) for name in one["scenario"].unique()]
    rows += [
        ("all", np.ones(len(one), bool)),
        *((name, (one["group"] == name).to_numpy()) for name in GROUPS),
    ]
    print(
        "| failures | "
        + " | ".join(versions)
        + " | adaptive - random | adaptive - control |\n"
        + "|---" * (len(versions) + 3)
        + "|"
    )
    for name, chosen in rows:
        cells = [cell(failures.values(), chosen) for failures in versions.values()]
        cells += [difference(versions, "random", chosen), difference(versions, "control", chosen)]
        print(f"| {name}, {chosen.sum()} tests | " + " | ".join(cells) + " |")
    everything = np.ones(len(one), bool)
    for number in range(2, 1 + max(Version.named(name).round for name in versions)):
        print(
            f"round {number}, adaptive - random: {difference(versions, 'random', everything, number)}"
        )
    print(
        f"not solvable with this camera: {tests['not_solvable'].sum()} of the {tests['failure'].sum()} failures of all versions"
    )


def difference(
    versions: dict[str, dict[int, NDArray[np.int64]]],
    other: str,
    chosen: NDArray[np.bool_],
    number: int = 1,
) -> str:
    """Adaptive minus another arm in a round, over their common seeds."""
    adaptive, rival = (versions.get(str(Version(arm, number)), {}) for arm in ("adaptive", other))
    if not (common := adaptive.keys() & rival.keys()):
        return ""
    each = np.stack([adaptive[seed][chosen] - rival[seed][chosen] for seed in sorted(common)])
    return f"{mean_difference(each.sum(axis=1))}, p = {sign_flip(each.sum(axis=0)):.2g}"


if __name__ == "__main__":
    main()
