"""How many images per second does retraining show, today and in release 0.2?

git worktree add ../release-0.2 176e057
python benchmarks/retraining_speed.py run ../release-0.2      both in turns, each with its own code; five minutes on two idle cores
python benchmarks/retraining_speed.py answer                  the lines of docs/results/learning.md
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import pandas as pd

PUBLISHED = Path("docs/results/retraining-speed.csv")
TODAY, BEFORE = "today", "0.2"
SPEED = re.compile(r"^retraining +\d+x\d+ +(\d+) images/s", re.MULTILINE)
AIM = 1.8
LINE = 138


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    measure = commands.add_parser("run")
    measure.add_argument("release", type=Path, help="a checkout of release 0.2")
    measure.add_argument("--rounds", type=int, default=5)
    measure.add_argument("--seconds", type=int, default=6, help="of a recipe in a round")
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "answer":
        print(answer(pd.read_csv(PUBLISHED)))
        return
    rows = []
    for number in range(options.rounds):
        for code, folder, more in (
            (TODAY, Path(), ["--rounds", "1"]),
            (BEFORE, options.release, []),
        ):
            rows.append(
                (
                    number,
                    code,
                    speed(folder.resolve(), ["--seconds", str(options.seconds), *more]),
                    processor(),
                )
            )
            print(*rows[-1])
    pd.DataFrame(rows, columns=["round", "code", "images_per_s", "processor"]).to_csv(
        PUBLISHED, index=False
    )


def speed(folder: Path, words: Sequence[str]) -> int:
    """Images per second of the line `retraining` in a checkout's own benchmarks/training.py."""
    command = [sys.executable, "benchmarks/training.py", *words]
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    found = SPEED.search(done.stdout)
    if found is None:
        raise SystemExit(
            f"{folder}/benchmarks/training.py: expected a line 'retraining WxH N images/s', got {done.stdout!r}"
        )
    return int(found[1])


def processor() -> str:
    """The processor's name, as Linux gives it."""
    found = re.search(r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found[1] if found else "unknown"


def answer(rows: pd.DataFrame) -> str:
    """Both speeds and their ratio: medians and ranges over the rounds."""
    speeds = rows.pivot(index="round", columns="code", values="images_per_s")
    ratios = speeds[TODAY] / speeds[BEFORE]
    met = "as aimed at" if ratios.median() >= AIM else f"short of the {AIM} aimed at"
    today, before = (
        f"{speeds[code].median():.0f} (lowest {speeds[code].min()}, highest {speeds[code].max()})"
        for code in (TODAY, BEFORE)
    )
    said = (
        f"Today's retraining shows {today} images per second on two cores ({rows['processor'].iloc[0]}), release 0.2's {before}. "
        f"The median ratio of {len(ratios)} rounds is {ratios.median():.2f} (lowest {ratios.min():.2f}, highest {ratios.max():.2f}), {met}."
    )
    return fill(said, LINE)


if __name__ == "__main__":
    main()
