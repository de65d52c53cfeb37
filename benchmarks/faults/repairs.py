"""Flips bits in files of a finished study and lets `./run` make them again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.faults.damage import flipped
from benchmarks.faults.report import Row
from benchmarks.faults.study import FaultStudy, Outcome, Run, say
from pipeline.artefacts.files import read_json, write_json

STATE = ".cache/repairs.json"
WAYS = ("made again", "named", "unseen")
TOGETHER = "a file of each kind at once"


@dataclass
class State:
    """An unfinished benchmark.

    whole: the undamaged study. ends: for each repair, the kind of its files, their number, and one
    of `WAYS`.
    """

    seed: int
    whole: Outcome
    ends: list[tuple[str, int, str]] = field(default_factory=list)


def repairs(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each kind of file; resumes after its last repair.

    First one file of each kind is damaged at once, then `count` files alone, of different kinds
    first.
    """
    state = resumed(study, seed)
    files = in_turn([study.data / name for name in state.whole.files], np.random.default_rng(seed))
    together = list({kind_of(file): file for file in files}.values())  # The last of each kind.
    tasks = [(TOGETHER, together), *((kind_of(file), [file]) for file in files[:count])]
    for number, (kind, damaged) in enumerate(tasks[len(state.ends) :], len(state.ends)):
        way = repaired(study, state.whole, damaged, np.random.default_rng([seed, number]))
        state.ends.append((kind, len(damaged), way))
        write_json(study.folder / STATE, asdict(state))
    rows = []
    for kind in sorted({kind for kind, _, _ in state.ends}):
        outcomes = dict.fromkeys(WAYS, 0)
        for other, number, way in state.ends:
            outcomes[way] += number if other == kind else 0
        rows.append(Row("repair", kind, sum(outcomes.values()), outcomes["unseen"], outcomes))
    return rows


def resumed(study: FaultStudy, seed: int) -> State:
    """The state of an earlier benchmark of the seed, or of the undamaged study; finishes it."""
    path = study.folder / STATE
    if (first := study.run()).code:
        raise SystemExit(f"the undamaged run failed: {' | '.join(first.output[-3:])}")
    if path.exists() and (stored := read_json(path))["seed"] == seed:
        ends = [(kind, number, way) for kind, number, way in stored["ends"]]
        return State(seed, Outcome(**stored["whole"]), ends)
    state = State(seed, study.outcome())
    write_json(path, asdict(state))
    return state


def repaired(
    study: FaultStudy, whole: Outcome, files: Sequence[Path], rng: np.random.Generator
) -> str:
    """Flip a bit in each file, then `./run`; returns one of `WAYS`.

    Files that are not made again get their old content back.
    """
    kept = {file: file.read_bytes() for file in files}
    for file, content in kept.items():
        file.write_bytes(flipped(content, int(rng.integers(8 * len(content)))))
    run = study.run()
    differences = study.outcome().differences(whole)
    way = judged(run, files, differences)
    say(f"{', '.join(str(file.relative_to(study.data)) for file in files)}: {way}")
    if way != "made again":
        say("; ".join([*run.output[-2:], *differences]))
    if differences:
        for file, content in kept.items():
            file.write_bytes(content)
    return way


def in_turn(files: Sequence[Path], rng: np.random.Generator) -> list[Path]:
    """The files that are not empty in random order, but one of each kind first."""
    order = [files[place] for place in rng.permutation(len(files))]
    shuffled = [file for file in order if file.stat().st_size]
    first = {kind_of(file): file for file in shuffled}
    return [*first.values(), *(file for file in shuffled if file not in first.values())]


def kind_of(file: Path) -> str:
    """A file's name without its numbers; stamps and images by their suffix."""
    if file.suffix in (".stamp", ".jpg", ".txt"):
        return f"*{file.suffix}"
    return re.sub(r"\d+", "N", file.name)


def judged(run: Run, files: Sequence[Path], differences: Sequence[str]) -> str:
    """The way in which damaged files ended; `unseen` unless the run named each of them."""
    output = "\n".join(run.output)
    if not all(file.name in output for file in files):
        return "unseen"
    if run.code == 0 and not differences:
        return "made again"
    return "named" if run.code == 2 else "unseen"
