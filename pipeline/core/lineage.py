"""The model versions of a study: their names, their parents and the campaigns that feed them (thesis chapter 7).

`base` (D_o) is tested first. Each round retrains three kinds from their predecessors: `random` (D_r) and `adaptive` (D_a) on frames of
campaigns against them, `control` on no new data. Retraining with several seeds makes several versions of each kind.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.errors import InputError

RETRAINED = ("control", "random", "adaptive")
PATTERN = r"base|(?:control|random|adaptive)(?:-r(?:[2-9]|[1-9]\d+))?(?:-s\d+)?"
"""Pattern of all version names, as a regular expression."""
NAME = re.compile(r"(control|random|adaptive)(?:-r([2-9]|[1-9]\d+))?(?:-s(\d+))?")


@dataclass(frozen=True)
class Version:
    """A model version. kind: `base`, one of `RETRAINED`, or the name of a detector that a study only tests. round: 0 for versions that
    are not retrained, else from 1. seed: of retraining; None for the study's first seed."""

    kind: str = "base"
    round: int = 0
    seed: int | None = None

    def __str__(self) -> str:
        """Its name: `base`, `adaptive`, `adaptive-r2`, `adaptive-s1`, `adaptive-r2-s1`."""
        return self.kind + (f"-r{self.round}" if self.round > 1 else "") + (f"-s{self.seed}" if self.seed is not None else "")

    @staticmethod
    def named(name: str) -> Version:
        """The version of a name; InputError if it is neither a version's nor a plain word, which names a detector."""
        found = NAME.fullmatch(name)
        if found is None:
            if not re.fullmatch(r"\w+", name):
                raise InputError(f"expected the name of a version, as base or adaptive-r2-s1, got '{name}'")
            return Version(name)
        kind, number, seed = found.groups()
        return Version(kind, int(number or 1), None if seed is None else int(seed))

    @property
    def parent(self) -> Version | None:
        """The version that it was retrained from."""
        if not self.round:
            return None
        return Version() if self.round == 1 else replace(self, round=self.round - 1)

    @property
    def group(self) -> str:
        """The name that versions share if they differ only by their seed."""
        return str(replace(self, seed=None))

    @property
    def tested(self) -> tuple[Version, ...]:
        """The versions whose campaigns feed it, oldest first."""
        return () if self.parent is None else (*self.parent.tested, self.parent)


def versions(rounds: int, seeds: Sequence[int]) -> tuple[Version, ...]:
    """All versions of a study: the base, then by round and kind one version per seed of retraining."""
    suffixes = [None, *seeds[1:]]
    return (Version(), *(Version(kind, number, seed) for number in range(1, rounds + 1) for kind in RETRAINED for seed in suffixes))
