"""An experiment in pieces: studies that differ in a few settings, each composed, executed and published on its own."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from outcomes import TEST, of_study, write

RESULTS = Path("docs/results")

Piece = tuple[str, int]
"""Kind and seed: the searches, the retraining and perhaps the held-out tests of a piece have a seed of their own."""


@dataclass(frozen=True)
class Experiment:
    """A script `benchmarks/<name>.py` and its page. compose: the arguments of `compose` by piece.

    versions: those that a kind publishes; None for all. more: publishes what else the page shows, once the outcomes are written.
    """

    name: str
    study: str
    compose: Mapping[Piece, str]
    versions: Callable[[str], Sequence[str] | None] = lambda kind: None
    more: Callable[[Path], None] = lambda path: None

    @property
    def folder(self) -> Path:
        return RESULTS / self.name.replace("_", "-")

    def path(self, piece: Piece) -> Path:
        return self.folder / f"{piece[0]}-{piece[1]}.csv.gz"

    def published(self) -> dict[Piece, pd.DataFrame]:
        """The outcomes of all published pieces."""
        return {piece: pd.read_csv(self.path(piece)) for piece in self.compose if self.path(piece).exists()}

    def plan(self) -> str:
        """The commands of every piece, and which are published."""
        lines = []
        for (kind, seed), arguments in self.compose.items():
            lines += [f"# {kind}, seed {seed}: {'published' if self.path((kind, seed)).exists() else 'missing'}"]
            lines += [f"python -m pipeline compose study={self.study} seeds=[{seed}] retraining.seeds=[{seed}] {arguments}".rstrip()]
            lines += [f"./run && python benchmarks/{self.name}.py keep {kind} {seed}"]
        return "\n".join(lines)

    def keep(self, piece: Piece) -> Path:
        """Publish the piece that data/<study> holds; SystemExit if that is unfinished or of another seed."""
        outcomes = of_study(Path("data") / self.study, piece[1])
        versions = self.versions(piece[0])
        write(outcomes if versions is None else outcomes[[*TEST, *versions]], self.path(piece))
        self.more(self.path(piece))
        return self.path(piece)

    def main(self, description: str | None, answer: Callable[[Mapping[Piece, pd.DataFrame]], str]) -> None:
        """The script's command line: plan, keep, answer."""
        parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
        commands = parser.add_subparsers(dest="command", required=True)
        commands.add_parser("plan")
        keep = commands.add_parser("keep")
        keep.add_argument("kind", choices=list(dict.fromkeys(kind for kind, _ in self.compose)))
        keep.add_argument("seed", type=int, choices=list(dict.fromkeys(seed for _, seed in self.compose)))
        commands.add_parser("answer")
        options = parser.parse_args()
        if options.command == "plan":
            print(self.plan())
        elif options.command == "keep":
            print(self.keep((options.kind, options.seed)))
        else:
            print(answer(self.published()))
