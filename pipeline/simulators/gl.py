"""Chooses an OpenGL backend that works on this machine: EGL (uses a GPU if present), else OSMesa."""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from pipeline.errors import InputError

BACKENDS = ("egl", "osmesa")
CACHE = Path(__file__).resolve().parents[2] / ".cache" / "gl"
PROBE = "import mujoco; c = mujoco.GLContext(64, 64); c.make_current(); mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), 100)"
INSTALL = "sudo apt-get install -y --no-install-recommends libosmesa6"


def choose_backend() -> str:
    """Set MUJOCO_GL for this process and its children; InputError with the command to type if no backend works.

    If MUJOCO_GL is set, only that backend is tried. `.cache/gl` stores the result, because each try costs a second.
    """
    os.environ.setdefault(
        "LP_NUM_THREADS", "0"
    )  # Software GL is fastest with one thread per worker.
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if wanted and wanted not in BACKENDS:
        raise InputError(f"MUJOCO_GL must be {' or '.join(BACKENDS)}, or unset; got {wanted!r}")
    # The machines of a cluster share this folder but not their libraries.
    remembered = CACHE / f"{platform.node()}-{wanted or 'auto'}"
    chosen = remembered.read_text().strip() if remembered.exists() else ""
    if chosen not in BACKENDS:
        candidates = (wanted,) if wanted else BACKENDS
        chosen = next((backend for backend in candidates if works(backend)), "")
        if not chosen:
            if find_spec("mujoco") is None:
                raise ModuleNotFoundError("No module named 'mujoco'", name="mujoco")
            raise InputError(
                f"no OpenGL library works on this machine (tried {', '.join(candidates)}); type: {INSTALL}"
            )
        for name in (remembered.name, f"{platform.node()}-{chosen}"):
            _remember(CACHE / name, chosen)
    os.environ["MUJOCO_GL"] = chosen
    return chosen


def works(backend: str) -> bool:
    """Whether MuJoCo can create a context with this backend, tried in a separate process."""
    environment = {**os.environ, "MUJOCO_GL": backend}
    try:
        return (
            subprocess.run(
                [sys.executable, "-c", PROBE], env=environment, capture_output=True, timeout=60
            ).returncode
            == 0
        )
    except subprocess.TimeoutExpired:
        return False


def _remember(path: Path, chosen: str) -> None:
    # In a read-only folder every process tries again, at a second each.
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(chosen + "\n")


def main() -> int:
    """Print the backend; exit code 2 if none works."""
    try:
        print(choose_backend())
    except InputError as error:
        print(f"blindspot: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
