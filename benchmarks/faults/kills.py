"""Kills `./run` with -9 in each of its phases, resumes it, and compares it with a whole run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np

from benchmarks.faults.report import Row
from benchmarks.faults.study import FaultStudy, Outcome, Run, say
from pipeline.artefacts.files import read_json, write_json

STATE = ".cache/kills.json"


@dataclass
class State:
    """An unfinished benchmark.

    whole: the uninterrupted study. durations: seconds of its phases. passes: for each study, the
    phases in which it was killed, and its errors.
    """

    seed: int
    whole: Outcome
    durations: dict[str, float]
    passes: list[tuple[list[str], list[str]]] = field(default_factory=list)

    @property
    def kills(self) -> int:
        """Number of kills so far."""
        return sum(len(phases) for phases, _ in self.passes)


def kills(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each phase after at least `count` kills; resumes after its last finished pass."""
    path = study.folder / STATE
    stored = read_json(path) if path.exists() else None
    if stored is not None and stored["seed"] == seed:
        passes = [(list(phases), list(errors)) for phases, errors in stored["passes"]]
        state = State(seed, Outcome(**stored["whole"]), stored["durations"], passes)
    else:
        study.clear()
        say("an uninterrupted run")
        first = study.run()
        if errors := errors_of(first):
            raise SystemExit(f"the uninterrupted run failed: {errors}")
        state = State(seed, study.outcome(), first.durations())
        write_json(path, asdict(state))
    while state.kills < count:
        rng = np.random.default_rng([seed, len(state.passes)])
        aims = targets(state.durations, count - state.kills, rng)
        state.passes.append(one_pass(study, state.whole, aims))
        write_json(path, asdict(state))
    return rows(state)


def targets(
    durations: dict[str, float], count: int, rng: np.random.Generator
) -> list[tuple[str, float]]:
    """Up to `count` phases in their order, and the seconds after which each is killed."""
    names = list(durations)
    chosen = sorted(rng.choice(len(names), size=min(count, len(names)), replace=False))
    return [(names[place], float(rng.uniform(0, durations[names[place]]))) for place in chosen]


def one_pass(
    study: FaultStudy, whole: Outcome, aims: Sequence[tuple[str, float]]
) -> tuple[list[str], list[str]]:
    """Make a study with a kill in each phase; returns the phases of the kills, and the errors."""
    study.clear()
    killed: list[str] = []
    errors: list[str] = []
    for place, (_, seconds) in enumerate(aims):
        later = {name for name, _ in aims[place:]}
        run = study.run(partial(due, later, seconds))
        if run.code == -9:
            killed.append(run.killed_in)
            say(f"kill {len(killed)} of {len(aims)} in {run.killed_in}, after {run.seconds:.0f} s")
        else:
            errors += errors_of(run)
    errors += errors_of(study.run())
    errors += [f"differs: {part}" for part in study.outcome().differences(whole)]
    say(f"a study with {len(killed)} kills is {'; '.join(errors) or 'the same'}")
    return killed, errors


def due(phases: set[str], seconds: float, phase: str) -> float | None:
    """The seconds after which a run is killed in a phase; None in other phases."""
    return seconds if phase in phases else None


def errors_of(run: Run) -> list[str]:
    """The errors of a run that should have ended well."""
    errors = ["a traceback"] if any("Traceback" in line for line in run.output) else []
    if run.code:
        last = " | ".join(run.output[-3:])
        errors.append(f"exit code {run.code} in {run.killed_in}: {last}")
    return errors


def rows(state: State) -> list[Row]:
    """A row for each phase: its kills, and how many of the studies with them differ."""
    count, wrong = Counter[str](), Counter[str]()
    for phases, errors in state.passes:
        count.update(phases)
        wrong.update(phases if errors else [])
    table = []
    for phase in [*state.durations, *sorted(set(count) - set(state.durations))]:
        outcomes = {"same bits": count[phase] - wrong[phase], "differs": wrong[phase]}
        table.append(Row("kill -9", phase, count[phase], wrong[phase], outcomes))
    return table
