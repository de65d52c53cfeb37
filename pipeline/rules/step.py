"""The script of every rule: performs the step that the rule is named after."""

import sys
from pathlib import Path
from typing import Any

from pipeline.artefacts.stamp_parts import MARKS
from pipeline.config.composing import of_snakemake
from pipeline.contract import REJECTED, Order, perform
from pipeline.errors import InputError, explained, one_line


def main(job: Any) -> None:
    """Perform the job that Snakemake hands over."""
    order = Order(
        step=job.rule,
        wildcards=dict(job.wildcards.items()),
        reads={name: files for name, files in job.input.items() if name != MARKS},
        writes=dict(job.output.items()),
        stamp=job.params.stamp,
        threads=job.threads,
        log=Path(job.log[0]),
    )
    try:
        perform(order, of_snakemake(job.config))
    except KeyboardInterrupt:
        sys.exit(130)  # Whoever started Snakemake reports that it was stopped.
    except Exception as error:
        explanation = explained(error)
        if explanation is None:
            raise
        if isinstance(explanation, InputError):
            REJECTED.touch()
        sys.exit(f"blindspot {job.rule}: {one_line(explanation)}")


if __name__ == "__main__":  # Worker processes import this file, too.
    main(globals()["snakemake"])
