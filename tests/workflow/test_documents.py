"""The documents in the repository: short lines, working links, commands that exist."""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import subprocess
from pathlib import Path

import pytest

from pipeline.__main__ import parser
from pipeline.config.composing import CONF
from pipeline.report.formats import aligned
from pipeline.report.verdict import HEADERS
from pipeline.simulators.mujoco.contact_sheet import WEATHERS
from tools import architecture_picture
from tools.pictures import README_ROWS

ROOT = Path(__file__).resolve().parents[2]
LONGEST_LINE = 160
README_WORDS = 900
LINK = re.compile(r"(?:\]\(|^\[[^\]\n]+\]: )([^)\s]+)", re.MULTILINE)
HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)
COMMAND = re.compile(r"python -m pipeline\s+([a-z][a-z-]*)(?:\s+([a-z][a-z|-]*))?")
EXAMPLE = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PRINTED = re.compile(r"^print\(.*\)  # (.+)$", re.MULTILINE)
SNIPPET = re.compile(r"^```.*?^```|`[^`]+`", re.MULTILINE | re.DOTALL)


def documents() -> list[str]:
    listed = subprocess.run(
        ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def anchors(text: str) -> set[str]:
    """The anchors of a document's headings, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        for heading in HEADING.findall(prose)
    }


def broken_links(name: str) -> list[str]:
    """The relative links of a document that lead to no file or to no heading of it."""
    page, broken = ROOT / name, []
    for link in LINK.findall(page.read_text()):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
            broken.append(link)
    return broken


def subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The subcommands of a parser; those of `step` are steps, which have no parser yet."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
        if not action.option_strings and action.dest == "step":
            return dict.fromkeys(action.choices or (), argparse.ArgumentParser())
    return {}


def unknown_commands(text: str, top: argparse.ArgumentParser) -> list[str]:
    """Commands in a document's code that do not exist."""
    unknown = []
    commands = subcommands(top)
    for snippet in SNIPPET.findall(text):
        for command, verb in COMMAND.findall(snippet):
            verbs = subcommands(commands.get(command, argparse.ArgumentParser()))
            misnamed = verbs and verb and not set(verb.split("|")) <= set(verbs)
            if command not in commands or misnamed:
                unknown.append(f"{command} {verb}".strip())
    return unknown


@pytest.mark.parametrize("name", documents())
def test_no_line_is_long(name: str) -> None:
    lines = (ROOT / name).read_text().splitlines()
    # A row of a table cannot be wrapped.
    assert [
        number
        for number, line in enumerate(lines, 1)
        if len(line) > LONGEST_LINE and not line.startswith("|")
    ] == []


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= README_WORDS


@pytest.mark.parametrize("name", documents())
def test_relative_links_resolve(name: str) -> None:
    assert broken_links(name) == []


@pytest.mark.parametrize("name", documents())
def test_named_commands_exist(name: str) -> None:
    assert unknown_commands((ROOT / name).read_text(), parser()) == []


def test_an_unknown_command_is_found() -> None:
    block = "python -m pipeline coverage scored --k 2\npython -m pipeline compose study=x"
    steps = "python -m pipeline step render-bas\npython -m pipeline step render-base"
    text = f"Type `python -m pipeline simulat F1`, then:\n```sh\n{block}\n{steps}\n```"
    assert unknown_commands(text, parser()) == ["simulat", "coverage scored", "step render-bas"]


def test_the_pictures_of_all_scenarios_are_those_that_the_command_draws() -> None:
    scenarios = {path.stem for path in (CONF / "scenario").glob("[!_]*.yaml")}
    assert (
        {path.stem for path in (ROOT / "docs/images").glob("[FN]*.jpg")}
        == scenarios
        >= README_ROWS.keys()
    )
    assert WEATHERS.keys() >= {weather for weathers in README_ROWS.values() for weather in weathers}


def test_the_readmes_example_prints_what_its_comment_says() -> None:
    example = EXAMPLE.findall((ROOT / "README.md").read_text())[0]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(example, {})
    assert printed.getvalue().splitlines() == PRINTED.findall(example) != []


def test_the_readme_shows_the_verdict_as_it_is_printed() -> None:
    lines = (ROOT / "README.md").read_text().split("```text\n")[1].split("```")[0].splitlines()
    ruler = next(number for number, line in enumerate(lines) if line.startswith("─"))
    table = lines[ruler - 1 :]
    columns = [column.span() for column in re.finditer("─+", lines[ruler])]
    rows = []
    for line in [table[0], *table[2:]]:
        rows.append(tuple(line[start:end].strip() for start, end in columns))
    assert table == aligned(rows)
    assert rows[0] == HEADERS


def test_the_architecture_is_drawn_from_todays_declarations() -> None:
    again = "draw it again: python tools/architecture_picture.py"
    assert architecture_picture.PICTURE.read_text() == architecture_picture.picture(), again


@pytest.mark.parametrize("station", architecture_picture.STATIONS, ids=lambda each: each.module)
def test_a_test_passes_modules_that_exist(station: architecture_picture.Station) -> None:
    assert (ROOT / "pipeline" / station.module).exists()
