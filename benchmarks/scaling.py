"""How campaigns scale: workers, shards, jobs, memory. Each measurement publishes its figures.

    python -m benchmarks.scaling workers      time of a test with one worker and with two
    python -m benchmarks.scaling shards       cost of a shard, on one core
    python -m benchmarks.scaling jobs CLONE   time and memory of each step of a clone's study, and
                                              what SLURM added to its jobs in the last hour
    python -m benchmarks.scaling memory       memory and open files of a process over many tests
    python -m benchmarks.scaling scheduler    time to plan and submit many jobs; needs a SLURM
    python -m benchmarks.scaling cluster      time of a campaign by jobs at a time; needs a SLURM
    python -m benchmarks.scaling show         the tables of docs/results/scale.md

`workers`, `shards` and `cluster` need an idle machine.
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

from benchmarks.faults.cluster import SLURM
from benchmarks.faults.study import TINY, FaultStudy
from benchmarks.shared import RESULTS, markdown
from pipeline.config.composing import compose, functional_scenario, load
from pipeline.core.loop import run_test
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.simulators.mujoco.world import MujocoWorld

PROFILE = Path("profiles/default/config.yaml")
PUBLISHED = RESULTS / "scale.csv"
BASE = Path("models/uniform")
SCENARIO = "F1"
WORKERS = (1, 2)
SHARDS = (1, 8)
CLONE = Path(".cache/faults/scaling")
CAMPAIGN = 10_000
"""Tests of the campaign that is planned and simulated in shards."""
RANDOM = ("search=[F1]", "strategies=[random]", "arms.adaptive=random")
PLANNED, SUBMITTED = (100, 1000, 10_000), 200
SIMULATED = (1, 2, 16, 100, 1000, 10_000)
AT_A_TIME, SHARDED = (1, 2, 4, 8, 16), 16
"""Jobs that SLURM may run at a time, and the shards of the campaign that they share."""
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
    for name, tests, count in (("workers", 60, 3), ("shards", 40, 3), ("cluster", 160, 1)):
        command = commands.add_parser(name)
        command.add_argument("--tests", type=int, default=tests)
        command.add_argument("--rounds", type=int, default=count)
    commands.add_parser("memory").add_argument("--tests", type=int, default=5000)
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


def workers(tests: int, count: int) -> Figures:
    """Wall seconds of a test by workers and round; each worker has compiled its world before."""
    scenario, study = functional_scenario(SCENARIO), compose("default", [])
    space, figures = scenario.logical_space(), Figures()
    for number in range(count):
        for processes in WORKERS:
            with tempfile.TemporaryDirectory() as folder:
                onnx = onnx_of(BASE, Path(folder))
                setup = Setup(
                    study.simulator, scenario, study.detector, onnx, study.car, study.limits
                )
                pool = Workers(processes, setup)
                jobs = []
                points = space.sample(tests + 2 * processes, np.random.default_rng(1))
                for i, point in enumerate(points):
                    jobs.append(Execution(i, Path(folder) / f"{i}.npz", space.decode(point)))
                list(pool.execute(jobs[: 2 * processes]))
                begin = time.perf_counter()
                list(pool.execute(jobs[2 * processes :]))
                seconds = time.perf_counter() - begin
                figures[str(processes), f"round {number}"] = seconds / tests
                pool.close()
    return figures


def shards(tests: int, count: int) -> Figures:
    """Processor seconds of a random campaign on one core by its shards, Snakemake included."""
    overrides = (*TINY, f"campaign.tests={tests}")
    study, figures = FaultStudy(CLONE.resolve(), overrides), Figures()
    study.python("-m", "snakemake", "--cores", "1", "train", "spaces")
    target = "data/smoke/campaigns/F1/random/base/0/tests.parquet"
    for number in range(count):
        for parts in SHARDS:
            study.python("-m", "pipeline", "compose", *overrides, f"campaign.shards={parts}")
            shutil.rmtree(study.data / "campaigns", ignore_errors=True)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            study.python("-m", "snakemake", "--cores", "1", target)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            figures[str(parts), f"round {number}"] = spent
    return figures


def cluster(tests: int, count: int) -> Figures:
    """Wall and processor seconds of a campaign in shards, by the jobs that SLURM may run at a time.

    From the command to its end; the processor seconds are all that this machine spends meanwhile.
    """
    overrides = ("study=default", *RANDOM, f"campaign.tests={tests}", f"campaign.shards={SHARDED}")
    study, figures = FaultStudy(CLONE.resolve(), overrides), Figures()
    study.python("-m", "snakemake", "train", "spaces")
    campaign = "data/default/campaigns/F1/random/base/0"
    needs = []
    for step in ("shard", "campaign"):
        needs += [f"{step}:mem_mb=1200", f"{step}:runtime=60"]
    words = (*SLURM, "--set-threads", "shard=1", "campaign=1", "--set-resources", *needs, "--jobs")
    for number in range(count):
        for jobs in AT_A_TIME:
            shutil.rmtree(study.folder / campaign, ignore_errors=True)
            begin, before = time.perf_counter(), processor_s()
            process = study.start(*words, str(jobs), f"{campaign}/tests.parquet")
            output = process.communicate()[0]
            if process.returncode:
                raise SystemExit(f"the campaign with {jobs} jobs at a time failed: {output[-300:]}")
            seconds = time.perf_counter() - begin
            figures[str(jobs), f"round {number}"] = seconds
            figures[str(jobs), f"processor {number}"] = processor_s() - before
            print(f"{jobs} at a time: {seconds:.0f} s", flush=True)
    figures["all", "tests"] = tests
    return figures


def processor_s() -> float:
    """Seconds for which the processors of this machine have worked since its start."""
    ticks = Path("/proc/stat").read_text().split("\n")[0].split()[1:4]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def memory(tests: int) -> Figures:
    """Resident memory in MiB and open files of this process after each tenth of its executions."""
    scenario, study = functional_scenario(SCENARIO), compose("default", [])
    space, world = scenario.logical_space(), MujocoWorld(scenario, study.car.vehicle)
    with tempfile.TemporaryDirectory() as folder:
        onnx = onnx_of(BASE, Path(folder))
        detector = OnnxDetector(onnx, threshold=study.detector["threshold"])
    figures = Figures()
    for i, point in enumerate(space.sample(tests, np.random.default_rng(1)), 1):
        run_test(world, detector, study.car, space.decode(point))
        if i % max(1, tests // 10) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            figures[str(i), "mib"] = pages * resource.getpagesize() / 2**20
            figures[str(i), "files"] = len(list(Path("/proc/self/fd").iterdir()))
            print(f"{i} executions: {figures[str(i), 'mib']:.0f} MiB", flush=True)
    return figures


def steps(clone: Path) -> Figures:
    """Number, longest time and largest memory of the jobs of each step, as Snakemake measured."""
    rows_of: defaultdict[str, list[Mapping[str, float]]] = defaultdict(list)
    for step, _, row in job_benchmarks(clone):
        rows_of[step].append(row)
    figures = Figures()
    for step, rows in sorted(rows_of.items()):
        figures[step, "jobs"] = len(rows)
        figures[step, "s"] = max(row["s"] for row in rows)
        figures[step, "mb"] = max(row["max_rss"] for row in rows)
    return figures


def job_benchmarks(clone: Path) -> Iterator[tuple[str, str, Mapping[str, float]]]:
    """The step of each job of a clone's study, its wildcards joined by `_`, seconds and memory."""
    logs = clone / "logs" / load(clone / "params.yaml").study
    for file in sorted(logs.rglob("*.tsv")):
        step, *wildcards = file.relative_to(logs).with_suffix("").parts
        with file.open(newline="") as lines:
            row = next(csv.DictReader(lines, delimiter="\t"))
        yield step, "_".join(wildcards), {name: float(row[name]) for name in ("s", "max_rss")}


