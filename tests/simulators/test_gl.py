"""The OpenGL backend: chosen by trying, stored, and one message with exit code 2 if none works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.simulators import gl

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Backends tried so far, on a machine where only OSMesa works and no choice is stored."""
    calls: list[str] = []

    def works(backend: str) -> bool:
        calls.append(backend)
        return backend == "osmesa"

    monkeypatch.setattr(gl, "CACHE", tmp_path / "gl")
    monkeypatch.setattr(gl, "works", works)
    monkeypatch.setenv("MUJOCO_GL", "")
    return calls


def test_the_first_working_backend_is_chosen_and_stored(
    tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gl.choose_backend() == "osmesa"
    assert os.environ["MUJOCO_GL"] == "osmesa"
    assert tried == ["egl", "osmesa"]
    assert gl.choose_backend() == "osmesa"  # As in a child process, which inherits MUJOCO_GL.
    monkeypatch.setenv("MUJOCO_GL", "")
    assert gl.choose_backend() == "osmesa"
    assert tried == ["egl", "osmesa"]


def test_only_the_requested_backend_is_tried(
    tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "egl")
    with pytest.raises(InputError, match=r"tried egl\).*apt-get install"):
        gl.choose_backend()
    assert tried == ["egl"]


def test_a_missing_mujoco_is_not_reported_as_a_missing_library(
    tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gl, "works", lambda _: False)
    monkeypatch.setattr(gl, "find_spec", lambda _: None)
    with pytest.raises(ModuleNotFoundError, match=r"^No module named 'mujoco'$"):
        gl.choose_backend()


def test_a_misspelt_backend_is_named(tried: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(InputError, match=r"egl or osmesa.*'nonsense'"):
        gl.choose_backend()
    assert tried == []


def test_a_read_only_folder_is_not_an_error(
    tried: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(gl, "CACHE", tmp_path / "file" / "gl")
    assert gl.choose_backend() == "osmesa"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"MUJOCO_GL": "nonsense"}, "MUJOCO_GL must be egl or osmesa"),
        # The vendor-neutral EGL library finds no driver: a real failure of OpenGL, as on a machine without a driver.
        (
            {"MUJOCO_GL": "egl", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"},
            "sudo apt-get install",
        ),
    ],
)
def test_the_command_line_ends_with_one_message(
    settings: dict[str, str], message: str, tmp_path: Path
) -> None:
    for name in ("pipeline", "conf"):  # A copy has no stored choice.
        shutil.copytree(
            ROOT / name,
            tmp_path / name,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    shutil.copy(ROOT / "params.yaml", tmp_path)
    command = [sys.executable, "-m", "pipeline", "step", "render-base"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), **settings}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
