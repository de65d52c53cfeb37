"""Outcomes of a version's tests, written as text."""

from __future__ import annotations

import numpy as np

from pipeline.core.comparison import SequenceOutcomes


def outcomes(signs: str) -> SequenceOutcomes:
    """By sign: '.' passes, 'c' fails by TTC, 'f' by false positives, 'e' is an error."""
    each = np.array(list(signs))
    return SequenceOutcomes(each != "e", (each == "c") | (each == "f"), each == "c")
