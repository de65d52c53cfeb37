"""Flips bits in files of a finished study, lets `./run` repair them, and compares the study with the undamaged one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from damage_faults import flipped
from fault_report import Row
from fault_study import FaultStudy, Outcome, Run
from kill_faults import say

WAYS = ("made again", "named", "unseen")
TOGETHER = "a file of each kind at once"


def repairs(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each kind of file, after so many flips: in one file of each kind, then in others. A last row for all kinds at once."""
    rng = np.random.default_rng(seed)
    if (first := study.run()).code:
        raise SystemExit(f"the undamaged run failed: {' | '.join(first.said[-3:])}")
    whole = study.outcome()
    found: Counter[tuple[str, str]] = Counter()
    files = in_turn([study.data / name for name in whole.files], rng)
    for file in files[:count]:
        found[kind_of(file), repaired(study, whole, [file], rng)] += 1
    kinds = sorted({kind for kind, _ in found})
    together = list({kind_of(file): file for file in files}.values())  # The last of each kind.
    found[TOGETHER, repaired(study, whole, together, rng)] += len(together)
    return [
        Row("repair", kind, sum(found[kind, way] for way in WAYS), found[kind, "unseen"], {way: found[kind, way] for way in WAYS})
        for kind in (*kinds, TOGETHER)
    ]


def repaired(study: FaultStudy, whole: Outcome, files: Sequence[Path], rng: np.random.Generator) -> str:
    """Flip a bit in each of the files, then `./run`: one of `WAYS`. The study is the undamaged one again afterwards."""
    kept = {file: file.read_bytes() for file in files}
    for file, content in kept.items():
        file.write_bytes(flipped(content, int(rng.integers(8 * len(content)))))
    done = study.run()
    differences = study.outcome().differences(whole)
    way = judged(done, files, differences)
    say(f"{len(files)} damaged, the first {files[0].relative_to(study.folder)}: {way}")
    if way != "made again":
        say("; ".join([*done.said[-2:], *differences]))
    if differences:
        for file, content in kept.items():
            file.write_bytes(content)
    return way


def in_turn(files: Sequence[Path], rng: np.random.Generator) -> list[Path]:
    """The files that are not empty in random order, but one of each kind first."""
    shuffled = [files[place] for place in rng.permutation(len(files)) if files[place].stat().st_size]
    first = {kind_of(file): file for file in shuffled}
    return [*first.values(), *(file for file in shuffled if file not in first.values())]


def kind_of(file: Path) -> str:
    """A file's name without its numbers; stamps and images by their suffix."""
    return f"*{file.suffix}" if file.suffix in (".stamp", ".jpg", ".txt") else re.sub(r"\d+", "N", file.name)


def judged(run: Run, files: Sequence[Path], differences: Sequence[str]) -> str:
    """What became of damaged files, if the run named each of them: `made again` or, with exit code 2, `named`; otherwise `unseen`."""
    named = all(any(file.name in line for line in run.said) for file in files)
    if named and run.code == 0 and not differences:
        return "made again"
    return "named" if named and run.code == 2 else "unseen"
