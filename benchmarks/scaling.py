"""How campaigns scale: workers, shards, jobs, memory. Each measurement publishes its figures beside docs/results/scale.md.

    python benchmarks/scaling.py workers [--tests 60] [--rounds 3]    time of a test with one worker and with two
    python benchmarks/scaling.py shards [--tests 40] [--rounds 3]     cost of a shard, on one core
    python benchmarks/scaling.py jobs CLONE                           time and memory of each step of the study that a clone made, and what
                                                                      SLURM added to its jobs, if it ran them in the last hour
    python benchmarks/scaling.py memory [--tests 5000]                memory and open files of one process over many tests
    python benchmarks/scaling.py scheduler                            time to plan and to submit many jobs, with a SLURM that runs
    python benchmarks/scaling.py cluster [--tests 160] [--rounds 1]   time of a campaign by jobs at a time, with a SLURM that runs
    python benchmarks/scaling.py show                                 the tables of the page

The first two and `cluster` need an idle machine.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import median

import numpy as np
import yaml
from published import header

from benchmarks.faults.cluster import SLURM
from benchmarks.faults.study import TINY, FaultStudy
from pipeline.config.composing import compose, functional_scenario, load
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.simulators.mujoco.simulator import MujocoSimulator

PROFILE = Path("profiles/default/config.yaml")
PUBLISHED = Path("docs/results/scale.csv")
SCENARIO = "F1"
WORKERS = (1, 2)
SHARDS = (1, 8)
CLONE = Path(".cache/faults/scaling")
CAMPAIGN = 10_000
"""Tests of the campaign that is planned and simulated in shards."""
ONE_CAMPAIGN = (
    "study=thesis",
    "search=[F1]",
    "strategies=[random]",
    "arms.adaptive=random",
    f"campaign.tests={CAMPAIGN}",
)
PLANNED, SUBMITTED = (100, 1000, 10_000), 200
SIMULATED = (1, 2, 16, 100, 1000, 10_000)
AT_A_TIME, SHARDED = (1, 2, 4, 8, 16), 16
"""Jobs that SLURM may run at a time, and the shards of the campaign that they share."""
GRID, GRID_TESTS, GRID_CORES, BATCH = 56, 1000, (2, 16, 56, 1120), 20
"""The thesis' grid: campaigns, tests of each, cores that are simulated, and tests that a learning strategy executes side by side."""
PRICE = 0.05
"""An assumption: price of a core for an hour."""
Figures = dict[tuple[str, str], float]
"""Values by case and figure."""


