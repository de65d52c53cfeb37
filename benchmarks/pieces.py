"""An experiment in pieces: studies that differ in a few settings, each composed, executed and published on its own."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from outcomes import TEST, of_study, write
from what_is_left import what_is_left

from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, compose, load
from pipeline.config.schema import Config
from pipeline.errors import shown
from pipeline.report.style import save_png
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.staleness import Staleness
from pipeline.workflow.stamping import Stamps

RESULTS = Path("docs/results")

Piece = tuple[str, int]
"""Kind and seed: the searches, the retraining and perhaps the held-out tests of a piece have a seed of their own."""


@dataclass(frozen=True)
class Experiment:
    """A script `benchmarks/<name>.py` and its page. compose: the arguments of `compose` by piece.

    versions: those that a kind publishes; None for all. explained: the version of a kind whose failures are executed again, with parts of
    the loop replaced. figure: of the published pieces, for the page. study_of: the study of a kind, where it is another one.
    """

    name: str
    study: str
    compose: Mapping[Piece, str]
    versions: Callable[[str], Sequence[str] | None] = lambda kind: None
    explained: Callable[[str], str | None] = lambda kind: None
    figure: Callable[[Mapping[Piece, pd.DataFrame]], Figure] | None = None
    study_of: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        return RESULTS / self.name.replace("_", "-")

    def path(self, piece: Piece) -> Path:
        return self.folder / f"{piece[0]}-{piece[1]}.csv.gz"

    def left(self, piece: Piece) -> Path:
        """Where a piece publishes what repairs the failures that are left."""
        return self.folder / f"left-{piece[0]}-{piece[1]}.csv"

    def published(self) -> dict[Piece, pd.DataFrame]:
        """The outcomes of all published pieces."""
        return {
            piece: pd.read_csv(self.path(piece))
            for piece in self.compose
            if self.path(piece).exists()
        }

    def overrides(self, piece: Piece) -> list[str]:
        """The arguments of `compose` after the study."""
        return [
            f"seeds=[{piece[1]}]",
            f"retraining.seeds=[{piece[1]}]",
            *self.compose[piece].split(),
        ]

    def plan(self) -> str:
        """The commands of every piece, and which are published."""
        lines = []
        for kind, seed in self.compose:
            lines += [
                f"# {kind}, seed {seed}: {'published' if self.path((kind, seed)).exists() else 'missing'}"
            ]
            lines += [
                " ".join(
                    [
                        "python -m pipeline compose",
                        f"study={self.study_of.get(kind, self.study)}",
                        *self.overrides((kind, seed)),
                    ]
                )
            ]
            lines += [f"./run && python benchmarks/{self.name}.py keep {kind} {seed}"]
        return "\n".join(lines)

    def keep(self, piece: Piece) -> Path:
        """Publish the piece that data/<study> holds; SystemExit if that is unfinished, or if it or params.yaml is of another piece."""
        config = load(PARAMS)
        self._check(piece, config)
        outcomes, versions = of_study(config), self.versions(piece[0])
        _check_made(config)
        if versions is not None:
            outcomes = outcomes[[*TEST, *versions]]
        self.folder.mkdir(parents=True, exist_ok=True)
        # The outcomes come last, so that a published piece is complete even after a kill.
        if (version := self.explained(piece[0])) is not None:
            what_is_left(config, version, list(config.held_out)).to_csv(self.left(piece))
        write(outcomes, self.path(piece))
        self.draw()
        return self.path(piece)

    def draw(self) -> None:
        """Draw the page's figure, if it has one."""
        if self.figure is not None:
            save_png(self.figure(self.published()), self.folder.with_suffix(".png"))

    def _check(self, piece: Piece, config: Config) -> None:
        """SystemExit that names the first other key unless a config is the one that the piece's command composes."""
        name = f"{piece[0]} {piece[1]}"
        if piece not in self.compose:
            raise SystemExit(f"keep: expected a piece that `plan` lists, got {name}")
        expected = compose(self.study_of.get(piece[0], self.study), self.overrides(piece))
        if wrong := difference(expected.model_dump(mode="json"), config.model_dump(mode="json")):
            raise SystemExit(
                f"{PARAMS}, piece {name}: {wrong}; compose and execute the piece as `plan` says"
            )

    def main(
        self, description: str | None, answer: Callable[[Mapping[Piece, pd.DataFrame]], str]
    ) -> None:
        """The script's command line: plan, keep, answer and, with a figure, draw."""
        parser = argparse.ArgumentParser(
            description=description, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        commands = parser.add_subparsers(dest="command", required=True)
        commands.add_parser("plan")
        keep = commands.add_parser("keep")
        keep.add_argument("kind", choices=list(dict.fromkeys(kind for kind, _ in self.compose)))
        keep.add_argument(
            "seed", type=int, choices=list(dict.fromkeys(seed for _, seed in self.compose))
        )
        commands.add_parser("answer")
        if self.figure is not None:
            commands.add_parser("draw", help="the page's figure; `keep` draws it, too")
        options = parser.parse_args()
        if options.command == "plan":
            print(self.plan())
        elif options.command == "keep":
            print(self.keep((options.kind, options.seed)))
        elif options.command == "draw":
            self.draw()
        else:
            print(answer(self.published()))


def _check_made(config: Config) -> None:
    """SystemExit for held-out tests that other settings or other code made: params.yaml may be newer than the data."""
    jobs = Jobs(config, step_names())
    staleness = Staleness(Stamps(jobs))
    for path in Folders(config).held_out("tests.parquet"):
        job = jobs.maker(path)
        if job is not None and staleness.out_of_date(job):
            reasons = ", ".join(staleness.reasons(job))
            raise SystemExit(
                f"{path}: expected the tests of {PARAMS}, got those of other settings or code ({reasons}); execute ./run"
            )


def difference(expected: Mapping[str, Any], got: Mapping[str, Any]) -> str:
    """The first dotted key of plain data with another value than expected, and both values; empty if there is none."""
    wanted, found = _leaves(expected), _leaves(got)
    for key in [*wanted, *found]:
        if key not in wanted or key not in found or wanted[key] != found[key]:
            values = [
                shown(leaves[key]) if key in leaves else "nothing" for leaves in (wanted, found)
            ]
            return f"{key}: expected {values[0]}, got {values[1]}"
    return ""


def _leaves(plain: Any, key: str = "") -> dict[str, Any]:
    """The values of nested tables by dotted key; an empty table is a value."""
    if not isinstance(plain, dict) or not plain:
        return {key: plain}
    return {
        leaf: value
        for name, part in plain.items()
        for leaf, value in _leaves(part, f"{key}.{name}" if key else name).items()
    }
