"""Do versions that were retrained as in release 0.2 fail less? That is: on whole frames, and with every layer.

    python benchmarks/default_study.py run 2 --again --keep    a default study in .cache/default_study/2
    python benchmarks/older_recipe.py run 2                    retrain two of its versions again, test and publish them; seven minutes
    python benchmarks/older_recipe.py answer                   the table of docs/results/learning.md

Both recipes take the same steps on the same frames, and their versions execute the same held-out tests.
"""

from __future__ import annotations

import argparse
import shutil
from contextlib import chdir
from pathlib import Path
from textwrap import fill

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

PUBLISHED = Path("docs/results/older-recipe")
VERSIONS = ("random", "adaptive")
OLDER = "-older"
LINE = 138


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+", choices=list(SEEDS))
    execute.add_argument("--threads", type=int, default=2)
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "answer":
        print(answer({int(path.name.split(".")[0]): pd.read_csv(path) for path in sorted(PUBLISHED.glob("*.csv.gz"))}))
        return
    for seed in options.seed:
        with chdir(CLONES / str(seed)):
            outcomes = repeated(load(PARAMS), options.threads)
        write(outcomes, PUBLISHED / f"{seed}.csv.gz")


def repeated(config: Config, threads: int) -> pd.DataFrame:
    """The outcomes of a finished study's versions, and of those that the older recipe makes from its files."""
    today, older = of_study(config), config.model_copy(update={"study": "older"})
    root = Path(Folders(older).root)
    if not root.exists():
        shutil.copytree(Folders(config).root, root)
    vars(retraining).update(CROP_SHARE=1.0, fit=_every_layer)
    held_out = {"kind": "held_out", "strategy": config.comparison.strategy, "seed": str(config.comparison.seed)}
    for version in VERSIONS:
        perform(order_of("retrain", older, {"version": version}, OLDER, threads), older)
        for scenario in config.held_out:
            perform(order_of("campaign", older, {**held_out, "scenario": scenario, "version": version}, OLDER, threads), older)
    again = of_study(older)
    return today[[*TEST, *VERSIONS]].assign(**{f"{name}{OLDER}": again[name] for name in VERSIONS})


def _every_layer(model: Yolo, lesson: Lesson, run: Run) -> Fitted:
    model.stage4.requires_grad_(True)
    return fit(model, lesson, run)


def answer(studies: dict[int, pd.DataFrame]) -> str:
    """Failures of both recipes' versions, and their mean difference over the trainings."""
    if not studies:
        return "No study is published."
    lines = ["| seed | version | tests | today's recipe | release 0.2's |", "|---|---|---|---|---|"]
    pairs = []
    for seed, table in studies.items():
        for name in VERSIONS:
            both = table[[name, f"{name}{OLDER}"]].set_axis(["today", "older"], axis=1)
            both = both[(both != ERROR).all(axis=1)] == FAILED
            pairs.append(both)
            lines.append(f"| {seed} | `{name}` | {len(both)} | {both['today'].sum()} | {both['older'].sum()} |")
    every, differences = pd.concat(pairs), [int(both["today"].sum() - both["older"].sum()) for both in pairs]
    said = (
        f"Versions of today's recipe fail {every['today'].sum()} of {len(every)} held-out tests, those of release 0.2's "
        f"{every['older'].sum()}: a mean difference of {mean_difference(differences)} over {len(pairs)} trainings (95 %)."
    )
    return "\n".join([fill(said, LINE), "", *lines])


if __name__ == "__main__":
    main()
