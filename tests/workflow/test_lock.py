"""requirements.lock pins every package that pyproject.toml asks for, with hashes."""

from __future__ import annotations

import re
import tomllib

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pipeline.sources import ROOT

ENTRY = re.compile(
    r"(?m)^(?P<name>[\w.-]+)==(?P<version>\S+)[^\n]*\\\n(?P<hashes>(?:    "
    r"--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)"
)


def test_every_package_has_one_version_and_hashes_and_no_index_is_named() -> None:
    text = (ROOT / "requirements.lock").read_text()
    rest = ENTRY.sub("", text).splitlines()
    assert all(line.startswith("#") for line in rest), [
        line for line in rest if not line.startswith("#")
    ][:3]
    names = [match["name"] for match in ENTRY.finditer(text)]
    assert len(names) == len(set(names)) > 100
    assert "://" not in text


def test_the_lock_holds_what_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [
        *project["dependencies"],
        *(name for extra in project["optional-dependencies"].values() for name in extra),
    ]
    wanted = [Requirement(line) for line in asked]
    locked = {
        canonicalize_name(match["name"]): match["version"]
        for match in ENTRY.finditer((ROOT / "requirements.lock").read_text())
    }
    for requirement in (
        requirement for requirement in wanted if requirement.name != project["name"]
    ):
        assert requirement.specifier.contains(locked[canonicalize_name(requirement.name)]), (
            requirement
        )