def main() -> None:
    """Measure and publish, or print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name, tests, rounds in (
        ("workers", 60, 3),
        ("shards", 40, 3),
        ("cluster", 160, 1),
        ("memory", 5000, None),
    ):
        command = commands.add_parser(name)
        command.add_argument("--tests", type=int, default=tests)
        if rounds is not None:
            command.add_argument("--rounds", type=int, default=rounds)
    commands.add_parser("jobs").add_argument("clone", type=Path)
    commands.add_parser("scheduler")
    commands.add_parser("show")
    options = parser.parse_args()
    if options.command == "workers":
        publish("workers", workers(options.tests, options.rounds))
    elif options.command == "shards":
        publish("shards", shards(options.tests, options.rounds))
    elif options.command == "cluster":
        publish("cluster", cluster(options.tests, options.rounds))
    elif options.command == "jobs":
        publish("steps", steps(options.clone))
        publish("slurm", slurm_jobs(options.clone))
    elif options.command == "scheduler":
        publish("scheduler", scheduler())
    elif options.command == "memory":
        publish("memory", memory(options.tests))
    else:
        print(page(published()))


def workers(tests: int, rounds: int) -> Figures:
    """Wall seconds of a test by workers and round; each worker has compiled its world before."""
    scenario, study = functional_scenario(SCENARIO), compose("default", [])
    space, found = scenario.logical_space(), Figures()
    for place in range(rounds):
        for count in WORKERS:
            with tempfile.TemporaryDirectory() as folder:
                onnx = onnx_of(Path("models/uniform"), Path(folder))
                pool = Workers(
                    count,
                    Setup(study.simulator, scenario, study.detector, onnx, study.car, study.limits),
                )
                points = space.sample(tests + 2 * count, np.random.default_rng(1))
                jobs = [
                    Execution(i, Path(folder) / f"{i}.npz", space.decode(point))
                    for i, point in enumerate(points)
                ]
                list(pool.execute(jobs[: 2 * count]))
                begin = time.perf_counter()
                list(pool.execute(jobs[2 * count :]))
                found[str(count), f"round {place}"] = (time.perf_counter() - begin) / tests
                pool.close()
    return found


def shards(tests: int, rounds: int) -> Figures:
    """Processor seconds of a random campaign on one core by its shards, with Snakemake and all that its jobs start."""
    study = FaultStudy(CLONE.resolve(), [*TINY, f"campaign.tests={tests}"])
    target, found = "data/smoke/campaigns/F1/random/base/0/tests.parquet", Figures()
    study.python("-m", "snakemake", "--cores", "1", "train", "spaces")
    for place in range(rounds):
        for count in SHARDS:
            study.python(
                "-m",
                "pipeline",
                "compose",
                *TINY,
                f"campaign.tests={tests}",
                f"campaign.shards={count}",
            )
            shutil.rmtree(study.data / "campaigns", ignore_errors=True)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            study.python("-m", "snakemake", "--cores", "1", target)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            found[str(count), f"round {place}"] = (
                after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            )
    return found


def cluster(tests: int, rounds: int) -> Figures:
    """Wall and processor seconds of a random campaign of the default study in shards, by the jobs that SLURM may run at a time.

    From the command to its end; the processor seconds are all that this machine spends meanwhile.
    """
    random = ("study=default", "search=[F1]", "strategies=[random]", "arms.adaptive=random")
    study = FaultStudy(
        CLONE.resolve(), [*random, f"campaign.tests={tests}", f"campaign.shards={SHARDED}"]
    )
    study.python("-m", "snakemake", "train", "spaces")
    campaign, found = "data/default/campaigns/F1/random/base/0", Figures()
    needs = [
        f"{step}:{need}" for step in ("shard", "campaign") for need in ("mem_mb=1200", "runtime=60")
    ]
    for place in range(rounds):
        for count in AT_A_TIME:
            shutil.rmtree(study.folder / campaign, ignore_errors=True)
            begin, before = time.perf_counter(), _processor_s()
            threads = (
                "--set-threads",
                "shard=1",
                "campaign=1",
                "--set-resources",
                *needs,
                "--jobs",
                str(count),
            )
            process = study.start(*SLURM, *threads, f"{campaign}/tests.parquet")
            said = process.communicate()[0]
            if process.returncode:
                raise SystemExit(f"the campaign with {count} jobs at a time failed: {said[-300:]}")
            found[str(count), f"round {place}"] = time.perf_counter() - begin
            found[str(count), f"processor {place}"] = _processor_s() - before
            print(f"{count} at a time: {found[str(count), f'round {place}']:.0f} s", flush=True)
    found["all", "tests"] = tests
    return found


def _processor_s() -> float:
    """Seconds for which the processors of this machine have worked since its start."""
    user, nice, system, *_ = (
        int(ticks) for ticks in Path("/proc/stat").read_text().split("\n")[0].split()[1:]
    )
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def memory(tests: int) -> Figures:
    """Resident memory in MiB and open files of this process after each tenth of its executions."""
    scenario, study = functional_scenario(SCENARIO), compose("default", [])
    space, simulator, found = (
        scenario.logical_space(),
        MujocoSimulator(scenario, study.car),
        Figures(),
    )
    with tempfile.TemporaryDirectory() as folder:
        detector = OnnxDetector(
            onnx_of(Path("models/uniform"), Path(folder)), threshold=study.detector["threshold"]
        )
    for i, point in enumerate(space.sample(tests, np.random.default_rng(1)), 1):
        simulator.execute(space.decode(point), detector)
        if i % max(1, tests // 10) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            found[str(i), "mib"] = pages * resource.getpagesize() / 2**20
            found[str(i), "files"] = len(list(Path("/proc/self/fd").iterdir()))
            print(
                f"{i} executions: {found[str(i), 'mib']:.0f} MiB, {found[str(i), 'files']} open files",
                flush=True,
            )
    return found


def steps(clone: Path) -> Figures:
    """Number, longest time and largest memory of the jobs of each step, by Snakemake's benchmark files."""
    found: defaultdict[str, list[Mapping[str, float]]] = defaultdict(list)
    for step, _, row in benchmarks(clone):
        found[step].append(row)
    return {
        (step, figure): value
        for step, rows in sorted(found.items())
        for figure, value in {
            "jobs": len(rows),
            "s": max(row["s"] for row in rows),
            "mb": max(row["max_rss"] for row in rows),
        }.items()
    }


def benchmarks(clone: Path) -> Iterator[tuple[str, str, Mapping[str, float]]]:
    """The step of each job of a clone's study, the wildcards joined by `_`, and the figures of its benchmark file that are numbers."""
    logs = clone / "logs" / load(clone / "params.yaml").study
    for file in sorted(logs.rglob("*.tsv")):
        step, *wildcards = file.relative_to(logs).with_suffix("").parts
        with file.open(newline="") as lines:
            row = next(csv.DictReader(lines, delimiter="\t"))
        yield step, "_".join(wildcards), {name: float(row[name]) for name in ("s", "max_rss")}


