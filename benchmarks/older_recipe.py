"""Do versions that were retrained as in release 0.2 fail less? That is: on whole frames, and with every layer.

    python benchmarks/default_study.py run 2 --again --keep    a default study in .cache/default_study/2
    python benchmarks/older_recipe.py run 2                    retrain two of its versions again, test and publish them; seven minutes
    python benchmarks/older_recipe.py run 2 --same-time        the same in as much time as today's recipe takes, with fewer steps
    python benchmarks/older_recipe.py answer                   the tables of docs/results/learning.md

Both recipes learn from the same frames, and their versions execute the same held-out tests.
"""

from __future__ import annotations

import argparse
import shutil
from contextlib import chdir
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
from default_study import CLONES, SEEDS
from outcomes import ERROR, FAILED, TEST, mean_difference, of_study, write

from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.contract import order_of, perform
from pipeline.detectors.yolo import retraining
from pipeline.detectors.yolo.network import Yolo
from pipeline.detectors.yolo.training import Fitted, Lesson, Run, fit

VERSIONS = ("random", "adaptive")
LINE = 138


class Older(NamedTuple):
    """Release 0.2's recipe. folder: of its published outcomes. steps: how many it takes for each of today's."""

    study: str
    folder: Path
    said: str
    steps: float

    @property
    def suffix(self) -> str:
        return f"-{self.study}"


SAME_STEPS = Older("older", Path("docs/results/older-recipe"), "In as many steps", 1)
SAME_TIME = Older("shorter", Path("docs/results/shorter-recipe"), "In as much time", 1 / 1.94)
"""By the published median ratio of images per second (retraining_speed.py)."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+", choices=list(SEEDS))
    execute.add_argument("--threads", type=int, default=2)
    execute.add_argument(
        "--same-time",
        action="store_true",
        help="stop the older recipe when today's would have ended",
    )
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "answer":
        print("\n\n".join(answer(older, published(older)) for older in (SAME_STEPS, SAME_TIME)))
        return
    older = SAME_TIME if options.same_time else SAME_STEPS
    for seed in options.seed:
        with chdir(CLONES / str(seed)):
            outcomes = repeated(load(PARAMS), older, options.threads)
        write(outcomes, older.folder / f"{seed}.csv.gz")


def published(older: Older) -> dict[int, pd.DataFrame]:
    return {
        int(path.name.split(".")[0]): pd.read_csv(path)
        for path in sorted(older.folder.glob("*.csv.gz"))
    }


def repeated(config: Config, recipe: Older, threads: int) -> pd.DataFrame:
    """The outcomes of a finished study's versions, and of those that the older recipe makes from its files."""
    steps = round(config.retraining.iterations * recipe.steps)
    older = config.model_copy(
        update={
            "study": recipe.study,
            "retraining": config.retraining.model_copy(update={"iterations": steps}),
        }
    )
    today, root = of_study(config), Path(Folders(older).root)
    if not root.exists():
        shutil.rmtree(half := root.with_name(f"{root.name}.half"), ignore_errors=True)
        shutil.copytree(Folders(config).root, half).rename(root)
    vars(retraining).update(CROP_SHARE=1.0, fit=_every_layer)
    held_out = {
        "kind": "held_out",
        "strategy": config.comparison.strategy,
        "seed": str(config.comparison.seed),
    }
    for version in VERSIONS:
        perform(order_of("retrain", older, {"version": version}, recipe.suffix, threads), older)
        for scenario in config.held_out:
            perform(
                order_of(
                    "campaign",
                    older,
                    {**held_out, "scenario": scenario, "version": version},
                    recipe.suffix,
                    threads,
                ),
                older,
            )
    again = of_study(older)
    return today[[*TEST, *VERSIONS]].assign(
        **{f"{name}{recipe.suffix}": again[name] for name in VERSIONS}
    )


def _every_layer(model: Yolo, lesson: Lesson, run: Run) -> Fitted:
    model.stage4.requires_grad_(True)
    return fit(model, lesson, run)


def answer(older: Older, studies: dict[int, pd.DataFrame]) -> str:
    """Failures of both recipes' versions, and their mean difference a training, over seeds: versions of one seed share base and tests."""
    if not studies:
        return "No study is published."
    lines = ["| seed | version | tests | today's recipe | release 0.2's |", "|---|---|---|---|---|"]
    pairs = []
    for seed, table in studies.items():
        for name in VERSIONS:
            both = table[[name, f"{name}{older.suffix}"]].set_axis(["today", "older"], axis=1)
            both = both[(both != ERROR).all(axis=1)] == FAILED
            pairs.append(both)
            lines.append(
                f"| {seed} | `{name}` | {len(both)} | {both['today'].sum()} | {both['older'].sum()} |"
            )
    every = pd.concat(pairs)
    differences = np.reshape(
        [both["today"].sum() - both["older"].sum() for both in pairs], (-1, len(VERSIONS))
    ).mean(axis=1)
    said = (
        f"{older.said}, versions of today's recipe fail {every['today'].sum()} of {len(every)} held-out tests, those of release 0.2's "
        f"{every['older'].sum()}: a mean difference of {mean_difference(differences)} a training over {len(studies)} seeds (95 %)."
    )
    return "\n".join([fill(said, LINE), "", *lines])


if __name__ == "__main__":
    main()
