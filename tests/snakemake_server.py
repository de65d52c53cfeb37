"""Runs Snakemake in forks of one process that has imported it, which saves two CPU-seconds a run.

The server imports other people's packages alone: each fork imports `pipeline` from its own folder.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

SERVER = """
import json, os, sys, traceback
import hydra, numba, numpy, omegaconf, pandas, pyarrow.parquet, pydantic, snakemake.cli
import snakemake_executor_plugin_slurm

for line in sys.stdin:
    order = json.loads(line)
    child = os.fork()
    if not child:
        code = 1
        try:
            for name, number in (("stdout", 1), ("stderr", 2)):
                os.dup2(os.open(order[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.environ.clear()
            os.environ.update(order["environment"])
            os.chdir(order["folder"])
            sys.path[0] = order["folder"]
            sys.argv = ["snakemake", *order["words"]]
            snakemake.cli.main()
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@cache
def _server() -> subprocess.Popen[str]:
    # It ends with this process, which holds the other end of its input.
    pipe: Any = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", SERVER], stdin=pipe, stdout=pipe, text=True)


def snakemake(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Snakemake in a folder that has its own `pipeline`."""
    server = _server()
    outputs = {name: folder / f".cache/{name}" for name in ("stdout", "stderr")}
    outputs["stdout"].parent.mkdir(exist_ok=True)
    order = {
        "folder": str(folder),
        "words": words,
        "environment": {**os.environ, "PYTHONPATH": str(folder)},
        **{name: str(path) for name, path in outputs.items()},
    }
    assert server.stdin is not None and server.stdout is not None
    server.stdin.write(json.dumps(order) + "\n")
    server.stdin.flush()
    code = int(server.stdout.readline())
    return subprocess.CompletedProcess(
        ["snakemake", *words], code, outputs["stdout"].read_text(), outputs["stderr"].read_text()
    )
