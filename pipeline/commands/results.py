"""Command `results`: makes the published numbers from the published outcomes, or checks them.

A page of the documentation holds what a command prints, between two marks:

    <!-- made by: python benchmarks/strategies show -->
    (the command's output)
    <!-- end -->
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from difflib import ndiff
from pathlib import Path

from pipeline.artefacts.files import write_bytes
from pipeline.config.project import typed
from pipeline.core.names import count_of
from pipeline.errors import InputError
from pipeline.progress import Progress

HELP = "Check that the published numbers follow from the published outcomes, or write them."
MARK = re.compile(r"^<!-- made by:", re.MULTILINE)
BLOCK = re.compile(
    r"^<!-- made by: (?P<command>.+?) -->\n(?P<text>.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL
)


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=["verify", "write"],
        help="`verify` exits with 1 if a page differs; `write` fills in the pages",
    )
    parser.add_argument(
        "page",
        nargs="*",
        type=typed,
        help="default: README.md and every page in docs/ that has such numbers",
    )


def run(options: argparse.Namespace) -> int:
    """Run every block's command and compare or replace the block."""
    pages = options.page or published(Path())
    if options.action == "write":
        for page in pages:
            list(blocks(page))  # Its marks are whole.
            write_bytes(page, BLOCK.sub(_filled, text_of(page)).encode())
        return 0
    found = [block for page in pages for block in blocks(page)]
    wrong = []
    with (
        Progress("results") as progress,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):  # Each command is a process of its own.
        for done, (block, text) in enumerate(
            zip(found, pool.map(printed, (block.command for block in found)), strict=True), 1
        ):
            wrong += [told] if (told := block.difference(text)) else []
            progress(done, len(found), str(block.page))
    print(
        "\n".join(wrong)
        or f"{count_of(len(pages), 'page')} checked: every number follows from the outcomes"
    )
    return 1 if wrong else 0


@dataclass(frozen=True)
class Block:
    """A part of a page, the command that prints it, and the line of its first mark."""

    page: Path
    command: str
    text: str
    line: int

    def difference(self, text: str) -> str:
        """Where the block is and the first line on each side that differs from what its command prints; empty if none does."""
        changed = [
            line for line in ndiff(self.text.splitlines(), text.splitlines()) if line[0] in "+-"
        ]
        if not changed:
            return ""
        old, new = (
            next((line[2:] for line in changed if line[0] == sign), "nothing more") for sign in "-+"
        )
        where = f"{self.page}, line {self.line}: expected what `{self.command}` prints, got another text"
        return f"{where}\n  page    {old}\n  command {new}"


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page; InputError if it has none, or a broken one."""
    text = text_of(page)
    begun, whole = len(MARK.findall(text)), len(BLOCK.findall(text))
    if begun != whole or not begun:
        raise InputError(
            f"{page}: expected blocks from `<!-- made by: COMMAND -->` to `<!-- end -->`, got {begun} begun and {whole} whole"
        )
    for found in BLOCK.finditer(text):
        yield Block(page, found["command"], found["text"], text[: found.start()].count("\n") + 1)


def text_of(page: Path) -> str:
    """The text of a page; InputError if there is none."""
    try:
        return page.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{page}: expected a readable page, got {getattr(error, 'strerror', None) or error}"
        ) from error


def published(root: Path) -> list[Path]:
    """The pages with blocks."""
    return [
        page
        for page in (root / "README.md", *sorted(root.glob("docs/**/*.md")))
        if MARK.search(page.read_text())
    ]


def printed(command: str) -> str:
    """What a command prints; InputError if it fails or is no Python command."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise InputError(
            f"a block's command must be one that a shell reads, got '{command}': {error}"
        ) from error
    if words[:1] != ["python"]:
        raise InputError(f"a block's command must begin with 'python', got '{command}'")
    done = subprocess.run([sys.executable, *words[1:]], capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise InputError(": ".join([f"`{command}` ended with {done.returncode}", *said[-1:]]))
    return f"\n{done.stdout.strip()}\n\n"


def _filled(found: re.Match[str]) -> str:
    return f"<!-- made by: {found['command']} -->\n{printed(found['command'])}<!-- end -->"
