"""Sizes of plans of mixed strength on public examples, beside the plans of strength 2 and 3 that they replace.

    python benchmarks/mixed_strength.py [--seconds 20]

The examples have the shapes of Cohen, Gibbons, Mugridge, Colbourn and Collofello's (Variable strength interaction testing of components,
2003). --seconds: of polishing where the quick plan is above its bound; 0 for none.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.arrays import Effort, covering_array
from pipeline.core.coverage.mixed import Extras, Mixed, NamedPlanes
from pipeline.core.coverage.verification import verify

SPACES: dict[str, tuple[tuple[int, ...], tuple[tuple[range, ...], ...]]] = {
    "3^15": (
        (3,) * 15,
        (
            (range(3),),
            (range(3), range(3, 6), range(6, 9)),
            (range(4),),
            (range(5),),
            (range(6),),
            (range(7),),
            (range(9),),
        ),
    ),
    "4^3 5^3 6^2": (
        (4,) * 3 + (5,) * 3 + (6,) * 2,
        ((range(3),), (range(3), range(3, 6)), (range(5),), (range(5, 8),), (range(7),)),
    ),
}
"""The sizes of a space, and groups of conditions that are combined by threes; all are combined by twos."""


def plan(sizes: tuple[int, ...], mixed: Mixed, seconds: float) -> str:
    """The sizes of the quick and the polished plan, both verified, and the bound."""
    limits = Constraints(sizes)
    array = quick = covering_array(limits, mixed)
    if seconds and quick.size > quick.lower_bound:
        array = covering_array(limits, mixed, effort=Effort(seconds))
    assert verify(quick.rows, limits, mixed).valid and verify(array.rows, limits, mixed).valid
    return f"{quick.lower_bound:>7}{quick.size:>7}{min(array.size, quick.size):>10}"


def written(sizes: Sequence[int]) -> str:
    """Sizes in the exponential notation of covering arrays."""
    return " ".join(f"{size}^{list(sizes).count(size)}" for size in sorted(set(sizes)))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    print(f"{'space':13}{'by threes':22}{'bound':>7}{'quick':>7}{'polished':>10}")
    for name, (sizes, several) in SPACES.items():
        print(f"{name:13}{'none':22}{plan(sizes, Mixed(2), seconds)}", flush=True)
        for groups in several:
            extras = Extras(
                tuple(NamedPlanes(str(i), tuple(group), 3) for i, group in enumerate(groups))
            )
            label = ", ".join(written([sizes[v] for v in group]) for group in groups)
            print(f"{name:13}{label:22}{plan(sizes, Mixed(2, extras), seconds)}", flush=True)
        print(f"{name:13}{'all':22}{plan(sizes, Mixed(3), seconds)}", flush=True)


if __name__ == "__main__":
    main()
