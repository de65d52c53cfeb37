"""Kills `./run` with -9 in each of its phases, lets it go on to the end, and compares the study with an uninterrupted one."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.faults.report import Row
from benchmarks.faults.study import FaultStudy, Outcome, Run
from pipeline.artefacts.files import read_json, write_json

STATE = ".cache/kills.json"


@dataclass
class State:
    """What is known so far: the uninterrupted study, the seconds of its phases, and the finished passes. A pass is one study: the phases
    in which it was killed, and what went wrong."""

    seed: int
    whole: Outcome | None = None
    durations: dict[str, float] = field(default_factory=dict)
    passes: list[tuple[list[str], list[str]]] = field(default_factory=list)

    @property
    def kills(self) -> int:
        return sum(len(phases) for phases, _ in self.passes)


def kills(study: FaultStudy, count: int, seed: int) -> list[Row]:
    """A row for each phase after at least `count` kills; a killed benchmark resumes after its last finished pass."""
    state = _resumed(study.folder / STATE, seed)
    if state.whole is None:
        study.clear()
        say("an uninterrupted run")
        first = study.run()
        if wrong := _ended(first):
            raise SystemExit(f"the uninterrupted run failed: {wrong}")
        state.whole, state.durations = study.outcome(), first.durations()
        _save(study, state)
    while state.kills < count:
        rng = np.random.default_rng([seed, len(state.passes)])
        state.passes.append(
            one_pass(study, state.whole, targets(state.durations, count - state.kills, rng), rng)
        )
        _save(study, state)
    return rows(state)


def targets(
    durations: dict[str, float], count: int, rng: np.random.Generator
) -> list[tuple[str, float]]:
    """The phases to kill in, in their order, each once at most, and the seconds after which the phase is killed."""
    names = list(durations)
    chosen = sorted(rng.choice(len(names), size=min(count, len(names)), replace=False))
    return [(names[place], float(rng.uniform(0, durations[names[place]]))) for place in chosen]


def one_pass(
    study: FaultStudy, whole: Outcome, aims: Sequence[tuple[str, float]], rng: np.random.Generator
) -> tuple[list[str], list[str]]:
    """Make a study with a kill in each phase; returns the phases in which kills came, and what went wrong."""
    study.clear()
    killed, wrong = [], []
    order = {name: place for place, (name, _) in enumerate(aims)}
    for name, seconds in aims:
        later = {other for other, place in order.items() if place >= order[name]}
        done = study.run(
            lambda phase, later=later, seconds=seconds: (  # type: ignore[misc]
                seconds if phase in later else None
            )
        )
        if done.code == -9:
            killed.append(done.killed_in)
            say(
                f"kill {len(killed)} of {len(aims)} in {done.killed_in}, after {done.seconds:.0f} s"
            )
        else:
            wrong += _ended(done)
    wrong += _ended(study.run())
    wrong += [f"differs: {part}" for part in study.outcome().differences(whole)]
    say(f"a study with {len(killed)} kills is {'the same' if not wrong else '; '.join(wrong)}")
    return killed, wrong


def _ended(run: Run) -> list[str]:
    """What is wrong with a run that should have ended well."""
    traceback = ["a traceback"] if any("Traceback" in line for line in run.said) else []
    return traceback + (
        []
        if run.code == 0
        else [f"exit code {run.code} in {run.killed_in}: {' | '.join(run.said[-3:])}"]
    )


def rows(state: State) -> list[Row]:
    """A row for each phase: its kills, and what came of the studies with them."""
    count = Counter(phase for phases, _ in state.passes for phase in phases)
    wrong = Counter(phase for phases, found in state.passes for phase in phases if found)
    order = [*state.durations, *sorted(set(count) - set(state.durations))]
    return [
        Row(
            "kill -9",
            phase,
            count[phase],
            wrong[phase],
            {"same bits": count[phase] - wrong[phase], "differs": wrong[phase]},
        )
        for phase in order
    ]


def _resumed(path: Path, seed: int) -> State:
    if not path.exists():
        return State(seed)
    known = read_json(path)
    if known["seed"] != seed:
        return State(seed)
    return State(
        seed,
        Outcome(**known["whole"]),
        known["durations"],
        [(list(a), list(b)) for a, b in known["passes"]],
    )


def _save(study: FaultStudy, state: State) -> None:
    write_json(study.folder / STATE, asdict(state))


def say(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)
