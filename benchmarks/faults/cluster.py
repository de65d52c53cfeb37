"""A study on a real SLURM of one node, in which jobs, the node and Snakemake die.

    bash tests/faults/slurm_node.sh start .cache/slurm              # root, Debian's packages
    python -m benchmarks.faults.cluster [--study smoke] [--keep]
    bash tests/faults/slurm_node.sh stop .cache/slurm

The study, by default the smallest with a job of every rule, is made once by `./run`, and once by
`./run --profile profiles/slurm`, always with the same words, until it succeeds. Both run in a clone
of HEAD. The table lists the faults of the second one, and how many files equal those of the first.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from benchmarks.faults.report import Row, keep, table
from benchmarks.faults.study import CLOCKS, TINY, FaultStudy, Outcome, kill, say
from pipeline.artefacts.files import read_json, write_json

SMALLEST = "smallest"
SLURM = (
    *("--profile", "profiles/slurm", "--slurm-status-command", "squeue", "--slurm-no-account"),
    *("--slurm-init-seconds-before-status-checks", "5"),
)
"""Words of `./run`: no accounting here, and the state of short jobs is asked for often."""
SUBMITTED = re.compile(
    r"Job \S+ has been submitted with SLURM jobid (?P<number>\d+) "
    r"\(log: (?P<log>.*/(?:rule|group)_(?P<name>\w+)/.*)\)"
)
DOWN_S = 25.0
"""Time for which the node is down; SLURM counts a job as lost if the node forgets it for 20 s."""
RUNS = 4
"""Most runs until the study is finished, one of them to spare."""


def cancelled(job: str, process: subprocess.Popen[str]) -> None:
    """`scancel` a job."""
    slurm("scancel", job)


def daemon_killed(job: str, process: subprocess.Popen[str]) -> None:
    """Kill slurmd with -9, and start it again later; the job lives on."""
    os.kill(_daemon(), signal.SIGKILL)
    time.sleep(DOWN_S)
    slurm("slurmd")


def node_lost(job: str, process: subprocess.Popen[str]) -> None:
    """Kill slurmd and all processes of the job with -9, and start slurmd again later."""
    os.kill(_daemon(), signal.SIGKILL)
    for pid in processes(job):
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue  # It ended with its parent.
    time.sleep(DOWN_S)
    slurm("slurmd")


def snakemake_killed(job: str, process: subprocess.Popen[str]) -> None:
    """Kill `./run` and Snakemake with -9; the job lives on."""
    kill(process)


FAULTS: tuple[tuple[str, str, Callable[[str, subprocess.Popen[str]], None]], ...] = (
    ("slurmd killed", "render_base", daemon_killed),
    ("scancel", "campaign", cancelled),
    ("node lost", "retrain", node_lost),
    ("Snakemake killed", "campaign", snakemake_killed),
)
"""Name of each fault, the rule of the job that it meets, and its action; in this order."""


def main() -> int:
    """Make the study twice and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", default=SMALLEST, help="default: %(default)s")
    parser.add_argument("--folder", type=Path, default=Path(".cache/faults"), help="for the clone")
    parser.add_argument("--keep", action="store_true", help="publish the rows")
    options = parser.parse_args()
    slurm("sinfo")
    overrides = TINY if options.study == SMALLEST else (f"study={options.study}",)
    study = FaultStudy(options.folder.resolve() / f"cluster-{options.study}", overrides)
    whole = without_slurm(study)
    study.clear()
    rows = list(compared(options.study, whole, study, *on_slurm(study)))
    if options.keep:
        keep(rows)
    print(table(rows))
    return int(any(row.wrong for row in rows))


def without_slurm(study: FaultStudy) -> Outcome:
    """The outcome of the study by `./run`, made once for each clone."""
    path = study.folder / ".cache/whole.json"
    if not path.exists():
        study.clear()
        say("a run without SLURM")
        run = study.run()
        if run.code:
            raise SystemExit(f"the run without SLURM failed: {' | '.join(run.output[-3:])}")
        write_json(path, asdict(study.outcome()))
    return Outcome(**read_json(path))


