"""Write the published numbers from the published outcomes, or verify them.

A page of the documentation holds what a command prints, between two marks:

    <!-- made by: python benchmarks/strategies show -->
    (the command's output)
    <!-- end -->

Usage: python tools/results.py verify|write [PAGE ...]   (default: README.md and docs/)
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from difflib import ndiff
from pathlib import Path

from pipeline.artefacts.files import write_bytes
from pipeline.core.names import count_of
from pipeline.errors import InputError
from pipeline.progress import Progress

MARK = re.compile(r"^<!-- made by:", re.MULTILINE)
BLOCK = re.compile(
    r"^<!-- made by: (?P<command>.+?) -->\n(?P<text>.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL
)


def main(words: Sequence[str] | None = None) -> int:
    """Run every block's command, and compare or replace the block; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Check that the published numbers follow from the published outcomes, "
        "or write them."
    )
    parser.add_argument(
        "action",
        choices=["verify", "write"],
        help="`verify` exits with 1 if a page differs; `write` fills in the pages",
    )
    parser.add_argument(
        "page", nargs="*", type=Path, help="default: README.md and the pages of docs/ with blocks"
    )
    options = parser.parse_args(words)
    try:
        pages = options.page or published(Path())
        return verify(pages) if options.action == "verify" else write(pages)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2


def verify(pages: Sequence[Path]) -> int:
    """Print the blocks that differ from what their commands print; returns 1 if there is one."""
    every_block: list[Block] = []
    for page in pages:
        every_block += blocks(page)
    differences = []
    # Each command runs in a separate process.
    with Progress("results") as progress, ThreadPoolExecutor(os.cpu_count()) as pool:
        texts = pool.map(printed, [block.command for block in every_block])
        for done, (block, text) in enumerate(zip(every_block, texts, strict=True), 1):
            differences.append(block.difference(text))
            progress(done, len(every_block), str(block.page))
    wrong = [difference for difference in differences if difference]
    checked = f"{count_of(len(pages), 'page')} checked: every number follows from the outcomes"
    print("\n".join(wrong) or checked)
    return 1 if wrong else 0


def write(pages: Sequence[Path]) -> int:
    """Replace the blocks of pages by what their commands print; returns 0."""
    for page in pages:
        list(blocks(page))  # Its marks are whole.
        write_bytes(page, BLOCK.sub(filled, text_of(page)).encode())
    return 0


@dataclass(frozen=True)
class Block:
    """A part of a page, the command that prints it, and the line of its first mark."""

    page: Path
    command: str
    text: str
    line: int

    def difference(self, printed_text: str) -> str:
        """The block's place and the first differing line of either side; empty without one."""
        first = {"-": "nothing more", "+": "nothing more"}
        changed = [
            line
            for line in ndiff(self.text.splitlines(), printed_text.splitlines())
            if line[0] in first
        ]
        if not changed:
            return ""
        for line in reversed(changed):
            first[line[0]] = line[2:]
        place = f"{self.page}, line {self.line}"
        return (
            f"{place}: expected what `{self.command}` prints, got another text\n"
            f"  page    {first['-']}\n"
            f"  command {first['+']}"
        )


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page; InputError if it has none, or a broken one."""
    text = text_of(page)
    begun, whole = len(MARK.findall(text)), len(BLOCK.findall(text))
    if begun != whole or not begun:
        raise InputError(
            f"{page}: expected blocks from `<!-- made by: COMMAND -->` to `<!-- end -->`, "
            f"got {begun} begun and {whole} whole"
        )
    for match in BLOCK.finditer(text):
        line = text[: match.start()].count("\n") + 1
        yield Block(page, match["command"], match["text"], line)


def text_of(page: Path) -> str:
    """The text of a page; InputError if there is none."""
    try:
        return page.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{page}: expected a readable page, got {reason}") from error


def published(root: Path) -> list[Path]:
    """The pages with blocks."""
    pages = [root / "README.md", *sorted(root.glob("docs/**/*.md"))]
    return [page for page in pages if MARK.search(page.read_text())]


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
        reason = done.stderr.strip().splitlines()[-1:]
        raise InputError(": ".join([f"`{command}` ended with {done.returncode}", *reason]))
    return f"\n{done.stdout.strip()}\n\n"


def filled(block: re.Match[str]) -> str:
    """A block with what its command prints."""
    return f"<!-- made by: {block['command']} -->\n{printed(block['command'])}<!-- end -->"


if __name__ == "__main__":
    sys.exit(main())
