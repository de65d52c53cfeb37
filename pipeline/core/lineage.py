"""The model versions of a study: their names, files and parents, and the campaigns that feed them.

`base` (D_o) is tested first. Each round retrains a version of every arm from its predecessor:
`random` (D_r) and `adaptive` (D_a) on frames of campaigns against it, `control` on no new data.
Retraining with several seeds makes several versions of each arm (thesis chapter 7).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

from pipeline.errors import InputError

BASE = "base"
VERSION_FILES = {
    "card": "model.json",
    "weights": "weights.safetensors",
    "onnx": "model.onnx",
    "curve": "curve.csv",
}
"""The files of a model version."""
WEIGHTS_SUFFIX = ".safetensors"
"""Of our weights. Tests load an ONNX file that is made from them and from the card beside them."""
NAME = re.compile(r"(\w+)(?:-r([2-9]|[1-9]\d+))?(?:-s(\d+))?")


@dataclass(frozen=True)
class Version:
    """A model version.

    arm: its arm in the study, `base`, or the name of a detector that a study only tests.
    round: from 1; 0 for a version that is not retrained.
    seed: of retraining; None for the study's first seed.

    >>> str(Version("adaptive", 2, seed=1)), str(Version("adaptive", 2).parent)
    ('adaptive-r2-s1', 'adaptive')
    """

    arm: str = BASE
    round: int = 0
    seed: int | None = None

    def __str__(self) -> str:
        """Its name: `base`, `adaptive`, `adaptive-r2`, `adaptive-s1`, `adaptive-r2-s1`."""
        name = self.arm
        if self.round > 1:
            name += f"-r{self.round}"
        if self.seed is not None:
            name += f"-s{self.seed}"
        return name

    @staticmethod
    def named(name: str) -> Version:
        """The version of a name, retrained unless it is `base`; InputError for any other text."""
        match = NAME.fullmatch(name)
        if match is None or (match[1] == BASE and name != BASE):
            raise InputError(
                f"expected the name of a version, such as base or adaptive-r2-s1, got '{name}'"
            )
        arm, number, seed = match.groups()
        if arm == BASE:
            return Version()
        return Version(arm, int(number or 1), None if seed is None else int(seed))

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


def versions(arms: Iterable[str], rounds: int, seeds: Sequence[int]) -> tuple[Version, ...]:
    """All versions of a study: the base, then by round, arm and seed of retraining.

    >>> [str(version) for version in versions(["random", "adaptive"], rounds=1, seeds=[0, 1])]
    ['base', 'random', 'random-s1', 'adaptive', 'adaptive-s1']
    """
    retrained = product(range(1, rounds + 1), arms, [None, *seeds[1:]])
    return Version(), *(Version(arm, number, seed) for number, arm, seed in retrained)
