"""Flips a bit in one file of a finished study after the other, lets `./run` repair it, and compares the study with the undamaged one."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
from damage_faults import flipped
from fault_report import Row
from fault_study import FaultStudy, Run
from kill_faults import say


def repairs(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each kind of file, after so many flips: in one file of each kind, then in others."""
    rng = np.random.default_rng(seed)
    if (first := study.run()).code:
        raise SystemExit(f"the undamaged run failed: {' | '.join(first.said[-3:])}")
    whole = study.outcome()
    found: Counter[tuple[str, str]] = Counter()
    files = in_turn([study.folder / "data/smoke" / name for name in whole.files], rng)
    for file in files[:count]:
        kept = file.read_bytes()
        file.write_bytes(flipped(kept, int(rng.integers(8 * len(kept)))))
        done = study.run()
        differences = study.outcome().differences(whole)
        way = judged(done, file, differences)
        found[kind_of(file), way] += 1
        say(f"{file.relative_to(study.folder)}: {way}{'' if way == 'made again' else ': ' + '; '.join([*done.said[-2:], *differences])}")
        if differences:
            file.write_bytes(kept)
    return [
        Row(
            "repair",
            kind,
            sum(number for (other, _), number in found.items() if other == kind),
            found[kind, "unseen"],
            {way: found[kind, way] for way in ("made again", "named", "unseen")},
        )
        for kind in sorted({kind for kind, _ in found})
    ]


def in_turn(files: list[Path], rng: np.random.Generator) -> list[Path]:
    """The files that are not empty in random order, but one of each kind first."""
    shuffled = [files[place] for place in rng.permutation(len(files)) if files[place].stat().st_size]
    first = {kind_of(file): file for file in shuffled}
    return [*first.values(), *(file for file in shuffled if file not in first.values())]


def kind_of(file: Path) -> str:
    """A file's name without its numbers; stamps and images by their suffix."""
    return f"*{file.suffix}" if file.suffix in (".stamp", ".jpg", ".txt") else re.sub(r"\d+", "N", file.name)


def judged(run: Run, file: Path, differences: list[str]) -> str:
    """What became of a damaged file: `made again`, `named` with exit code 2, or `unseen`."""
    if run.code == 0 and not differences:
        return "made again"
    named = run.code == 2 and any(file.name in line for line in run.said)
    return "named" if named else "unseen"
