"""The base of all result files, and how they are written and read.

Each file is one frozen model; `read` and `write` check it, so truncated, foreign and outdated files
are rejected by name. Numbers that do not exist (the F-measure of a campaign without failures) are
null, never NaN.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.artefacts.files import read_json, write_json
from pipeline.config.messages import message
from pipeline.core.counted import Counted
from pipeline.errors import InputError

ModelT = TypeVar("ModelT", bound="Result")


class Result(BaseModel):
    """Base of all result models: frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Estimate(Result):
    """A value with its confidence interval [low, high], in the value's own unit."""

    value: float
    low: float
    high: float

    @staticmethod
    def of(counted: Counted, confidence: float) -> Estimate | None:
        """The failure rate of independent tests with its exact interval; None without tests."""
        low, high = counted.interval(confidence)
        return (
            Estimate(value=counted.failures / counted.tests, low=low, high=high)
            if counted.tests
            else None
        )


def write(path: Path, result: Result) -> None:
    """Write a result atomically as JSON."""
    write_json(path, result.model_dump(mode="json"))


def read(path: Path, model: type[ModelT]) -> ModelT:
    """Read a result of the given model.

    Raises InputError that names the file and the first wrong key if the file is not such a result.
    """
    plain = read_json(path)
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        raise InputError(
            f"{path} is not a {model.__name__} file: {message(error, model)}; make it again"
        ) from error
