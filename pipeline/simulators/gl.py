"""Chooses the OpenGL backend that works on this machine, once: EGL (a GPU where there is one), else OSMesa."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from pipeline.protocols import InputError

BACKENDS = ("egl", "osmesa")
CACHE = Path(__file__).resolve().parents[2] / ".cache" / "gl-backend"
PROBE = "import mujoco; c = mujoco.GLContext(64, 64); c.make_current(); mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), 100)"
INSTALL = "apt-get install -y --no-install-recommends libosmesa6"


def choose_backend() -> str:
    """Set MUJOCO_GL for this process and its children; InputError with the line to type when nothing works.

    A MUJOCO_GL that is already set is respected. The answer is kept in `.cache/gl-backend`, because each try costs a second.
    """
    os.environ.setdefault("LP_NUM_THREADS", "0")  # Software GL: one thread a worker is the best use of the cores.
    if os.environ.get("MUJOCO_GL"):
        return os.environ["MUJOCO_GL"]
    chosen = CACHE.read_text().strip() if CACHE.exists() else ""
    if chosen not in BACKENDS:
        chosen = next((backend for backend in BACKENDS if works(backend)), "")
        if not chosen:
            raise InputError(f"no OpenGL library works here (tried {', '.join(BACKENDS)}); type: {INSTALL}")
        CACHE.parent.mkdir(parents=True, exist_ok=True)
        CACHE.write_text(chosen + "\n")
    os.environ["MUJOCO_GL"] = chosen
    return chosen


def works(backend: str) -> bool:
    """Whether MuJoCo can make a context with this backend, tried in a process of its own."""
    environment = {**os.environ, "MUJOCO_GL": backend}
    try:
        return subprocess.run([sys.executable, "-c", PROBE], env=environment, capture_output=True, timeout=60).returncode == 0
    except subprocess.TimeoutExpired:
        return False


if __name__ == "__main__":
    try:
        print(choose_backend())
    except InputError as error:
        sys.exit(str(error))