def slurm_jobs(clone: Path) -> Figures:
    """Seconds of SLURM's jobs beyond those of the step in them: number, median and largest.

    Only of jobs with one step that ran once. SLURM gives whole seconds.
    """
    seconds = {}
    for step, wildcards, row in job_benchmarks(clone):
        name = f"rule_{step}_wildcards_{wildcards}" if wildcards else f"rule_{step}"
        seconds[name] = row["s"]
    command = ["scontrol", "--oneliner", "show", "job"]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    over = []
    for line in output.splitlines():
        job = dict(re.findall(r"(\w+)=(\S*)", line))
        whole = job.get("JobState") == "COMPLETED" and job.get("Restarts") == "0"
        same = whole and job.get("WorkDir") == str(clone.resolve())
        if same and job["Comment"] in seconds:
            begin, end = (datetime.fromisoformat(job[name]) for name in ("StartTime", "EndTime"))
            over.append((end - begin).total_seconds() - seconds[job["Comment"]])
    if not over:
        return {}
    values = {"jobs": len(over), "median": median(over), "largest": max(over)}
    return {("all", name): value for name, value in values.items()}


def scheduler() -> Figures:
    """Seconds to plan one campaign by its shards, and to hand SLURM one job."""
    overrides = ("study=thesis", *RANDOM, f"campaign.tests={CAMPAIGN}")
    study, figures = FaultStudy(CLONE, overrides), Figures()
    for count in PLANNED:
        study.python("-m", "pipeline", "compose", *overrides, f"campaign.shards={count}")
        begin = time.perf_counter()
        study.python("-m", "snakemake", "--dry-run", "search")
        figures[str(count), "plan"] = time.perf_counter() - begin
    begin = time.perf_counter()
    for _ in range(SUBMITTED):
        command = ["sbatch", "--output=/dev/null", "--wrap=true"]
        subprocess.run(command, capture_output=True, check=True)
    figures["all", "submit"] = (time.perf_counter() - begin) / SUBMITTED
    return figures


