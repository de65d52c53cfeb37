"""What the Snakefile needs beside its rules: targets, wildcards, and digests that tell when a step's code or settings changed."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import grimp
from snakemake.settings.types import DAGSettings

from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.core.lineage import PATTERN, Version
from pipeline.errors import InputError

ROOT = Path(__file__).resolve().parents[1]


class Study:
    """The paths and choices of the study in params.yaml, for the Snakefile."""

    version_pattern = PATTERN

    def __init__(self, params: Path = PARAMS) -> None:
        self.config: Config = load(params)
        if self.config.goal == "report" and not self.config.campaign.keep_every:
            raise InputError(f"{params}: campaign.keep_every must be at least 1, or no frame is left to learn from, got 0")
        self.root = f"data/{self.config.study}"
        self.logs = f"logs/{self.config.study}"
        self.sources = self.config.sources

    @property
    def goals(self) -> list[str]:
        """What `all` asks for."""
        if self.config.goal == "base":
            return [f"{self.root}/models/base/model.json"]
        if self.config.goal == "front_car":
            return [f"{self.root}/front_car.html"]
        return [f"{self.root}/report.html", f"{self.root}/tracking.json"]

    @property
    def plots(self) -> list[str]:
        """The report's plots."""
        each = [f"{kind}_{scenario}" for scenario in self.config.search for kind in ("kpi", "failures")]
        rounds = ["rounds"] if self.config.retraining.rounds > 1 else []
        names = ("theta", "coverage", "comparison", "detection", "histogram", "reliability", "border", *rounds, *each)
        return [f"{self.root}/plots/{name}.png" for name in names]

    @property
    def shipped(self) -> list[str]:
        """The shipped weights, where the base version is made of them."""
        return [f"{self.config.base.weights}/weights.safetensors"] if self.config.base.source == "shipped" else []

    @property
    def training_sections(self) -> list[str]:
        """What the base version depends on: training parameters only where it is trained."""
        return ["base", "training"] if self.config.base.source == "trained" else ["base"]

    @property
    def retraining_sections(self) -> list[str]:
        """What retrained versions depend on: training parameters only where they are trained from scratch.

        How many rounds and seeds there are is left out: one more makes further versions and leaves those that there are as they are.
        """
        own = [f"retraining.{name}" for name in type(self.config.retraining).model_fields if name not in ("seeds", "rounds")]
        return [*own, "training"] if self.config.retraining.start == "scratch" else own

    def training_seed(self, version: str) -> int:
        """The seed that a version is retrained with."""
        seed = Version.named(version).seed
        return self.config.retraining.seeds[0] if seed is None else seed

    @property
    def overrules(self) -> list[str]:
        """A person's table of overruled frames, if there is one."""
        return [self.config.filter.overrules] if self.config.filter.overrules else []

    @property
    def tracking_server(self) -> str:
        """Digest of MLFLOW_TRACKING_URI, which may hold a password: another server has to be told everything."""
        return hashlib.sha256(os.environ.get("MLFLOW_TRACKING_URI", "").encode()).hexdigest()[:16]

    @property
    def front_car_data(self) -> list[str]:
        """The keys that the snapshots of the front-car study depend on."""
        return [f"front_car.{key}" for key in ("space", "seed", "images", "validation_share", "test_images")]

    def campaign_sections(self, scenario: str) -> list[str]:
        """What a campaign's budget and verdicts depend on."""
        return ["comparison.tests", "campaign.failure_threshold_s"] if scenario in self.config.held_out else ["campaign"]

    def finish(self, asked: DAGSettings) -> None:
        """Once all is made: print the verdict, and tell DVC that what it versions was made, unless DVC itself is at work.

        After a part, as `snakemake search`, what lies there of the rest may be of other settings: then nothing is said. DVC makes
        all by parts, whose last is `track`.
        """
        targets, stage = set(asked.targets), os.environ.get("DVC_STAGE")
        part = targets and "all" not in targets and not targets >= set(self.goals) and stage != "track"
        if self.config.goal != "report" or part or asked.until or asked.omit_from or asked.allowed_rules or asked.batch:
            return
        subprocess.run([sys.executable, "-m", "pipeline", "verdict", "--comparison", f"{self.root}/comparison.json"], cwd=ROOT, check=False)
        if (ROOT / ".dvc").exists() and stage is None:
            told = subprocess.run([sys.executable, "-m", "dvc", "commit", "--force", "--quiet"], cwd=ROOT, capture_output=True, text=True)
            if told.returncode:
                print(f"dvc commit failed, so `dvc status` will report changes: {told.stderr.strip()}", file=sys.stderr)

    def search(self, name: str, scenario: str | None = None, strategy: str | None = None, version: str = "base") -> list[str]:
        """The file `name` of the search campaigns against a version, of all or of one scenario or strategy.

        Those against retrained versions, the later rounds', lie with these versions.
        """
        config = self.config
        scenarios, strategies = [scenario] if scenario else config.search, [strategy] if strategy else config.strategies
        root = f"{self.root}/campaigns" if version == "base" else f"{self.root}/retrained/campaigns"
        return [f"{root}/{a}/{b}/{version}/{seed}/{name}" for a in scenarios for b in strategies for seed in config.seeds]

    def earlier(self, kind: str, scenario: str, strategy: str, version: str, seed: str) -> list[str]:
        """The tests of the campaigns that are known to a campaign, against the same version and with the same seed."""
        return [f"{self.root}/{kind}/{a}/{strategy}/{version}/{seed}/tests.parquet" for a in self.config.earlier(scenario, strategy)]

    def later_search(self, name: str) -> list[str]:
        """The file `name` of the campaigns that later rounds learn from: each kind's strategy against its versions before."""
        tested = dict.fromkeys(v for version in self.config.versions for v in version.tested if v.kind in self.sources)
        return [path for v in tested for path in self.search(name, strategy=self.sources[v.kind], version=str(v))]

    def held_out(self, name: str) -> list[str]:
        """The file `name` of the comparison's campaigns."""
        config, chosen = self.config, self.config.comparison
        root = f"{self.root}/held_out"
        return [f"{root}/{a}/{chosen.strategy}/{version}/{chosen.seed}/{name}" for a in config.held_out for version in config.versions]

    def added(self, version: str, source: Literal["random", "adaptive"]) -> dict[str, list[str]]:
        """The filter tables and the frames of the random or the adaptive source that feed a version; none for a control."""
        described = Version.named(version)
        tested = [] if described.kind == "control" else [replace(v, kind=source) if v.round else v for v in described.tested]
        strategy = self.sources[source]
        frames = [path for v in tested for path in self.search("frames.parquet", strategy=strategy, version=str(v))]
        return {"filters": [self.filter(strategy, str(v)) for v in tested], "frames": frames}

    def filter(self, strategy: str, version: str = "base") -> str:
        """The filter table of a strategy's campaigns against a version."""
        return f"{self.root}/filter/{strategy}.csv" if version == "base" else f"{self.root}/retrained/filter/{strategy}/{version}.csv"

    def filters(self) -> list[str]:
        """The filter tables of the random and of the adaptive source, of the search."""
        return [self.filter(strategy) for strategy in self.sources.values()]

    def model(self, version: str, name: str) -> str:
        """The file `name` of a model version."""
        return f"{self.root}/models/base/{name}" if version == "base" else f"{self.root}/retrained/models/{version}/{name}"

    def spaces(self, scenarios: Iterable[str]) -> list[str]:
        """The scenario spaces."""
        return [f"{self.root}/space/{name}.json" for name in scenarios]

    def parent(self, version: str, name: str) -> str:
        """The file `name` of what a version is retrained from."""
        return self.model(str(Version.named(version).parent), name)

    def models(self, name: str) -> list[str]:
        """The file `name` of every model version."""
        return [self.model(str(version), name) for version in self.config.versions]

    def stamp(self, step: str, *keys: str) -> str:
        """Digest of a step's code and of the sections of the config that it reads; a rule with another stamp runs again.

        keys: dotted, as `samplers.neural`. Code named by a `_target_` in them counts as the step's own.
        """
        plain = self.config.model_dump(mode="json")
        sections = {key: _at(plain, key) for key in keys}
        digest = hashlib.sha256(json.dumps(sections, sort_keys=True).encode())
        for module in sorted({f"pipeline.steps.{step}", *_targets(sections)}):
            digest.update(code_digest(module).encode())
        return digest.hexdigest()[:16]