def on_slurm(study: FaultStudy) -> tuple[list[str], int]:
    """Run the study to its end on SLURM, with all faults; their names and the last exit code."""
    faults: list[str] = []
    code = 1
    for number in range(1, RUNS + 1):
        say(f"run {number} on SLURM")
        code = watched(study.start(*SLURM), faults)
        if code == 0:
            break
    return faults, code


def watched(process: subprocess.Popen[str], faults: list[str]) -> int:
    """The exit code of a run. faults: the names so far; those that the run meets are added."""
    assert process.stdout is not None
    for line in process.stdout:
        if "Traceback" in line or "rror" in line:
            say(line.rstrip())
        if (match := SUBMITTED.search(line)) is None:
            continue
        step, job = match["name"], match["number"]
        say(f"{step} is SLURM's job {job}")
        if len(faults) == len(FAULTS):
            continue
        name, rule, act = FAULTS[len(faults)]
        if step == rule and at_work(step, job, Path(match["log"])):
            say(f"{name}, while {step} is at work")
            act(job, process)
            faults.append(name)
    return process.wait()


def at_work(step: str, job: str, log: Path) -> bool:
    """Wait until a job reports progress, such as `campaign 3/12`; False if it has ended."""
    progress = re.compile(rf"^{step} \d+/\d+", re.MULTILINE)
    command = ("squeue", "--noheader", "--format=%T", f"--jobs={job}")
    while (state := slurm(*command)) in ("PENDING", "RUNNING"):
        if state == "RUNNING" and log.exists() and progress.search(log.read_text()):
            return True
        time.sleep(0.2)
    return False


def compared(
    name: str, whole: Outcome, study: FaultStudy, faults: list[str], code: int
) -> Iterator[Row]:
    """A row for each fault and one for the files, after a last `./run` that may make nothing."""
    last, outcome = study.run(), study.outcome()
    differences = outcome.differences(whole)
    steps = {path.stem for path in (study.folder / "pipeline/steps").glob("*.py")}
    errors = [f"exit codes {code} and {last.code}"] if code or last.code else []
    errors += [f"differs: {part}" for part in differences]
    errors += [f"made again: {step}" for step in sorted(steps & dict(last.phases).keys())]
    say("; ".join(errors) or "the same study")
    kind = f"SLURM, {name}"
    for fault, _, _ in FAULTS:
        times = faults.count(fault)
        way = "differs" if errors else "same bits"
        yield Row(kind, fault, times, times if errors else 0, {way: times})
    same = sum(outcome.files.get(path) == digest for path, digest in whole.files.items())
    clocks = sum(str(path).endswith(CLOCKS) for path in study.data.rglob("*"))
    other = sum(part in whole.files or part in outcome.files for part in differences)
    files = {"same file": same, "clock": clocks, "other file": other}
    yield Row(kind, "files", sum(files.values()), other, files)


def slurm(*command: str) -> str:
    """The output of one of SLURM's commands."""
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def _daemon() -> int:
    """The process number of slurmd."""
    match = re.search(r"SlurmdPidFile\s*= (\S+)", slurm("scontrol", "show", "config"))
    assert match is not None
    return int(Path(match[1]).read_text())


def processes(job: str) -> list[int]:
    """The processes of a job: its slurmstepd, then those below it, parents before children."""
    numbers, parents = [], {}
    for line in slurm("ps", "-e", "-o", "pid=,ppid=,args=").splitlines():
        pid, parent, command = line.split(maxsplit=2)
        parents[int(pid)] = int(parent)
        if command.startswith(f"slurmstepd: [{job}."):
            numbers.append(int(pid))
    for number in numbers:  # Grows below.
        for child, above in parents.items():
            if above == number and child not in numbers:
                numbers.append(child)
    return numbers


if __name__ == "__main__":
    sys.exit(main())
