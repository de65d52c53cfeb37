"""The commands that people type: each module has HELP, `arguments(parser)` and `run(options)`.

The steps of a study have a door of their own, the command `step`.
"""

from __future__ import annotations

from pkgutil import iter_modules
from types import ModuleType


def names_by_word(package: ModuleType) -> dict[str, str]:
    """The names of a package's modules by the words that stand for them on the command line."""
    return {module.name.replace("_", "-"): module.name for module in iter_modules(package.__path__)}