def publish(measurement: str, figures: Figures) -> None:
    """Replace the published figures of a measurement, if there are new ones."""
    if not figures:
        return
    measurements = {**(published() if PUBLISHED.exists() else {}), measurement: figures}
    with PUBLISHED.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["measurement", "case", "figure", "value"])
        for name, values in measurements.items():
            for key, value in values.items():
                lines.writerow([name, *key, f"{value:.4g}"])


def published() -> dict[str, Figures]:
    """The published figures by measurement."""
    measurements: defaultdict[str, Figures] = defaultdict(dict)
    with PUBLISHED.open(newline="") as file:
        for row in csv.DictReader(file):
            measurements[row["measurement"]][row["case"], row["figure"]] = float(row["value"])
    return measurements


def page(figures: Mapping[str, Figures]) -> str:
    """The tables of the page, for the measurements that are published."""
    parts = {
        "workers": by_workers,
        "shards": by_shards,
        "memory": by_memory,
        "slurm": by_slurm,
        "steps": by_steps,
    }
    tables = [show(figures[name]) for name, show in parts.items() if name in figures]
    if {"slurm", "scheduler"} <= set(figures):
        tables += [by_jobs(figures)] if "cluster" in figures else []
        tables.append(by_cluster(figures))
    return "\n\n".join(tables)


def by_workers(figures: Figures) -> str:
    """Time of a test by workers."""
    alone = median(rounds(figures, WORKERS[0]))
    rows = []
    for count in WORKERS:
        seconds = median(rounds(figures, count))
        hourly = f"{3600 / seconds:,.0f}"
        rows.append((count, spread(figures, count, 2), hourly, f"{alone / seconds:.2f}"))
    seconds_head = "seconds a test: median of rounds (smallest to largest)"
    return markdown(("workers", seconds_head, "tests an hour", "times as fast"), rows)


def by_shards(figures: Figures) -> str:
    """Processor time of a campaign by its shards."""
    few = median(rounds(figures, SHARDS[0]))
    rows = []
    for count in SHARDS:
        # The shards, and the job that joins them instead of the one.
        more = (median(rounds(figures, count)) - few) / count
        rows.append((count, spread(figures, count, 0), "–" if count == 1 else f"{more:.1f}"))
    seconds_head = "processor seconds of the campaign: median (smallest to largest)"
    return markdown(("shards", seconds_head, "more for each job"), rows)


def spread(figures: Figures, case: int, digits: int) -> str:
    """The median of the rounds of a case, with the smallest and the largest."""
    values = rounds(figures, case)
    ends = f"{min(values):.{digits}f} to {max(values):.{digits}f}"
    return f"{median(values):.{digits}f} ({ends})"


def by_memory(figures: Figures) -> str:
    """Memory and open files after the first and the last tenth of the executions."""
    cases = [case for case, name in figures if name == "mib"]
    rows = []
    for case in (cases[0], cases[-1]):
        rows.append((case, f"{figures[case, 'mib']:.0f}", f"{figures[case, 'files']:.0f}"))
    return markdown(("executions in one process", "memory, MiB", "open files"), rows)


