"""Chooses the OpenGL backend: EGL, on a GPU or by Mesa's software renderer; OSMesa if asked for.

A backend works if a process can make a context and then import what a detector may bring along.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from pipeline.errors import InputError, one_line

DEFAULT = "egl"
PACKAGES = {
    "egl": ("libegl1", "libopengl0", "libegl-mesa0", "libgl1-mesa-dri"),
    "osmesa": ("libosmesa6",),
}
"""Backend -> the packages of Debian and Ubuntu with Mesa's software renderer for it."""
IMPORTED_LATER = ("torch", "triton", "onnxruntime", "transformers")
"""Modules that a process may import after its first context, where they are installed."""
VARIABLES = (
    "PYOPENGL_PLATFORM",
    "MUJOCO_EGL_DEVICE_ID",
    "EGL_PLATFORM",
    "LIBGL_DRIVERS_PATH",
    "__EGL_VENDOR_LIBRARY_DIRS",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
)
"""Environment variables that can keep a backend from working."""
CACHE = Path(__file__).resolve().parents[2] / ".cache" / "gl"
PROBE_LIMIT_S = 120
CRASHES_LATER = "it makes a context, but then the process crashes when"
PROBE = """
import contextlib, importlib, importlib.util, sys
from pipeline.simulators.gl import load_triton_first
load_triton_first()
import mujoco
context = mujoco.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
for name in sys.argv[1:]:
    if importlib.util.find_spec(name):
        print(name, flush=True)
        with contextlib.suppress(Exception):  # A broken package is not the backend's fault.
            importlib.import_module(name)
"""


class NoBackendError(InputError):
    """No OpenGL library of this machine works; `packages` would provide one."""

    def __init__(self, backend: str, problem: str) -> None:
        self.packages = PACKAGES[backend]
        install = f"sudo apt-get install -y --no-install-recommends {' '.join(self.packages)}"
        super().__init__(f"OpenGL by {backend} does not work here: {problem}; type: {install}")


def choose_backend() -> str:
    """Set MUJOCO_GL for this process and its children.

    `.cache/gl` stores that a backend works, because a probe takes seconds. The backend is probed
    again once the machine's libraries, its devices or the environment have changed.

    Returns:
        The backend: `egl`, or `osmesa` if MUJOCO_GL asks for it.

    Raises:
        InputError: MUJOCO_GL names no backend, or another variable keeps the backend from working.
        NoBackendError: the backend does not work; the message has the command to type.
    """
    os.environ.setdefault("LP_NUM_THREADS", "0")  # One thread per worker is fastest.
    backend = os.environ.get("MUJOCO_GL", "").strip().lower() or DEFAULT
    if backend not in PACKAGES:
        raise InputError(f"MUJOCO_GL must be {' or '.join(PACKAGES)}, or unset; got {backend!r}")
    circumstances = _circumstances(backend)
    if _remembered(backend) != circumstances:
        if problem := probe(backend, dict(os.environ)):
            raise _explained(backend, problem)
        # In a read-only folder, every process probes again.
        with contextlib.suppress(OSError):
            CACHE.mkdir(parents=True, exist_ok=True)
            _memory(backend).write_text(json.dumps(circumstances, indent=1) + "\n")
    os.environ["MUJOCO_GL"] = backend
    return backend


def load_triton_first() -> None:
    """Load Triton's library, if installed, before Mesa's: afterwards, its import would crash.

    Mesa loads the system's LLVM for all to see (Debian 12 does for EGL, all for OSMesa), and
    Triton's own LLVM would call into it. A library that is loaded already has bound its calls.
    """
    triton = find_spec("triton")
    if triton is None or not triton.submodule_search_locations:
        return
    for library in Path(triton.submodule_search_locations[0]).glob("_C/libtriton*.so"):
        with contextlib.suppress(OSError):  # Built for another machine: its import fails, too.
            ctypes.CDLL(str(library), mode=os.RTLD_NOW)


