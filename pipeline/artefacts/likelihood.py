"""rate.json: the failure rate of an estimator's campaign, with the campaign's identity."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from pipeline.artefacts.files import read_json, write_json
from pipeline.core.likelihood.rate import Limits, Rate
from pipeline.errors import InputError


def write_rate(path: Path, identity: str, rate: Rate) -> None:
    """Write a rate."""
    write_json(path, {"identity": identity, **asdict(rate)})


def read_rate(path: Path, identity: str) -> Rate | None:
    """The rate of a finished campaign; None if there is none of this identity.

    InputError if the file is damaged.
    """
    if not path.exists() or (plain := read_json(path)).pop("identity", None) != identity:
        return None
    try:
        return Rate(**{**plain, "limits": Limits(**plain["limits"])})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: expected a failure rate, got another file; delete it and start again"
        ) from error