def by_slurm(figures: Figures) -> str:
    """One sentence: what SLURM adds to a job."""
    jobs, middle, largest = (figures["all", name] for name in ("jobs", "median", "largest"))
    return (
        f"Of {jobs:.0f} jobs, SLURM's job takes {middle:.0f} s more than the step in it (median), "
        f"{largest:.0f} s at most."
    )


@dataclass(frozen=True)
class Costs:
    """Measured seconds: of a test, of a job and its start, of planning, of handing over a job."""

    test: float
    job: float
    planning: float
    start: float

    @classmethod
    def of(cls, figures: Mapping[str, Figures]) -> Costs:
        """The costs by the published figures."""
        few, many = (median(rounds(figures["shards"], count)) for count in SHARDS)
        plans = [figures["scheduler"][str(count), "plan"] for count in PLANNED]
        per_job, planning = np.polyfit(PLANNED, plans, 1)
        return cls(
            median(rounds(figures["workers"], WORKERS[0])),
            figures["slurm"]["all", "median"] + (many - few) / SHARDS[-1],
            planning,
            figures["scheduler"]["all", "submit"] + per_job,
        )

    def campaign(self, tests: int, shards: int, cores: int) -> float:
        """Simulated seconds of a campaign.

        Snakemake plans, then hands SLURM one job after the other. Each core has one job at a time.
        The last job joins the shards' tables.
        """
        turns = -(-shards // cores)
        executing = turns * (self.job + -(-tests // shards) * self.test)
        joining = self.job if shards > 1 else 0.0
        return self.planning + shards * self.start + executing + joining


def by_jobs(figures: Mapping[str, Figures]) -> str:
    """The campaign that was measured on SLURM, beside its simulation."""
    measured, costs = figures["cluster"], Costs.of(figures)
    tests = int(measured["all", "tests"])
    alone = median(rounds(measured, AT_A_TIME[0]))
    rows = []
    for count in AT_A_TIME:
        seconds = median(rounds(measured, count))
        spent = f"{median(rounds(measured, count, 'processor')):.0f}"
        simulated = f"{costs.campaign(tests, SHARDED, count):.0f}"
        rows.append((count, f"{seconds:.0f}", f"{alone / seconds:.2f}", spent, simulated))
    names = ("jobs at a time on two cores", "seconds", "times as fast", "processor seconds")
    return markdown((*names, "simulated with a core for each job, s"), rows)


def by_cluster(figures: Mapping[str, Figures]) -> str:
    """Simulated: one campaign in shards, a core each."""
    costs, names = Costs.of(figures), ("minutes", "core hours", f"cost at {PRICE} an hour")
    campaigns = []
    for count in SIMULATED:
        spent_s = (count + (count > 1)) * costs.job + CAMPAIGN * costs.test
        campaigns.append(priced(count, costs.campaign(CAMPAIGN, count, count), spent_s))
    return markdown(("campaign of 10,000 tests, shards", *names), campaigns)


def priced(case: int, wall_s: float, core_s: float) -> list[str]:
    """The cells of a simulated case: minutes, core hours and their price."""
    hours = core_s / 3600
    return [f"{case:,}", f"{wall_s / 60:,.1f}", f"{hours:.1f}", f"{hours * PRICE:.2f}"]


def by_steps(figures: Figures) -> str:
    """The largest steps by memory, beside what the profile reserves for the first attempt."""
    profile = yaml.safe_load(PROFILE.read_text())
    rows = []
    for step in sorted({step for step, _ in figures}, key=lambda step: -figures[step, "mb"])[:6]:
        values = [f"{figures[step, name]:.0f}" for name in ("jobs", "s", "mb")]
        resources = profile["set-resources"].get(step, profile["default-resources"])
        rows.append([f"`{step}`", *values, resources["mem_mb"].split(" ")[0]])
    return markdown(("step", "jobs", "longest, s", "largest memory, MB", "reserved, MB"), rows)


def rounds(figures: Figures, case: int, figure: str = "round") -> Sequence[float]:
    """The values of a figure in each round of a case."""
    values = []
    for (name, kind), value in figures.items():
        if name == str(case) and kind.startswith(figure):
            values.append(value)
    return values


if __name__ == "__main__":
    main()