def lost_context(error: Exception) -> InputError:
    """The error to raise when no context can be made although the backend worked before."""
    backend = os.environ["MUJOCO_GL"]
    with contextlib.suppress(OSError):
        _memory(backend).unlink(missing_ok=True)
    if problem := probe(backend, dict(os.environ)):
        return _explained(backend, problem)
    return InputError(
        f"OpenGL by {backend} gave no context: {one_line(error)}; the same command tries again"
    )


def probe(backend: str, environment: dict[str, str]) -> str:
    """Try a backend in a process of its own.

    Args:
        backend: a key of `PACKAGES`.
        environment: the environment of that process; MUJOCO_GL is replaced.

    Returns:
        The problem in words; an empty text if the backend works.
    """
    command = [sys.executable, "-c", PROBE, *IMPORTED_LATER]
    environment = {**environment, "MUJOCO_GL": backend}
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=PROBE_LIMIT_S
        )
    except subprocess.TimeoutExpired:
        return f"no context within {PROBE_LIMIT_S} s"
    if done.returncode == 0:
        return ""
    imports = done.stdout.split()
    if imports:
        return f"{CRASHES_LATER} {imports[-1]} is imported"
    if done.returncode < 0:
        return f"making a context crashes (signal {-done.returncode})"
    return one_line((done.stderr.strip() or "no message").splitlines()[-1])


def _explained(backend: str, problem: str) -> InputError:
    """The error for a backend with a problem: blames a variable if all works without it."""
    if find_spec("mujoco") is None:
        raise ModuleNotFoundError("No module named 'mujoco'", name="mujoco")
    for variable in VARIABLES:
        others = {name: value for name, value in os.environ.items() if name != variable}
        if variable in os.environ and not probe(backend, others):
            return InputError(
                f"{variable}={os.environ[variable]} keeps OpenGL by {backend} from working: "
                f"{problem}; type: unset {variable}"
            )
    if backend != DEFAULT and not probe(DEFAULT, dict(os.environ)):
        return InputError(
            f"OpenGL by {backend} does not work here: {problem}; "
            f"{DEFAULT} does, type: unset MUJOCO_GL"
        )
    if problem.startswith(CRASHES_LATER):  # Another library of OpenGL would not help.
        return InputError(f"OpenGL by {backend} does not work here: {problem}")
    return NoBackendError(backend, problem)


def _memory(backend: str) -> Path:
    # The machines of a cluster share this folder but not their libraries.
    return CACHE / f"{platform.node()}-{backend}.json"


def _remembered(backend: str) -> object:
    """The circumstances under which a backend worked; None if it has not been probed."""
    try:
        return json.loads(_memory(backend).read_text())
    except (OSError, ValueError):
        return None


def _circumstances(backend: str) -> dict[str, object]:
    """What decides whether a backend works: variables, libraries, devices and packages."""
    # OpenCV adds a folder that its wheel does not have; what is not there changes nothing.
    folders = os.environ.get("LD_LIBRARY_PATH", "").split(":")
    variables = {"LD_LIBRARY_PATH": ":".join(filter(os.path.isdir, folders))}
    for name in (*VARIABLES, "CUDA_VISIBLE_DEVICES"):
        if name in os.environ:
            variables[name] = os.environ[name]
    # MuJoCo sets this one to its backend, and the processes that it starts inherit it.
    if variables.get("PYOPENGL_PLATFORM") == backend:
        del variables["PYOPENGL_PLATFORM"]
    versions = {}
    for name in ("mujoco", *IMPORTED_LATER):
        with contextlib.suppress(PackageNotFoundError):
            versions[name] = version(name)
    # The dynamic linker's list of libraries is written anew whenever apt adds or removes one.
    libraries = Path("/etc/ld.so.cache")
    return {
        "variables": variables,
        "libraries": libraries.stat().st_mtime_ns if libraries.exists() else None,
        "devices": sorted(map(str, (*Path("/dev").glob("nvidia*"), *Path("/dev/dri").glob("*")))),
        "packages": versions,
    }


def main() -> int:
    """Print the backend. If none works, print the packages that provide it; exit code 3."""
    try:
        print(choose_backend())
    except NoBackendError as error:
        print(*error.packages)
        print(f"blindspot: {error}", file=sys.stderr)
        return 3
    except InputError as error:
        print(f"blindspot: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
