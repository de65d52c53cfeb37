"""A study in a separate folder; its steps are run by hand."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from contextlib import chdir
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pipeline.__main__ import main
from pipeline.config.composing import compose, dump
from pipeline.config.schema import Config
from pipeline.execution.worker import CONTEXT
from pipeline.simulators import gl
from pipeline.sources import STORED, source_digests
from pipeline.workflow.jobs import step_names

ROOT = Path(__file__).resolve().parents[1]
# The server of the workers serves all campaigns of the tests: let it import PyTorch once, too.
CONTEXT.set_forkserver_preload(["pipeline.execution.worker_server", "torch"])


@dataclass(frozen=True)
class StudyFolder:
    """A folder with params.yaml. study: the study's name."""

    root: Path
    study: str

    @staticmethod
    def composed(root: Path, study: str, overrides: Sequence[str] = ()) -> StudyFolder:
        """A new folder for a study; the shipped detector is the repository's."""
        return StudyFolder.of(root, compose(study, ["base.weights=models/uniform", *overrides]))

    @staticmethod
    def of(root: Path, config: Config) -> StudyFolder:
        root.mkdir(parents=True, exist_ok=True)
        if not (root / "models").exists():
            (root / "models").symlink_to(ROOT / "models")
        (root / "params.yaml").write_text(dump(config, "test"))
        return StudyFolder(root, config.study)

    def __truediv__(self, path: str) -> Path:
        """A file of the study."""
        return self.root / "data" / self.study / path

    def run(self, step: str, threads: int = 1, **wildcards: object) -> int:
        """Run a step by hand; returns the exit code."""
        with chdir(self.root):
            return main(arguments(step, threads, **wildcards))


def fill_cache(folder: Path) -> None:
    """Spare the programs that run in a new folder six seconds.

    They would compute the digests of all source files and probe the OpenGL backend.
    """
    (folder / STORED).parent.mkdir()
    (folder / STORED).write_text(_source_digests())
    gl.choose_backend()
    shutil.copytree(gl.CACHE, folder / gl.CACHE.relative_to(ROOT))


@cache
def _source_digests() -> str:
    digests = {
        path: digest
        for step in step_names()
        for path, digest in source_digests(f"pipeline.steps.{step}").items()
    }
    return json.dumps(
        {
            hashlib.sha256((ROOT / path).read_bytes()).hexdigest(): digest
            for path, digest in digests.items()
        }
    )


def arguments(step: str, threads: int = 1, **wildcards: object) -> list[str]:
    """The command line that runs a step by hand."""
    words = [word for name, value in wildcards.items() for word in (f"--{name}", str(value))]
    return ["step", step, *words, "--threads", str(threads)]
