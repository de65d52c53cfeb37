"""Blindspot finds, explains and fixes the blind spots of a camera detector."""

import os
from importlib.metadata import version
from pathlib import Path

__version__ = version("blindspot")

for _line in Path(__file__).with_name("no_telemetry.env").read_text().splitlines():
    if not _line.startswith("#"):
        _name, _, os.environ[_name] = _line.partition("=")