def slurm_jobs(clone: Path) -> Figures:
    """Seconds from the begin of SLURM's job to its end, less those of the step in it: their number, median and largest value.

    Only of jobs with one step that ran once. SLURM tells whole seconds.
    """
    own = {
        f"rule_{step}" + (f"_wildcards_{wildcards}" if wildcards else ""): row["s"]
        for step, wildcards, row in benchmarks(clone)
    }
    over = []
    for line in subprocess.run(
        ["scontrol", "--oneliner", "show", "job"], capture_output=True, text=True, check=True
    ).stdout.splitlines():
        job = dict(re.findall(r"(\w+)=(\S*)", line))
        if (
            job.get("WorkDir") == str(clone.resolve())
            and job["JobState"] == "COMPLETED"
            and job["Restarts"] == "0"
            and job["Comment"] in own
        ):
            begin, end = (datetime.fromisoformat(job[name]) for name in ("StartTime", "EndTime"))
            over.append((end - begin).total_seconds() - own[job["Comment"]])
    return (
        {("all", "jobs"): len(over), ("all", "median"): median(over), ("all", "largest"): max(over)}
        if over
        else {}
    )


def scheduler() -> Figures:
    """Seconds until Snakemake has planned one campaign in shards, by their number, and those to hand SLURM one job."""
    study, found = FaultStudy(CLONE, ONE_CAMPAIGN), Figures()
    for count in PLANNED:
        study.python("-m", "pipeline", "compose", *ONE_CAMPAIGN, f"campaign.shards={count}")
        begin = time.perf_counter()
        study.python("-m", "snakemake", "--dry-run", "search")
        found[str(count), "plan"] = time.perf_counter() - begin
    begin = time.perf_counter()
    for _ in range(SUBMITTED):
        subprocess.run(
            ["sbatch", "--output=/dev/null", "--wrap=true"], capture_output=True, check=True
        )
    found["all", "submit"] = (time.perf_counter() - begin) / SUBMITTED
    return found


def publish(measurement: str, figures: Figures) -> None:
    """Replace the published figures of a measurement, if there are new ones."""
    if not figures:
        return
    kept = (
        {name: values for name, values in published().items() if name != measurement}
        if PUBLISHED.exists()
        else {}
    )
    with PUBLISHED.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["measurement", "case", "figure", "value"])
        for name, values in {**kept, measurement: figures}.items():
            lines.writerows([name, *key, f"{value:.4g}"] for key, value in values.items())


def published() -> dict[str, Figures]:
    """The published figures by measurement."""
    found: defaultdict[str, Figures] = defaultdict(dict)
    with PUBLISHED.open(newline="") as file:
        for row in csv.DictReader(file):
            found[row["measurement"]][row["case"], row["figure"]] = float(row["value"])
    return found


def page(figures: Mapping[str, Figures]) -> str:
    """The tables of the page, for the measurements that are published."""
    parts = {
        "workers": by_workers,
        "shards": by_shards,
        "memory": by_memory,
        "slurm": by_slurm,
        "steps": by_steps,
    }
    shown = [show(figures[name]) for name, show in parts.items() if name in figures]
    if {"slurm", "scheduler"} <= set(figures):
        shown += [by_jobs(figures)] if "cluster" in figures else []
        shown.append(by_cluster(figures))
    return "\n\n".join(shown)


def by_workers(figures: Figures) -> str:
    lines = header(
        "workers",
        "seconds a test: median of rounds (smallest to largest)",
        "tests an hour",
        "times as fast",
    )
    alone = median(rounds(figures, WORKERS[0]))
    for count in WORKERS:
        seconds = rounds(figures, count)
        fast = f"{3600 / median(seconds):,.0f} | {alone / median(seconds):.2f}"
        lines.append(
            f"| {count} | {median(seconds):.2f} ({min(seconds):.2f} to {max(seconds):.2f}) | {fast} |"
        )
    return "\n".join(lines)


def by_shards(figures: Figures) -> str:
    lines = header(
        "shards",
        "processor seconds of the campaign: median (smallest to largest)",
        "more for each job",
    )
    few = median(rounds(figures, SHARDS[0]))
    for count in SHARDS:
        seconds = rounds(figures, count)
        more = (
            "–" if count == 1 else f"{(median(seconds) - few) / count:.1f}"
        )  # The shards, and the job that joins them instead of the one.
        lines.append(
            f"| {count} | {median(seconds):.0f} ({min(seconds):.0f} to {max(seconds):.0f}) | {more} |"
        )
    return "\n".join(lines)


def by_memory(figures: Figures) -> str:
    lines = header("executions in one process", "memory, MiB", "open files")
    return "\n".join(
        [
            *lines,
            *(
                f"| {case} | {figures[case, 'mib']:.0f} | {figures[case, 'files']:.0f} |"
                for case, name in figures
                if name == "mib"
            ),
        ]
    )


