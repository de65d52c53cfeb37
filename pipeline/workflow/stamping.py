"""The stamp of a job: the digest of everything that determines its outputs."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.artefacts.files import sha256
from pipeline.artefacts.stamp_parts import remember
from pipeline.config.declared import value_at
from pipeline.contract import Wildcards
from pipeline.errors import InputError
from pipeline.sources import code_digest, source_digests
from pipeline.workflow.jobs import Jobs, Target, flat


@dataclass(frozen=True)
class Stamps:
    """The stamps of a study's jobs, and what goes into them."""

    jobs: Jobs
    _known: dict[Target, str] = field(default_factory=dict)
    _contents: dict[str, str] = field(default_factory=dict)

    def stamp(self, name: str, wildcards: Wildcards) -> str:
        """Digest of everything that determines a job's outputs: code, declared config, environment, and the stamps of its inputs."""
        target = Target.of(name, wildcards)
        if target not in self._known:
            self._known[target] = self._digest(name, wildcards)
        return self._known[target]

    def _digest(self, name: str, wildcards: Wildcards) -> str:
        step = self.jobs.contracts[name]
        sections = {key: self.value(key) for key in step.depends(self.jobs.config, wildcards)}
        environment = {variable: os.environ.get(variable, "") for variable in step.environment}
        # Unsorted: the order of a space's variables determines its tests.
        own = [sections, dict(sorted(wildcards.items())), environment]
        digest = hashlib.sha256(json.dumps(own).encode())
        parts = {key: _short(value) for key, value in (*_leaves(sections), *environment.items())}
        for module in sorted(self.modules(name, sections)):
            digest.update((code := code_digest(module)).encode())
            parts[f"the code of {module}"] = code
            remember(code, source_digests(module))
        for path in flat(step.reads(self.jobs.folders, wildcards)):
            made = self.jobs.maker(path)
            if made is None or made.step != step.parts:
                digest.update(f"{path} {(origin := self._origin(path))}\n".encode())
                parts[path] = origin
        remember(stamp := digest.hexdigest()[:16], parts)
        return stamp

    def modules(self, name: str, sections: Mapping[str, Any]) -> set[str]:
        """The modules of ours that a step's outputs depend on, given its sections of the config by key."""
        return {
            f"pipeline.steps.{step}" for step in (name, self.jobs.contracts[name].parts) if step
        } | targets_in(sections)

    def value(self, key: str) -> Any:
        """The plain value at a dotted key of the config."""
        return value_at(self._plain, key)

    @cached_property
    def _plain(self) -> dict[str, Any]:
        return self.jobs.config.model_dump(mode="json")

    def _origin(self, path: str) -> str:
        """The stamp of the job that makes a file, else the digest of its content, which may be a folder's."""
        made = self.jobs.maker(path)
        if made is not None:
            return self.stamp(made.step, dict(made.wildcards))
        if path not in self._contents:  # Many jobs read the same detector.
            self._contents[path] = _content(Path(path))
        return self._contents[path]


def _content(path: Path) -> str:
    try:
        return sha256(path)
    except InputError:  # The job that reads it says what is wrong.
        return "missing"


def _leaves(plain: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings by their dotted keys."""
    if not isinstance(plain, dict) or not plain:
        yield prefix, plain
        return
    for key, value in plain.items():
        yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))


def _short(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:12]


def targets_in(plain: Any) -> set[str]:
    """Modules of ours that `_target_` names anywhere in plain data."""
    if isinstance(plain, list):
        return set().union(*map(targets_in, plain))
    if isinstance(plain, dict):
        own = (
            {plain["_target_"].rpartition(".")[0]}
            if str(plain.get("_target_", "")).startswith("pipeline.")
            else set()
        )
        return own.union(*(targets_in(value) for value in plain.values()))
    return set()
