"""Writes dvc.yaml: coarse stages over the Snakefile's targets, whose code dependencies are what the import graph says.

    python -m pipeline.versioning

A test holds the committed dvc.yaml against this.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pipeline.workflow import ROOT, sources

D = "data/${study}"
HEADER = """# Versions of what the Snakefile makes. Made by `python -m pipeline.versioning`; change that, not this.
# Outputs are not `persist`: a changed stage is really made again, never recorded as it lies there. params.yaml fills ${study}.
"""


@dataclass(frozen=True)
class Stage:
    """One stage. target: of Snakemake. steps: modules whose code it depends on. params: keys of params.yaml that it reads."""

    target: str
    steps: tuple[str, ...]
    params: tuple[str, ...]
    outs: tuple[str, ...]
    deps: tuple[str, ...] = ()
    metrics: tuple[Any, ...] = ()
    plots: tuple[Any, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As dvc.yaml has it."""
        code = sorted({path for step in self.steps for path in sources(f"pipeline.{step}")})
        body: dict[str, Any] = {"cmd": f"snakemake --cores 2 {self.target}", "deps": [*self.deps, *code], "params": list(self.params)}
        body["outs"] = list(self.outs)
        body |= {key: list(value) for key in ("metrics", "plots") if (value := getattr(self, key))}
        return body


RETRAINED = f"{D}/retrained"
SIMULATION = ("steps.campaign", "simulators.mujoco.simulator", "detectors.onnx")
SAMPLERS = tuple(f"core.samplers.{name}" for name in ("random", "neural", "pairwise", "coverage"))

STAGES = {
    "space": Stage("spaces", ("steps.define_space",), ("study", "scenarios"), (f"{D}/space",)),
    "base_set": Stage("base_set", ("steps.render_base",), ("study", "base_set", "simulator"), (f"{D}/base_set",)),
    "base": Stage("base", ("steps.train",), ("base", "training", "detector"), (f"{D}/models/base",), (f"{D}/base_set", "models/base")),
    "search": Stage(
        "search",
        (*SIMULATION, *SAMPLERS),
        ("seeds", "search", "strategies", "scenarios", "samplers", "simulator", "detector", "campaign"),
        (f"{D}/campaigns",),
        (f"{D}/space", f"{D}/models/base"),
    ),
    "analyse": Stage(
        "analysis",
        ("steps.measure", "steps.white_box", "steps.cluster", "steps.filter"),
        ("regions", "filter", "strategies", "adaptive", "comparison.confidence"),
        (f"{D}/measures.json", f"{D}/white_box.json", f"{D}/regions", f"{D}/filter"),
        (f"{D}/space", f"{D}/base_set", f"{D}/models/base", f"{D}/campaigns"),
        plots=({f"{D}/theta.csv": {"x": "tests", "title": "Failures found"}},),
    ),
    "retrain": Stage(
        "versions",
        ("steps.retrain", "steps.filter", *SIMULATION, *SAMPLERS),
        (
            *("retraining", "training", "regions", "detector", "filter", "strategies", "adaptive", "held_out"),
            *("search", "seeds", "scenarios", "samplers", "simulator", "campaign"),
        ),
        (RETRAINED,),
        (f"{D}/base_set", f"{D}/models/base", f"{D}/campaigns", f"{D}/filter"),
    ),
    "held_out": Stage(
        "held_out",
        (*SIMULATION, "core.samplers.pairwise"),
        (
            *("held_out", "scenarios", "samplers", "simulator", "detector", "campaign.failure_threshold_s"),
            *("comparison.tests", "comparison.strategy", "comparison.seed"),
        ),
        (f"{D}/held_out",),
        (f"{D}/space", f"{D}/models/base", RETRAINED),
    ),
    "compare": Stage(
        "compare",
        ("steps.compare",),
        ("comparison", "regions", "campaign.failure_threshold_s"),
        (f"{D}/comparison.json", f"{D}/comparison.parquet", f"{D}/changes.csv"),
        (f"{D}/held_out", f"{D}/measures.json", f"{D}/models/base", RETRAINED),
        metrics=(f"{D}/metrics.json",),
    ),
    "report": Stage(
        "report",
        ("steps.report",),
        ("report", "filter", "simulator", "detector"),
        (f"{D}/report.html",),
        (
            *(f"{D}/{name}" for name in ("campaigns", "regions", "filter", "measures.json", "white_box.json")),
            *(f"{D}/{name}" for name in ("comparison.json", "comparison.parquet", "changes.csv", "models/base", "retrained")),
        ),
        plots=(f"{D}/plots",),
    ),
    "track": Stage(
        "track",
        ("steps.track",),
        ("tracking",),
        (f"{D}/tracking.json",),
        (f"{D}/comparison.json", f"{D}/measures.json", f"{D}/plots"),
    ),
}


def text() -> str:
    """The text of dvc.yaml."""
    body: str = yaml.safe_dump({"stages": {name: stage.plain() for name, stage in STAGES.items()}}, sort_keys=False, width=140)
    return HEADER + body


if __name__ == "__main__":
    Path(ROOT / "dvc.yaml").write_text(text())
