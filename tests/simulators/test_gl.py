"""The OpenGL backend is probed, stored, and probed again when the machine changes.

If it fails, there is one message.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.simulators import gl

ROOT = Path(__file__).resolve().parents[2]
AFTER_A_CONTEXT = """
import sys
from pipeline.simulators.mujoco import camera
context = camera.mujoco.GLContext(64, 64)
context.make_current()
for name in sys.argv[1:]:
    __import__(name)
print("imported", *sys.argv[1:])
"""


@pytest.fixture
def probes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Backends probed so far, on a machine where only EGL works and nothing is stored."""
    backends: list[str] = []

    def probe(backend: str, environment: dict[str, str]) -> str:
        backends.append(backend)
        works = backend == "egl" and "MUJOCO_EGL_DEVICE_ID" not in environment
        return "" if works else "no display"

    monkeypatch.setattr(gl, "CACHE", tmp_path / "gl")
    monkeypatch.setattr(gl, "probe", probe)
    for name in ("MUJOCO_GL", *gl.VARIABLES):
        monkeypatch.delenv(name, raising=False)
    return backends


def test_egl_is_probed_once_and_stored(probes: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert gl.choose_backend() == "egl"
    assert os.environ["MUJOCO_GL"] == "egl"
    assert gl.choose_backend() == "egl"  # As in a child process, which inherits MUJOCO_GL.
    monkeypatch.delenv("MUJOCO_GL")
    assert gl.choose_backend() == "egl"
    monkeypatch.setenv("PYOPENGL_PLATFORM", "egl")  # As below a process that has rendered.
    monkeypatch.setenv("LD_LIBRARY_PATH", "/not/there:")  # As below one that imports OpenCV.
    assert gl.choose_backend() == "egl"
    assert probes == ["egl"]


def test_a_changed_machine_is_probed_again(
    probes: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gl.choose_backend()
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    gl.choose_backend()
    monkeypatch.setattr(gl, "version", lambda _: "another")
    gl.choose_backend()
    assert probes == ["egl"] * 3
    next((gl.CACHE).iterdir()).write_text("{")  # A kill left a part.
    gl.choose_backend()
    assert probes == ["egl"] * 4


def test_a_variable_that_keeps_a_stored_backend_from_working_is_named(
    probes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gl.choose_backend()
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "99")
    with pytest.raises(InputError, match="^MUJOCO_EGL_DEVICE_ID=99 .*; type: unset MUJOCO_EGL"):
        gl.choose_backend()


def test_osmesa_is_used_only_if_asked_for(
    probes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(InputError, match="by osmesa .*egl does, type: unset MUJOCO_GL"):
        gl.choose_backend()
    assert probes == ["osmesa", "egl"]


def test_without_any_backend_the_packages_are_named(
    probes: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gl, "probe", lambda *_: "no display")
    assert gl.main() == 3
    printed = capsys.readouterr()
    assert printed.out == "libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri\n"
    assert "no display; type: sudo apt-get install" in printed.err
    # The library is there, so another one would not help.
    monkeypatch.setattr(gl, "probe", lambda *_: f"{gl.CRASHES_LATER} triton is imported")
    assert gl.main() == 2
    assert "apt-get" not in capsys.readouterr().err


def test_a_lost_context_is_explained_and_forgotten(
    probes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gl.choose_backend()
    error = gl.lost_context(RuntimeError("no device"))
    assert "gave no context: no device; the same command tries again" in str(error)
    assert not list(gl.CACHE.iterdir())
    monkeypatch.setattr(gl, "probe", lambda *_: "no display")
    assert isinstance(gl.lost_context(RuntimeError("no device")), gl.NoBackendError)


def test_a_missing_mujoco_is_not_reported_as_a_missing_library(
    probes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gl, "probe", lambda *_: "no module")
    monkeypatch.setattr(gl, "find_spec", lambda _: None)
    with pytest.raises(ModuleNotFoundError, match=r"^No module named 'mujoco'$"):
        gl.choose_backend()


def test_a_misspelt_backend_is_named(probes: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(InputError, match=r"egl or osmesa.*'nonsense'"):
        gl.choose_backend()
    assert probes == []


def test_a_read_only_folder_is_not_an_error(
    probes: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(gl, "CACHE", tmp_path / "file" / "gl")
    assert gl.choose_backend() == "egl"


def test_probes_are_real() -> None:
    backend = os.environ.get("MUJOCO_GL", "") or gl.DEFAULT
    assert gl.probe(backend, dict(os.environ)) == ""
    unfit = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"}
    assert "EGL" in gl.probe("egl", unfit)


def test_a_crash_after_the_context_is_a_problem_of_the_backend(tmp_path: Path) -> None:
    module = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    (tmp_path / "triton.py").write_text(module)
    backend = os.environ.get("MUJOCO_GL", "") or gl.DEFAULT
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    assert gl.probe(backend, environment) == f"{gl.CRASHES_LATER} triton is imported"


def test_what_detectors_bring_along_can_be_imported_after_a_context() -> None:
    names = [name for name in gl.IMPORTED_LATER if find_spec(name)]
    assert names
    done = subprocess.run(
        [sys.executable, "-c", AFTER_A_CONTEXT, *names], cwd=ROOT, capture_output=True, text=True
    )
    assert done.stdout == f"imported {' '.join(names)}\n", (done.returncode, done.stderr[-2000:])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"MUJOCO_GL": "nonsense"}, "MUJOCO_GL must be egl or osmesa"),
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "osmesa"}, "type: unset PYOPENGL_PLATFORM"),
        # The vendor-neutral EGL library finds no driver: a real failure of OpenGL.
        (
            {"MUJOCO_GL": "egl", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"},
            "type: unset __EGL_VENDOR_LIBRARY_FILENAMES",
        ),
    ],
)
def test_the_command_line_ends_with_one_message(
    settings: dict[str, str], message: str, tmp_path: Path
) -> None:
    for name in ("pipeline", "conf"):  # A copy has no stored choice.
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, symlinks=True, ignore=ignored)
    shutil.copy(ROOT / "params.yaml", tmp_path)
    command = [sys.executable, "-m", "pipeline", "simulate", "F1"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), **settings}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
