"""Command `results`: makes the published numbers from the published outcomes, or checks them.

A page of the documentation holds what a command prints, between two marks:

    <!-- made by: python benchmarks/strategies show -->
    (the command's output)
    <!-- end -->
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import ndiff
from pathlib import Path

from pipeline.artefacts.files import write_bytes
from pipeline.config.project import typed
from pipeline.errors import InputError

HELP = "Check that the published numbers follow from the published outcomes, or write them."
BLOCK = re.compile(r"^<!-- made by: (?P<command>.+?) -->\n(?P<text>.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["verify", "write"], help="`verify` ends with 1 if a page differs; `write` fills the pages in")
    parser.add_argument("page", nargs="*", type=typed, help="default: README.md and every page in docs/ that has such numbers")


def run(options: argparse.Namespace) -> int:
    """Run every block's command and compare or replace the block."""
    pages = options.page or published(Path())
    if options.action == "write":
        for page in pages:
            write_bytes(page, BLOCK.sub(_filled, page.read_text()).encode())
        return 0
    wrong = [line for page in pages for line in differences(page)]
    print("\n".join(wrong) or f"{len(pages)} pages follow from their outcomes")
    return 1 if wrong else 0


@dataclass(frozen=True)
class Block:
    """A part of a page, the command that prints it, and the line of its first mark."""

    command: str
    text: str
    line: int


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page."""
    text = page.read_text()
    for found in BLOCK.finditer(text):
        yield Block(found["command"], found["text"], text[: found.start()].count("\n") + 1)


def published(root: Path) -> list[Path]:
    """The pages with blocks."""
    return [page for page in (root / "README.md", *sorted(root.glob("docs/**/*.md"))) if BLOCK.search(page.read_text())]


def differences(page: Path) -> Iterator[str]:
    """One text for each block that differs from what its command prints: where, and the first line on each side."""
    for block in blocks(page):
        changed = [line for line in ndiff(block.text.splitlines(), printed(block.command).splitlines()) if line[0] in "+-"]
        if changed:
            old, new = (next((line[2:] for line in changed if line[0] == sign), "nothing more") for sign in "-+")
            where = f"{page}, line {block.line}: expected what `{block.command}` prints, got another text"
            yield f"{where}\n  page    {old}\n  command {new}"


def printed(command: str) -> str:
    """What a command prints; InputError if it fails or is no Python command."""
    words: Sequence[str] = shlex.split(command)
    if words[0] != "python":
        raise InputError(f"a block is made by a command that begins with 'python', got '{command}'")
    done = subprocess.run([sys.executable, *words[1:]], capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"`{command}` ended with {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    return f"\n{done.stdout.strip()}\n\n"


def _filled(found: re.Match[str]) -> str:
    return f"<!-- made by: {found['command']} -->\n{printed(found['command'])}<!-- end -->"
