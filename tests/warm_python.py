"""A Python that has imported other people's packages already: it spares each job two CPU-seconds.

`warm_python()` is a program that takes the arguments of Python. A server process imports the
packages once, and executes each call in a fork of its own. It imports nothing of `pipeline`: each
fork does so from the folder and the PYTHONPATH of its caller.
"""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

SERVER = r"""
import atexit, gc, importlib, json, os, runpy, select, signal, socket, sys, threading, traceback

own_path = [entry for entry in sys.path if entry not in os.environ.get("PYTHONPATH", "").split(":")]
for name in sys.argv[2:]:
    importlib.import_module(name)
# Forks of a process with threads may hang; jemalloc, Arrow's allocator, takes care of its own.
tasks = "/proc/self/task/"
threads = [open(f"{tasks}{number}/comm").read() for number in os.listdir(tasks)]
assert len([name for name in threads if "jemalloc" not in name]) == 1, threads
listener = socket.socket(socket.AF_UNIX)
listener.bind(sys.argv[1] + "/socket")
listener.listen(64)
signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # Nobody waits for the forks.
gc.freeze()
print("ready", flush=True)


def execute(words):
    if words[0] == "-m":
        sys.path.insert(0, os.getcwd())
        sys.argv = words[1:]
        runpy.run_module(words[1], run_name="__main__", alter_sys=True)
    elif words[0] == "-c":
        sys.path.insert(0, "")
        sys.argv = ["-c", *words[2:]]
        exec(compile(words[1], "<string>", "exec"), {"__name__": "__main__"})
    else:
        sys.path.insert(0, os.path.dirname(os.path.abspath(words[0])))
        sys.argv = words
        runpy.run_path(words[0], run_name="__main__")


def serve(connection):
    order, fds, _, _ = socket.recv_fds(connection, 1 << 20, 3)
    order = json.loads(order)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, fd in enumerate(fds):
        os.dup2(fd, number)
        os.close(fd)
    os.environ.clear()
    os.environ.update(order["environment"])
    os.chdir(order["folder"])
    paths = [path for path in order["environment"].get("PYTHONPATH", "").split(":") if path]
    sys.path[:] = [*paths, *own_path]
    sys.executable = order["program"]

    def end_with_caller():
        if not connection.recv(1):
            os._exit(1)

    threading.Thread(target=end_with_caller, daemon=True).start()
    code = 0
    try:
        execute(order["words"])
    except SystemExit as end:
        code = end.code
        if not isinstance(code, int | None):
            print(code, file=sys.stderr)
            code = 1
    except BaseException:
        traceback.print_exc()
        code = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    connection.sendall(bytes([(code or 0) & 255]))
    os._exit(0)


while listener in select.select([listener, sys.stdin], [], [])[0]:  # Otherwise the input ended.
    connection = listener.accept()[0]
    if not os.fork():
        listener.close()
        serve(connection)
    connection.close()
"""
CLIENT = """#!{python} -IS
import json, os, socket, sys
connection = socket.socket(socket.AF_UNIX)
connection.connect("{folder}/socket")
order = dict(words=sys.argv[1:], folder=os.getcwd(), environment=dict(os.environ), program=__file__)
socket.send_fds(connection, [json.dumps(order).encode()], [0, 1, 2])
code = connection.recv(1)
sys.exit(code[0] if code else 139)
"""
PACKAGES = [
    *("numpy", "pandas", "pyarrow.parquet", "scipy.stats", "scipy.sparse.csgraph", "numba"),
    *("pydantic", "hydra", "omegaconf", "yaml", "PIL.Image", "cv2", "matplotlib.figure", "jinja2"),
    *("torch", "pysat.solvers", "snakemake.cli", "snakemake.script"),
    "snakemake_executor_plugin_slurm",
]


@cache
def warm_python() -> Path:
    """The program; its server ends with this process, which holds the other end of its input."""
    folder = Path(tempfile.mkdtemp(prefix="warm"))
    atexit.register(shutil.rmtree, folder)
    program = folder / "python"
    program.write_text(CLIENT.format(python=sys.executable, folder=folder))
    program.chmod(0o755)
    command = [sys.executable, "-c", SERVER, str(folder), *PACKAGES]
    # OpenBLAS and OpenMP start no threads of their own.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    pipe = subprocess.PIPE
    server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
    assert server.stdout is not None
    assert server.stdout.readline() == "ready\n"
    return program


def snakemake(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Snakemake in a folder that has its own `pipeline`."""
    return subprocess.run(
        [warm_python(), "-m", "snakemake", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
