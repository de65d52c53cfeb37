"""How the report writes the outcomes of the fresh tests that judge a region."""

from __future__ import annotations

from pipeline.artefacts.region_results import Fresh
from pipeline.report.formats import percent


def fresh_counts(found: Fresh) -> str:
    """`3 / 20 = 15.0 % (3.2 to 37.9); errors: 1`."""
    rate = f" = {percent(found.rate)}" if found.rate else ""
    return f"{found.failures} / {found.tests}{rate}" + (
        f"; errors: {found.errors}" if found.errors else ""
    )
