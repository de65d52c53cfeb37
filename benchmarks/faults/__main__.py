"""Faults on purpose, and how each ends: one table, exit code 1 if one ends as it should not.

    python -m benchmarks.faults --kills 100 --configs 2000 --damage 500 --repairs 40 --keep
    python -m benchmarks.faults.report                  the table of docs/results/faults.md

--kills and --repairs execute a tiny study in a clone of HEAD: a minute of processor time for each
study and ten seconds for each fault. They print their progress, and resume after the last finished
study or repair as long as HEAD is the same.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.faults.configs import configs
from benchmarks.faults.damage import damage
from benchmarks.faults.kills import kills
from benchmarks.faults.repairs import repairs
from benchmarks.faults.report import keep, table
from benchmarks.faults.study import FaultStudy

KINDS = {
    "--kills": "kill ./run with -9, by turns in each of its phases",
    "--configs": "change params.yaml",
    "--damage": "flip a bit in a file, then read it",
    "--repairs": "flip a bit in one file of each kind of a finished study, then in N files alone",
}


def main() -> int:
    """Cause the faults and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for option, text in KINDS.items():
        parser.add_argument(option, type=int, default=0, metavar="N", help=text)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path(".cache/faults"), help="for the clone")
    parser.add_argument("--keep", action="store_true", help="publish the rows")
    options = parser.parse_args()
    rows = configs(options.configs, options.seed) if options.configs else []
    rows += damage(options.damage, options.seed) if options.damage else []
    if options.kills or options.repairs:
        study = FaultStudy(options.folder.resolve() / "study")
        rows += kills(study, options.kills, options.seed) if options.kills else []
        rows += repairs(study, options.repairs, options.seed) if options.repairs else []
    if options.keep:
        keep(rows)
    print(table(rows))
    return int(any(row.wrong for row in rows))


if __name__ == "__main__":
    sys.exit(main())