def study() -> Study:
    """The study in params.yaml; what is wrong with that is told in one line, where Snakemake would show a stack."""
    try:
        return Study()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def _at(plain: Any, key: str) -> Any:
    for part in key.split("."):
        plain = plain[part]
    return plain


def _targets(plain: Any) -> set[str]:
    """Modules of ours that `_target_` names anywhere in plain data."""
    if isinstance(plain, dict):
        own = {plain["_target_"].rpartition(".")[0]} if str(plain.get("_target_", "")).startswith("pipeline.") else set()
        return own.union(*(_targets(value) for value in plain.values()))
    return set()


@cache
def _graph() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", cache_dir=str(ROOT / ".cache" / "grimp"))


@cache
def sources(module: str) -> tuple[str, ...]:
    """Source files of a module and of everything of ours that it imports, however far down, relative to the root; sorted.

    Templates count as source of the modules beside them.
    """
    graph = _graph()
    found = set()
    for name in {module} | graph.find_upstream_modules(module):
        stem = ROOT.joinpath(*name.split("."))
        path = stem.with_suffix(".py") if stem.with_suffix(".py").exists() else stem / "__init__.py"
        if path.stat().st_size:
            found |= {file.relative_to(ROOT).as_posix() for file in (path, *path.parent.glob("*.jinja"))}
    return tuple(sorted(found))


@cache
def code_digest(module: str) -> str:
    """SHA-256 over `sources` of a module."""
    digest = hashlib.sha256()
    for path in sources(module):
        digest.update(path.encode() + (ROOT / path).read_bytes())
    return digest.hexdigest()
