"""Imported by the server process of `worker.py` alone: what all its forks, the workers, need."""

import importlib
import os

from pipeline.execution.one_thread import ONE_THREAD

os.environ.update(ONE_THREAD)  # Libraries read these when they are imported.
importlib.import_module("pipeline.execution.workers")