def by_slurm(figures: Figures) -> str:
    jobs, middle, largest = (figures["all", name] for name in ("jobs", "median", "largest"))
    return f"Of {jobs:.0f} jobs, SLURM's job takes {middle:.0f} s more than the step in it (median), {largest:.0f} s at most."


@dataclass(frozen=True)
class Costs:
    """Seconds that were measured: of a test, of a job (by SLURM and by its start), of planning, and to hand SLURM one more job."""

    test: float
    job: float
    planning: float
    start: float

    @classmethod
    def of(cls, figures: Mapping[str, Figures]) -> Costs:
        """The costs by the published figures."""
        few, many = (median(rounds(figures["shards"], count)) for count in SHARDS)
        per_job, planning = np.polyfit(
            PLANNED, [figures["scheduler"][str(count), "plan"] for count in PLANNED], 1
        )
        return cls(
            median(rounds(figures["workers"], WORKERS[0])),
            figures["slurm"]["all", "median"] + (many - few) / SHARDS[-1],
            planning,
            figures["scheduler"]["all", "submit"] + per_job,
        )

    def campaign(self, tests: int, shards: int, cores: int) -> float:
        """Simulated seconds of a campaign.

        Snakemake plans, then hands SLURM one job after the other. Each core has one job at a time. The last job joins the shards' tables.
        """
        turns = -(-shards // cores)
        return (
            self.planning
            + shards * self.start
            + turns * (self.job + -(-tests // shards) * self.test)
            + (self.job if shards > 1 else 0.0)
        )


def by_jobs(figures: Mapping[str, Figures]) -> str:
    """The campaign that was measured on SLURM, beside its simulation."""
    measured, costs = figures["cluster"], Costs.of(figures)
    tests = int(measured["all", "tests"])
    lines = header(
        "jobs at a time on two cores",
        "seconds",
        "times as fast",
        "processor seconds",
        "simulated with a core for each job, s",
    )
    alone = median(rounds(measured, AT_A_TIME[0]))
    for count in AT_A_TIME:
        seconds, spent = (
            median(rounds(measured, count)),
            median(rounds(measured, count, "processor")),
        )
        simulated = costs.campaign(tests, SHARDED, count)
        lines.append(
            f"| {count} | {seconds:.0f} | {alone / seconds:.2f} | {spent:.0f} | {simulated:.0f} |"
        )
    return "\n".join(lines)


def by_cluster(figures: Mapping[str, Figures]) -> str:
    """Simulated from the published figures: one campaign in shards, a core each, and the thesis' grid, in which each campaign is a job."""
    costs = Costs.of(figures)
    lines = header(
        "campaign of 10,000 tests, shards", "minutes", "core hours", f"cost at {PRICE} an hour"
    )
    for count in SIMULATED:
        jobs = count + (count > 1)
        lines.append(
            _cost(
                f"{count:,}",
                costs.campaign(CAMPAIGN, count, count),
                jobs * costs.job + CAMPAIGN * costs.test,
            )
        )
    lines += [
        "",
        *header(
            "thesis' grid of 56,000 tests, cores",
            "minutes",
            "core hours",
            f"cost at {PRICE} an hour",
        ),
    ]
    for cores in GRID_CORES:
        threads = min(BATCH, max(1, cores // GRID))
        alone = costs.job + GRID_TESTS * costs.test / threads
        wall = costs.planning + GRID * costs.start + -(-GRID // min(cores, GRID)) * alone
        lines.append(_cost(f"{cores:,}", wall, GRID * alone * threads))
    return "\n".join(lines)


def _cost(case: str, wall_s: float, core_s: float) -> str:
    return f"| {case} | {wall_s / 60:,.1f} | {core_s / 3600:.1f} | {core_s / 3600 * PRICE:.2f} |"


def by_steps(figures: Figures) -> str:
    """The steps by memory, beside what the profile reserves on a cluster for the first attempt."""
    profile = yaml.safe_load(PROFILE.read_text())
    lines = header("step", "jobs", "longest, s", "largest memory, MB", "reserved, MB")
    for step in sorted({step for step, _ in figures}, key=lambda step: -figures[step, "mb"]):
        jobs, seconds, memory = (figures[step, name] for name in ("jobs", "s", "mb"))
        reserved = (
            profile["set-resources"].get(step, profile["default-resources"])["mem_mb"].split(" ")[0]
        )
        lines.append(f"| `{step}` | {jobs:.0f} | {seconds:.0f} | {memory:.0f} | {reserved} |")
    return "\n".join(lines)


def rounds(figures: Figures, case: int, figure: str = "round") -> Sequence[float]:
    """The values of a figure in each round of a case."""
    return [
        value
        for (name, found), value in figures.items()
        if name == str(case) and found.startswith(figure)
    ]


if __name__ == "__main__":
    main()
