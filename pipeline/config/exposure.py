"""The files of conf/exposure: how often conditions and scenarios occur, with public sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationError, model_validator

from pipeline.config.messages import message
from pipeline.config.sections import Section
from pipeline.config.yaml_text import read_yaml
from pipeline.core.exposure import Exposure
from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.errors import InputError

FOLDER = Path(__file__).resolve().parents[1] / "conf" / "exposure"
Source = Annotated[str, Field(min_length=10)]


def _with_source(plain: dict[str, Any]) -> dict[str, Any]:
    if len(str(plain.get("source", ""))) < 10:
        raise ValueError(
            "needs 'source', the public source of its numbers in words, "
            "or 'Assumed.' with the reason"
        )
    return plain


Distribution = Annotated[dict[str, Any], AfterValidator(_with_source)]
"""A distribution as `pipeline.core.marginals.marginal` reads it, and its source."""


class Occurrence(Section):
    """How often each functional scenario occurs (the vector q of thesis Def. 4.12)."""

    source: Source
    shares: dict[str, Annotated[float, Field(gt=0, le=1)]]
    """By file name in conf/scenario; together 1."""

    @model_validator(mode="after")
    def _sum_to_one(self) -> Occurrence:
        if abs(sum(self.shares.values()) - 1) > 1e-6:
            raise ValueError(f"shares must sum to 1, got {sum(self.shares.values()):g}")
        return self


class Regime(Section):
    """Conditions that occur together, such as rain and umbrellas.

    Its variables replace those of the whole exposure.
    """

    share: float = Field(gt=0, le=1)
    source: Source
    variables: dict[str, Distribution]


class ExposureFile(Section):
    """One exposure. Variables that it does not name are uniform."""

    description: str
    scenarios: Occurrence | None = None
    variables: dict[str, Distribution] = Field(default_factory=dict)
    regimes: dict[str, Regime] = Field(default_factory=dict)

    @property
    def uniform(self) -> bool:
        """Whether it is the distribution of random testing."""
        return not self.variables and not self.regimes

    @property
    def plain(self) -> dict[str, Any]:
        """The distribution without its sources, for `pipeline.core.exposure.Exposure.from_dict`."""
        regimes = {
            name: {"share": regime.share, "variables": _numbers(regime.variables)}
            for name, regime in self.regimes.items()
        }
        return {"variables": _numbers(self.variables), "regimes": regimes}

    def of(self, scenario: str, space: Space) -> Exposure:
        """The exposure of a scenario's space; InputError if it does not fit."""
        try:
            exposure = Exposure.from_dict(space, self.plain)
            exposure.check()
        except ValueError as error:
            raise InputError(f"exposure for {scenario}: {error}") from error
        return exposure

    def shares(self, scenarios: Sequence[str]) -> list[float]:
        """How often each of some scenarios occurs, given that one of them does.

        Raises:
            InputError: a scenario has no share.
        """
        if len(scenarios) == 1:
            return [1.0]
        shares = self.scenarios.shares if self.scenarios else {}
        for name in scenarios:
            if name not in shares:
                hint = nearest(name, shares) if shares else ""
                raise InputError(f"exposure: it has no share of scenario '{name}'{hint}")
        total = sum(shares[name] for name in scenarios)
        return [shares[name] / total for name in scenarios]


def read_exposure(name: str) -> ExposureFile:
    """The exposure of a name in conf/exposure, or of a YAML file.

    Raises:
        InputError: no such file, or wrong contents; the message names the file and key.
    """
    path = Path(name) if name.endswith((".yaml", ".yml")) else FOLDER / f"{name}.yaml"
    if not path.is_file():
        names = [file.stem for file in FOLDER.glob("*.yaml")]
        raise InputError(
            f"exposure: there is no '{name}'{nearest(name, names)}, or name a .yaml file"
        )
    try:
        return ExposureFile.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(f"{path}: {message(error, ExposureFile)}") from error


def _numbers(variables: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    numbers = {}
    for name, body in variables.items():
        numbers[name] = {key: value for key, value in body.items() if key != "source"}
    return numbers
