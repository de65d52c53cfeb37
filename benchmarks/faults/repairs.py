"""Flips bits in files of a finished study, lets `./run` repair them, and compares the study with the undamaged one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.faults.damage import flipped
from benchmarks.faults.kills import say
from benchmarks.faults.report import Row
from benchmarks.faults.study import FaultStudy, Outcome, Run
from pipeline.artefacts.files import read_json, write_json

STATE = ".cache/repairs.json"
WAYS = ("made again", "named", "unseen")
TOGETHER = "a file of each kind at once"


@dataclass
class State:
    """What is known so far: the undamaged study, and each repair: the kind of its files, their number, and how it ended."""

    seed: int
    whole: Outcome
    ends: list[tuple[str, int, str]] = field(default_factory=list)


def repairs(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each kind of file: first one of each kind at once, then `count` alone, those of different kinds first.

    A killed benchmark resumes after its last repair.
    """
    state = _resumed(study, seed)
    files = in_turn([study.data / name for name in state.whole.files], np.random.default_rng(seed))
    together = list({kind_of(file): file for file in files}.values())  # The last of each kind.
    tasks = [(TOGETHER, together), *((kind_of(file), [file]) for file in files[:count])]
    for number, (kind, damaged) in enumerate(tasks[len(state.ends) :], len(state.ends)):
        way = repaired(study, state.whole, damaged, np.random.default_rng([seed, number]))
        state.ends.append((kind, len(damaged), way))
        write_json(study.folder / STATE, asdict(state))
    return [
        _row(kind, [end for end in state.ends if end[0] == kind])
        for kind in sorted({kind for kind, _, _ in state.ends})
    ]


def _resumed(study: FaultStudy, seed: int) -> State:
    """The state of an earlier benchmark of the same seed in the same clone, or of an undamaged study. It finishes the study in any case."""
    path = study.folder / STATE
    if (first := study.run()).code:
        raise SystemExit(f"the undamaged run failed: {' | '.join(first.said[-3:])}")
    if path.exists() and (known := read_json(path))["seed"] == seed:
        return State(
            seed,
            Outcome(**known["whole"]),
            [(kind, number, way) for kind, number, way in known["ends"]],
        )
    state = State(seed, study.outcome())
    write_json(path, asdict(state))
    return state


def repaired(
    study: FaultStudy, whole: Outcome, files: Sequence[Path], rng: np.random.Generator
) -> str:
    """Flip a bit in each of the files, then `./run`: one of `WAYS`. The files have their old content if they are not made again."""
    kept = {file: file.read_bytes() for file in files}
    for file, content in kept.items():
        file.write_bytes(flipped(content, int(rng.integers(8 * len(content)))))
    done = study.run()
    differences = study.outcome().differences(whole)
    way = judged(done, files, differences)
    say(f"{', '.join(str(file.relative_to(study.data)) for file in files)}: {way}")
    if way != "made again":
        say("; ".join([*done.said[-2:], *differences]))
    if differences:
        for file, content in kept.items():
            file.write_bytes(content)
    return way


def in_turn(files: Sequence[Path], rng: np.random.Generator) -> list[Path]:
    """The files that are not empty in random order, but one of each kind first."""
    shuffled = [
        files[place] for place in rng.permutation(len(files)) if files[place].stat().st_size
    ]
    first = {kind_of(file): file for file in shuffled}
    return [*first.values(), *(file for file in shuffled if file not in first.values())]


def kind_of(file: Path) -> str:
    """A file's name without its numbers; stamps and images by their suffix."""
    return (
        f"*{file.suffix}"
        if file.suffix in (".stamp", ".jpg", ".txt")
        else re.sub(r"\d+", "N", file.name)
    )


def judged(run: Run, files: Sequence[Path], differences: Sequence[str]) -> str:
    """What became of damaged files, if the run named each of them: `made again` or, with exit code 2, `named`; otherwise `unseen`."""
    named = all(any(file.name in line for line in run.said) for file in files)
    if named and run.code == 0 and not differences:
        return "made again"
    return "named" if named and run.code == 2 else "unseen"


def _row(kind: str, ends: Sequence[tuple[str, int, str]]) -> Row:
    outcomes = {way: sum(number for _, number, other in ends if other == way) for way in WAYS}
    return Row("repair", kind, sum(outcomes.values()), outcomes["unseen"], outcomes)
