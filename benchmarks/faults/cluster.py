"""A study on a real SLURM of one node, in which jobs, the node and Snakemake die; then it is compared with one without SLURM.

    bash tests/faults/slurm_node.sh start .cache/slurm              # root, Debian's packages
    python benchmarks/cluster_faults.py [--study smoke] [--keep]
    bash tests/faults/slurm_node.sh stop .cache/slurm

The study, by default the smallest with a job of every rule, is made once by `./run`, and once by `./run --profile profiles/slurm`, always
with the same words, until it ends well. Both run in a clone of HEAD. The table lists what was done to the second one, and how many files
have the bits of the first.
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

from benchmarks.faults.kills import say
from benchmarks.faults.report import Row, keep, table
from benchmarks.faults.study import CLOCKS, TINY, FaultStudy, Outcome, kill
from pipeline.artefacts.files import read_json, write_json

SMALLEST = "smallest"
SLURM = (
    *("--profile", "profiles/slurm", "--slurm-status-command", "squeue", "--slurm-no-account"),
    *("--slurm-init-seconds-before-status-checks", "5"),
)
"""Words of `./run`: no accounting here, and short jobs are asked for more often than every 40 s."""
SUBMITTED = re.compile(
    r"Job \S+ has been submitted with SLURM jobid (?P<number>\d+) \(log: (?P<log>.*/(?:rule|group)_(?P<name>\w+)/.*)\)"
)
DOWN_S = 25.0
"""Time for which the node is down: SLURM takes a batch job for lost that a node does not know 20 s after its start."""
RUNS = 4
"""Most runs until the study is finished: one more than faults that end Snakemake, and one to spare."""


def cancelled(job: str, process: subprocess.Popen[str]) -> None:
    """`scancel` a job."""
    slurm("scancel", job)


def daemon_killed(job: str, process: subprocess.Popen[str]) -> None:
    """Kill slurmd with -9, and start it again later; the job lives on."""
    os.kill(_daemon(), signal.SIGKILL)
    time.sleep(DOWN_S)
    slurm("slurmd")


def node_lost(job: str, process: subprocess.Popen[str]) -> None:
    """Kill slurmd and all processes of the job with -9, as a power cut does, and start slurmd again later."""
    os.kill(_daemon(), signal.SIGKILL)
    for pid in _processes(job):
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
"""Name of each fault, the rule of the job that it meets, and what it does; they come one after the other."""


def main() -> int:
    """Make the study twice and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", default=SMALLEST, help="default: %(default)s")
    parser.add_argument(
        "--folder",
        type=Path,
        default=Path(".cache/faults"),
        help="for the clone (default: %(default)s)",
    )
    parser.add_argument(
        "--keep", action="store_true", help="publish the rows beside docs/results/faults.md"
    )
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
        if (done := study.run()).code:
            raise SystemExit(f"the run without SLURM failed: {' | '.join(done.said[-3:])}")
        write_json(path, asdict(study.outcome()))
    return Outcome(**read_json(path))


def on_slurm(study: FaultStudy) -> tuple[list[str], int]:
    """Run the study to its end on SLURM, with all faults; returns their names and the last exit code."""
    done: list[str] = []
    code = 1
    for number in range(1, RUNS + 1):
        say(f"run {number} on SLURM")
        code = watched(study.start(*SLURM), done)
        if code == 0:
            break
    return done, code


def watched(process: subprocess.Popen[str], done: list[str]) -> int:
    """The exit code of a run. done: names of the faults so far; those that the run meets are added."""
    assert process.stdout is not None
    for line in process.stdout:
        if "Traceback" in line or "rror" in line:
            say(line.rstrip())
        if (found := SUBMITTED.search(line)) is None:
            continue
        step, job = found["name"], found["number"]
        say(f"{step} is SLURM's job {job}")
        if (
            len(done) < len(FAULTS)
            and step == FAULTS[len(done)][1]
            and at_work(step, job, Path(found["log"]))
        ):
            name, _, act = FAULTS[len(done)]
            say(f"{name}, while {step} is at work")
            act(job, process)
            done.append(name)
    return process.wait()


def at_work(step: str, job: str, log: Path) -> bool:
    """Wait until a job reports progress, such as `campaign 3/12`; False if it has ended."""
    progress = re.compile(rf"^{step} \d+/\d+", re.MULTILINE)
    while (state := slurm("squeue", "--noheader", "--format=%T", f"--jobs={job}")) in (
        "PENDING",
        "RUNNING",
    ):
        if state == "RUNNING" and log.exists() and progress.search(log.read_text()):
            return True
        time.sleep(0.2)
    return False


def compared(
    name: str, whole: Outcome, study: FaultStudy, done: list[str], code: int
) -> Iterator[Row]:
    """A row for each fault and one for the files. A last `./run` may make nothing: it only prints the verdict and records with DVC."""
    last = study.run()
    outcome = study.outcome()
    differences = outcome.differences(whole)
    made = sorted(
        {phase for phase, _ in last.phases}
        & {path.stem for path in (study.folder / "pipeline/steps").glob("*.py")}
    )
    wrong = [f"exit codes {code} and {last.code}"] if code or last.code else []
    wrong += [
        *(f"differs: {part}" for part in differences),
        *(f"made again: {step}" for step in made),
    ]
    say("; ".join(wrong) or "the same study")
    for fault, _, _ in FAULTS:
        times = done.count(fault)
        yield Row(
            f"SLURM, {name}",
            fault,
            times,
            times if wrong else 0,
            {"differs" if wrong else "same bits": times},
        )
    same = sum(outcome.files.get(path) == digest for path, digest in whole.files.items())
    clocks = sum(str(path).endswith(CLOCKS) for path in study.data.rglob("*"))
    unlike = sum(part in whole.files or part in outcome.files for part in differences)
    yield Row(
        f"SLURM, {name}",
        "files",
        same + clocks + unlike,
        unlike,
        {"same file": same, "clock": clocks, "other file": unlike},
    )


def slurm(*command: str) -> str:
    """The output of one of SLURM's commands."""
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def _daemon() -> int:
    """The process number of slurmd."""
    found = re.search(r"SlurmdPidFile\s*= (\S+)", slurm("scontrol", "show", "config"))
    assert found is not None
    return int(Path(found[1]).read_text())


def _processes(job: str) -> list[int]:
    """The processes of a job: its slurmstepd, then those below it, of which each comes before its children."""
    parents = {
        int(pid): int(parent)
        for pid, parent in (
            line.split() for line in slurm("ps", "-e", "-o", "pid=,ppid=").splitlines()
        )
    }
    found = [pid for pid in parents if _words(pid).startswith(f"slurmstepd: [{job}.")]
    for pid in found:
        found += [
            child for child, parent in parents.items() if parent == pid and child not in found
        ]
    return found


def _words(pid: int) -> str:
    try:
        return (
            Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        )
    except OSError:
        return ""


if __name__ == "__main__":
    sys.exit(main())
