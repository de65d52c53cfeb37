"""Command `stages`: writes dvc.yaml, DVC's view of the study.

A stage is a part of the study that Snakemake makes. Its dependencies follow from the contracts of its steps. A stage may be coarse, because
Snakemake decides within it which jobs are out of date.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from pipeline.artefacts.files import write_bytes
from pipeline.config.composing import compose
from pipeline.config.declared import least
from pipeline.config.project import typed
from pipeline.config.schema import FAN_OUT
from pipeline.contract import STAMP
from pipeline.sources import sources
from pipeline.workflow.jobs import STAGES, Jobs, Target, flat, step_names
from pipeline.workflow.stamping import Stamps

HELP = "Write dvc.yaml from the contracts of the steps."
FILE = Path("dvc.yaml")
HEADER = """# The parts of a study that DVC versions. Made by `python -m pipeline stages`; change the steps' contracts, not this file.
# Outputs persist: the stamps beside them tell Snakemake which jobs are out of date. params.yaml fills in ${…}.
"""
VARIANTS = (
    ["retraining.rounds=2"],
    [
        "base.source=trained",
        "retraining.start=scratch",
        "comparison.second_iou=0.3",
        "+arms.fresh=new_scenes",
    ],
)
"""Overrides that together use every file and section of a study, except for the file that `filter.overrules` names: DVC cannot template a
dependency that may be missing."""
METRICS, PLOTS = ("metrics",), {"theta.csv": {"x": "tests", "title": "Failures found"}, "plots": {}}


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=typed, default=FILE, help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Write the file."""
    write_bytes(options.out, text().encode())
    print(options.out)
    return 0


def text() -> str:
    """The text of dvc.yaml."""
    studies = [Jobs(compose("default", overrides), step_names()) for overrides in VARIANTS]
    body: str = yaml.safe_dump(
        {"stages": {name: _stage(name, studies) for name in STAGES}}, sort_keys=False, width=140
    )
    return HEADER + body


def _stage(name: str, studies: Iterable[Jobs]) -> dict[str, Any]:
    code: set[str] = set()
    deps: set[str] = set()
    stamps: set[str] = set()
    params = set(FAN_OUT)
    for jobs in studies:
        stamped = Stamps(jobs)
        for target, outputs in jobs.parts[name]:
            stamps |= {
                root
                for root in (_root(jobs, path) for path in outputs)
                if root.endswith(f".{STAMP}")
            }
            keys, files = _depends(jobs, target)
            deps |= {_root(jobs, path) for path in files}
            # Of scenarios and strategies, all: a study may choose any.
            keys = {
                key.split(".")[0] if key.startswith(("scenarios.", "samplers.")) else key
                for key in keys
            }
            params |= keys
            modules = stamped.modules(target.step, {key: stamped.value(key) for key in keys})
            code |= {path for module in modules for path in sources(module)}
    below = [f"data/${{study}}/{root}" for root in STAGES[name]]
    shown = {
        root: {f"data/${{study}}/{root}": {"persist": True, **PLOTS.get(root, {})}}
        for root in STAGES[name]
    }
    stage: dict[str, Any] = {
        "cmd": f"snakemake {name}",
        "deps": [*sorted(deps - set(below)), *sorted(code)],
        "params": sorted(least(params)),
    }
    # The stamps of single files lie beside them; without these, Snakemake would make pulled files again.
    stage["outs"] = [shown[root] for root in STAGES[name] if root not in (*METRICS, *PLOTS)]
    stage["outs"] += [{stamp: {"persist": True}} for stamp in sorted(stamps)]
    stage |= {"metrics": [shown[root] for root in STAGES[name] if root in METRICS]}
    stage |= {"plots": [shown[root] for root in STAGES[name] if root in PLOTS]}
    return {key: value for key, value in stage.items() if value}


def _depends(jobs: Jobs, target: Target) -> tuple[set[str], list[str]]:
    """The keys and the files that a job depends on."""
    step, wildcards = jobs.contracts[target.step], dict(target.wildcards)
    return set(step.depends(jobs.config, wildcards)), flat(step.reads(jobs.folders, wildcards))


def _root(jobs: Jobs, path: str) -> str:
    """The path that DVC tracks for a file: the top file or folder of the study, the folder of its base, or that of another file."""
    below = path.removeprefix(f"{jobs.folders.root}/")
    if below != path:
        return f"data/${{study}}/{below.split('/')[0]}"
    folder = str(Path(path).parent)
    return "${base.weights}" if folder == jobs.config.base.weights else folder
