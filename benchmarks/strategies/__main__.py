"""Compares search strategies in worlds that need no rendering.

    python benchmarks/strategies run [--split judging] [--group trees network] [--strategy forest 'forest explore=0'] [--seeds 20]
    python benchmarks/strategies keep [--split judging]
    python benchmarks/strategies answer | choose
    python benchmarks/strategies show [--split judging] [--figure strategies.png]
    python benchmarks/strategies truth
    python benchmarks/strategies models
    python benchmarks/strategies ablation | further
    python benchmarks/strategies bayesian
    python benchmarks/strategies confirmed
    python benchmarks/strategies grid [--figures FOLDER]
    python benchmarks/strategies list

run: every strategy, seed and world; a rerun does only what is missing or was made by other code. keep: publish the finished runs in
benchmarks/strategies/results. answer: which expectations hold. choose: what each strategy finds in 300 tests. show: tables and figure of
the finished runs. truth: how true the emulators are. models: how well the models of the forest and of its variants predict rendered
tests. ablation: what each part of the forest is worth, in the development worlds. further: fresh seeds, transfer, rare failures, options of
evolutionary testing. bayesian: VerifAI's Bayesian sampler in 120 tests. confirmed: what the strategies found in rendered campaigns. grid:
tables and figures of thesis chapter 6 from the recorded campaigns. list: strategies, groups and worlds.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import ablation
import bayesian
import choosing
import confirm
import contestants
import duels
import expected
import former
import further
import grid
import peers
import recorded
import runs
import variants
import worlds
from campaigns import Row, Run
from picture import BUDGETS, failures_against_kinds
from predictions import predictions
from record import BASE
from standings import blocks, markdown, standings
from truth import truth

from pipeline.config.composing import functional_scenario
from pipeline.detectors.yolo.export import onnx_of
from pipeline.errors import InputError
from pipeline.progress import Progress
from pipeline.report.style import save_png

RESULTS = Path("data/strategies")


def main() -> None:
    """Run one of the commands."""
    chosen = {
        "run": _run,
        "keep": _keep,
        "answer": _answer,
        "choose": _choose,
        "show": _show,
        "truth": _truth,
        "models": _models,
        "ablation": _ablation,
        "further": _further,
        "bayesian": _bayesian,
        "confirmed": _confirmed,
        "grid": _grid,
        "list": _list,
    }
    parser = _parser()
    options = parser.parse_args()
    try:
        chosen[options.command](options)
    except InputError as error:
        parser.error(str(error))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="execute what is missing")
    run.add_argument("--group", nargs="+", choices=worlds.GROUPS, default=list(worlds.GROUPS))
    run.add_argument("--scenario", nargs="+", help="default: all of the split")
    run.add_argument("--strategy", nargs="+", help="default: all of conf/sampler and the ceiling")
    run.add_argument("--seeds", type=int, default=20)
    run.add_argument("--first", type=int, help="first seed; default: of the split")
    run.add_argument("--tests", type=int, default=1000)
    run.add_argument("--workers", type=int, default=2)
    show = commands.add_parser("show", help="tables and figure")
    show.add_argument("--reference", default="random")
    show.add_argument("--figure", type=Path, help="PNG of failures against kinds")
    answer = commands.add_parser("answer", help="which expectations hold")
    choose = commands.add_parser("choose", help="what each strategy finds in 300 tests")
    keep = commands.add_parser("keep", help="publish the finished runs in the repository")
    ablate = commands.add_parser("ablation", help="what each part of the forest is worth")
    slow = commands.add_parser("bayesian", help="VerifAI's Bayesian sampler in 120 tests")
    for command in (run, keep, show, answer, choose, ablate, slow):
        split = "judging" if command in (answer, choose, slow) else "development"
        command.add_argument(
            "--split",
            choices=list(worlds.SPLITS),
            default=split,
            help="which scenarios and seeds (default: %(default)s)",
        )
        own = RESULTS / "bayesian.jsonl" if command is slow else None
        command.add_argument(
            "--results", type=Path, default=own, help=f"default: {own or RESULTS / '<split>.jsonl'}"
        )
    check = commands.add_parser("truth", help="cross-validation of the emulators")
    check.add_argument(
        "--scenario",
        nargs="+",
        default=[name for split in worlds.SPLITS.values() for name in split.scenarios],
    )
    commands.add_parser(
        "models", help="how well the forest's models and their variants predict rendered tests"
    )
    commands.add_parser(
        "further", help="fresh seeds, transfer between scenarios, options of evolutionary testing"
    )
    commands.add_parser("confirmed", help="what the strategies found in rendered campaigns")
    grid_ = commands.add_parser("grid", help="tables and figures of thesis chapter 6")
    grid_.add_argument("--figures", type=Path, help="folder for the figures")
    commands.add_parser("list", help="strategies, groups and worlds")
    return parser


def _results(options: argparse.Namespace) -> Path:
    return Path(options.results or RESULTS / f"{options.split}.jsonl")


def _run(options: argparse.Namespace) -> None:
    strategies = options.strategy or [*contestants.known(), contestants.CEILING]
    wanted = [
        Run(str(world), strategy, seed, options.tests)
        for world in worlds.names(options.split, options.group)
        if world.scenario in (options.scenario or [world.scenario])
        for seed in _seeds(options)
        for strategy in strategies
    ]
    with Progress("strategies") as progress:
        runs.run_all(wanted, _results(options), options.workers, progress)


def _seeds(options: argparse.Namespace) -> range:
    first = worlds.SPLITS[options.split].first_seed if options.first is None else options.first
    return range(first, first + options.seeds)


def _keep(options: argparse.Namespace) -> None:
    for path in runs.keep(_results(options)):
        print(path)


def _answer(options: argparse.Namespace) -> None:
    print(duels.answer(duels.ratios(_finished(options))))


def _choose(options: argparse.Namespace) -> None:
    print(choosing.markdown(_finished(options)))


def _show(options: argparse.Namespace) -> None:
    rows = _finished(options)
    tables = {
        (block.group, block.budget): (block, standings(block, options.reference))
        for block in blocks(rows)
    }
    print(
        "\n".join(
            [
                duels.markdown(duels.ratios(rows)),
                "",
                *(markdown(block, table, options.reference) for block, table in tables.values()),
            ]
        )
    )
    drawn = {key: table for key, (_, table) in tables.items() if key[1] in BUDGETS}
    if options.figure and drawn:
        save_png(failures_against_kinds(drawn), options.figure)


def _finished(options: argparse.Namespace) -> list[Row]:
    rows = runs.read(_results(options))
    if not rows:
        raise InputError(
            f"{_results(options)}: no finished runs; make them with `python benchmarks/strategies run --split {options.split}`"
        )
    return rows


def _truth(options: argparse.Namespace) -> None:
    recordings = [
        (name, recorded.read(name, functional_scenario(name).logical_space()))
        for name in options.scenario
    ]
    for name, recording in recordings:
        if recording.errors:
            print(f"{name}: {recording.errors} tests ended in an error and are left out")
    print(truth(recordings).to_markdown(index=False, floatfmt=".3f"))


def _models(options: argparse.Namespace) -> None:
    print(predictions().to_markdown(index=False, floatfmt=".3f"))


def _ablation(options: argparse.Namespace) -> None:
    print(ablation.markdown(_finished(options)))


def _further(options: argparse.Namespace) -> None:
    print(further.markdown(*(runs.read(RESULTS / f"{name}.jsonl") for name in further.FILES)))


def _bayesian(options: argparse.Namespace) -> None:
    print(bayesian.markdown(_finished(options), runs.read(RESULTS / f"{options.split}.jsonl")))
    for budget, name in ((bayesian.BUDGET, "kinds"), (bayesian.LATER, "longer")):
        print(f"\nIn the development worlds, as recorded, after {budget} tests:\n")
        print(bayesian.of_kinds(runs.read(RESULTS / f"{name}.jsonl"), budget))


def _confirmed(options: argparse.Namespace) -> None:
    print(confirm.answer(confirm.measured()))


def _grid(options: argparse.Namespace) -> None:
    campaigns = grid.read()
    print(expected.expectations(campaigns))
    print(grid.markdown(campaigns))
    if not options.figures:
        return
    for name, figure in grid.figures(campaigns, grid.threshold_s()):
        save_png(figure, options.figures / f"thesis-{name}.png")
    if most := grid.most_failing(campaigns):
        with tempfile.TemporaryDirectory() as folder:
            picture = grid.extracts(most, onnx_of(BASE, Path(folder)))
        picture.save(options.figures / "thesis-extracts.jpg", quality=85)


def _list(options: argparse.Namespace) -> None:
    print("strategies:", *contestants.known(), contestants.CEILING)
    print("variants:", *variants.VARIANTS)
    print("former:", *former.SAMPLERS)
    print("peers:", *peers.PEERS)
    for split in worlds.SPLITS:
        print(f"{split}:", *worlds.names(split, worlds.GROUPS))


if __name__ == "__main__":
    main()
