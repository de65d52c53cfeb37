"""The stamp of a job: the digest of everything that determines its outputs."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
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
    _stamps: dict[Target, str] = field(default_factory=dict)
    _contents: dict[str, str] = field(default_factory=dict)

    def stamp(self, name: str, wildcards: Wildcards) -> str:
        """The digest of everything that determines a job's outputs, 16 hexadecimal digits.

        It covers the code, the declared config, the environment, and the stamps of the inputs.
        """
        target = Target.of(name, wildcards)
        if target not in self._stamps:
            self._stamps[target] = self._digest(name, wildcards)
        return self._stamps[target]

    def _digest(self, name: str, wildcards: Wildcards) -> str:
        step = self.jobs.contracts[name]
        sections = {
            key: value_at(self._plain, key) for key in step.depends(self.jobs.config, wildcards)
        }
        environment = {variable: os.environ.get(variable, "") for variable in step.environment}
        # Unsorted: the order of a space's variables determines its tests.
        settings = [sections, dict(sorted(wildcards.items())), environment]
        digest = hashlib.sha256(json.dumps(settings).encode())
        parts: dict[str, str] = {}
        for key, value in (*_leaves(sections), *environment.items()):
            text = json.dumps(value, sort_keys=True)
            parts[key] = hashlib.sha256(text.encode()).hexdigest()[:12]
        modules = {f"pipeline.steps.{part}" for part in (name, step.parts) if part}
        for module in sorted(modules | targets_in(sections)):
            digest.update((code := code_digest(module)).encode())
            parts[f"the code of {module}"] = code
            remember(code, source_digests(module))
        for path in flat(step.reads(self.jobs.folders, wildcards)):
            maker = self.jobs.maker(path)
            if maker is None or maker.step != step.parts:
                digest.update(f"{path} {(origin := self._origin(path))}\n".encode())
                parts[path] = origin
        remember(stamp := digest.hexdigest()[:16], parts)
        return stamp

    @cached_property
    def _plain(self) -> dict[str, Any]:
        return self.jobs.config.model_dump(mode="json")

    def _origin(self, path: str) -> str:
        """The stamp of the job that makes a file; without one, the digest of the file or folder."""
        maker = self.jobs.maker(path)
        if maker is not None:
            return self.stamp(maker.step, dict(maker.wildcards))
        if path not in self._contents:  # Many jobs read the same detector.
            try:
                self._contents[path] = sha256(Path(path))
            except InputError:  # The job that reads it reports the reason.
                self._contents[path] = "missing"
        return self._contents[path]


def _leaves(plain: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings by their dotted keys."""
    if not isinstance(plain, dict) or not plain:
        yield prefix, plain
        return
    for key, value in plain.items():
        yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))


def targets_in(plain: Any) -> set[str]:
    """The modules of this package that `_target_` names anywhere in plain data."""
    if isinstance(plain, list):
        return set().union(*map(targets_in, plain))
    if not isinstance(plain, dict):
        return set()
    modules = set().union(*map(targets_in, plain.values()))
    if str(plain.get("_target_", "")).startswith("pipeline."):
        modules.add(plain["_target_"].rpartition(".")[0])
    return modules
