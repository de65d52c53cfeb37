"""What does a front-car detector gain from points that complete the coverage? The experiment in docs/results/front-car.md.

    python benchmarks/front_car.py run 10 11    executes and publishes seeds; each takes about six minutes on two cores
    python benchmarks/front_car.py answer       the page's table

A seed draws five random points, snapshots and trainings of its own. Three detectors learn from equally many snapshots, for equally long:

- `existing`: of the five random points;
- `covered`: of these and the points that `study=front_car` proposes, until every two conditions have been seen together;
- `random`: of these and as many further random points instead.

They are tested on the same snapshots. A published row is a detector: its points, the pairs that these cover, its AP50 and, for each test
snapshot, 1 if it was right or 0.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.front_car_results import CoveredPoint, Evaluation, Points
from pipeline.artefacts.results import read, write
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.contract import order_of, perform
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.statistics import mean_interval

PUBLISHED = Path("docs/results/front-car.csv")
VERSIONS = ("existing", "covered", "random")
QUESTIONS = (("covered", "existing"), ("covered", "random"))
CONFIDENCE = 1 - 0.05 / len(QUESTIONS)
"""Of each interval: all together hold with 95 % (Bonferroni)."""
FURTHER = 7
"""Stream of random numbers of the further points."""


@dataclass(frozen=True)
class Learnt:
    """A detector. right: (snapshots,) of the test."""

    version: str
    points: int
    pairs: int
    ap50: float
    right: NDArray[np.bool_]


def study(config: Config) -> list[Learnt]:
    """Execute the study in folders of its own, then once more with further random points in place of the proposals."""
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder, "proposed"), Path(folder, "drawn")
        first.mkdir()
        with chdir(first):
            steps(config, "points")
            steps(config, "snapshots", "existing", "covered", "test")
            steps(config, "train", "existing", "covered")
            steps(config, "evaluate")
        shutil.copytree(first, second)
        with chdir(second):
            proposed = read(root() / "points.json", Points)
            (root() / "points.json.stamp").unlink()
            write(root() / "points.json", drawn(config, proposed))
            steps(config, "snapshots", "covered")
            steps(config, "train", "covered")
            steps(config, "evaluate")
        existing, covered = learnt(first / root())
        again, random = learnt(second / root())
    assert (existing.right == again.right).all()
    return [
        existing,
        covered,
        Learnt("random", random.points, random.pairs, random.ap50, random.right),
    ]


def root() -> Path:
    """The study's folder in the working directory."""
    return Path("data/front_car")


def steps(config: Config, name: str, *versions: str) -> None:
    """Perform a step of the study, once for each version if it has some."""
    for version in versions or [""]:
        perform(
            order_of(
                f"front_car_{name}",
                config,
                {"version": version} if version else {},
                stamp="benchmark",
                threads=2,
            ),
            config,
        )


def drawn(config: Config, proposed: Points) -> Points:
    """The existing points, and as many further random ones as were proposed, none twice."""
    space, feasible = config.front_car.space.space(), config.front_car.space.feasible_points()
    demand = Demand(space.constraints, proposed.k)
    encoded = [
        space.encode(dict(point.values)).astype(int)
        for point in proposed.points[: proposed.existing]
    ]
    rng, chosen = np.random.default_rng([config.front_car.seed, FURTHER]), np.array(encoded)
    others = feasible[~(feasible[:, None] == chosen).all(axis=2).any(axis=1)]
    chosen = np.vstack(
        [chosen, rng.choice(others, len(proposed.points) - proposed.existing, replace=False)]
    )
    points = list(proposed.points[: proposed.existing])
    for place in range(proposed.existing, len(chosen)):
        values = {
            name: str(value) for name, value in space.decode(chosen[place].astype(float)).items()
        }
        covered = projection_coverage(chosen[: place + 1], demand).covered
        points.append(
            CoveredPoint(name=f"R{place + 1 - proposed.existing}", values=values, covered=covered)
        )
    return proposed.model_copy(update={"points": tuple(points)})


def learnt(folder: Path) -> list[Learnt]:
    """The two detectors of a study's folder."""
    points, evaluation = (
        read(folder / "points.json", Points),
        read(folder / "evaluation.json", Evaluation),
    )
    return [
        Learnt(
            found.version,
            found.learnt_points,
            points.points[found.learnt_points - 1].covered,
            found.metrics["ap50"],
            np.array([right for point in found.points for right in point.right]),
        )
        for found in evaluation.detectors
    ]


def run(seeds: Iterable[int]) -> None:
    """Execute and publish seeds; published ones are left as they are."""
    shipped = Path("models/uniform").resolve()
    for seed in seeds:
        known = published()
        if seed in set(known["seed"]):
            continue
        config = compose("front_car", [f"base.weights={shipped}", f"front_car.seed={seed}"])
        rows = [
            vars(one) | {"seed": seed, "right": "".join(map(str, one.right.astype(int)))}
            for one in study(config)
        ]
        table = pd.concat([known, pd.DataFrame(rows)[list(known)]]).sort_values(
            "seed", kind="stable"
        )
        write_bytes(
            PUBLISHED, table.to_csv(index=False, lineterminator="\n", float_format="%.4f").encode()
        )


def published() -> pd.DataFrame:
    """The published detectors; none before the first seed."""
    if not PUBLISHED.exists():
        return pd.DataFrame(columns=["seed", "version", "points", "pairs", "ap50", "right"])
    return pd.read_csv(PUBLISHED, dtype={"right": str})


def answer(table: pd.DataFrame) -> str:
    """Share of right snapshots by seed, and the differences over the seeds."""
    if table.empty:
        return "No seed is published."
    table = table.assign(share=table["right"].map(lambda right: right.count("1") / len(right)))
    shares = table.pivot(index="seed", columns="version", values="share")[list(VERSIONS)]
    tests = table["right"].str.len().iloc[0]
    lines = [
        f"{len(shares)} seeds, {tests} test snapshots each.",
        "",
        "| seed | points | pairs covered: `existing`, `covered`, `random` | right: `existing` | `covered` | `random` | AP50 |",
        "|---|---|---|---|---|---|---|",
    ]
    for seed, rows in table.groupby("seed"):
        each = rows.set_index("version").loc[list(VERSIONS)]
        pairs, ap50 = (
            ", ".join(values)
            for values in (map(str, each["pairs"]), (f"{value:.3f}" for value in each["ap50"]))
        )
        right = " | ".join(f"{share:.3f}" for share in each["share"])
        lines.append(
            f"| {seed} | {each['points']['existing']} and {each['points']['covered']} | {pairs} | {right} | {ap50} |"
        )
    lines += [
        "",
        f"| right snapshots | mean difference | {100 * CONFIDENCE:g} % interval over the seeds | shown |",
        "|---|---|---|---|",
    ]
    for version, other in QUESTIONS:
        difference = shares[version] - shares[other]
        low, high = mean_interval(difference, CONFIDENCE)
        shown = "yes" if np.ptp(difference) and not low <= 0 <= high else "no"
        lines.append(
            f"| `{version}` minus `{other}` | {difference.mean():+.3f} | {low:+.3f} to {high:+.3f} | {shown} |"
        )
    return "\n".join(lines)


def main() -> None:
    """The command line: run, answer."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    of_run = commands.add_parser("run")
    of_run.add_argument("seeds", type=int, nargs="+")
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "run":
        run(options.seeds)
    else:
        print(answer(published()))


if __name__ == "__main__":
    main()
