"""How often each value of one variable occurs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.names import nearest
from pipeline.core.sun import altitudes
from pipeline.core.variable import Floats, Variable

FINE = 400
"""Parts into which a smooth density is cut, each of them even."""
SLACK = 1e-6
"""How far shares may miss 1 by rounding."""


@dataclass(frozen=True, eq=False)
class Marginal:
    """The distribution of one variable: `shares` (m,), which sum to 1, of parts of its range or of single values.

    edges: (m + 1,), the parts' ends; inside a part every value is equally likely. values: (m,), encoded, for an integer or categorical
    variable; `edges` is empty then. even: the variable's uniform density, or the uniform share of one value.
    """

    shares: Floats
    even: float
    edges: Floats
    values: Floats

    @staticmethod
    def parts(variable: Variable, edges: ArrayLike, shares: ArrayLike) -> Marginal:
        """A marginal of a continuous or integer variable; a part of an integer variable has the whole numbers from its lower end to below
        its upper end, the last part also that end. A cyclic variable's upper bound counts as its lower bound."""
        ends, mass = np.asarray(edges, float), _checked(shares)
        if (
            len(ends) != len(mass) + 1
            or not (np.diff(ends) > 0).all()
            or ends[0] < variable.low
            or ends[-1] > variable.high
        ):
            raise ValueError(
                f"edges must rise within [{variable.low:g}, {variable.high:g}], one more than shares ({len(mass)}), got {ends.tolist()}"
            )
        if variable.kind == "continuous":
            return Marginal(mass, 1 / (variable.high - variable.low), ends, np.zeros(0))
        whole = np.arange(
            variable.low, variable.high + (0 if variable.cyclic else 1)
        )  # A cyclic variable's ends are one value.
        part = np.where(
            whole == ends[-1], len(mass) - 1, np.searchsorted(ends, whole, side="right") - 1
        )
        counts = np.bincount(part[(part >= 0) & (part < len(mass))], minlength=len(mass))
        if (mass[counts == 0] > 0).any():
            raise ValueError(f"edges must leave a whole number in every part, got {ends.tolist()}")
        inside = (part >= 0) & (part < len(mass))
        return Marginal.single(
            np.where(inside, (mass / np.maximum(counts, 1))[np.clip(part, 0, len(mass) - 1)], 0.0),
            whole,
        )

    @staticmethod
    def single(shares: ArrayLike, values: ArrayLike) -> Marginal:
        """A marginal of a categorical or integer variable, with a share for each of all its values."""
        mass = _checked(shares)
        return Marginal(mass, 1 / len(mass), np.zeros(0), np.asarray(values, float))

    def quantile(self, unit: Floats) -> Floats:
        """Convert (n,) uniform numbers in [0, 1) to encoded values that have this distribution."""
        ends = np.concatenate([[0.0], np.cumsum(self.shares)])
        part = np.clip(np.searchsorted(ends, unit * ends[-1], side="right") - 1, 0, self._last)
        if not len(self.edges):
            return np.asarray(self.values[part])
        within = (unit * ends[-1] - ends[part]) / self.shares[part]
        return np.asarray(self.edges[part] + np.clip(within, 0, 1) * np.diff(self.edges)[part])

    def ratio(self, values: Floats) -> Floats:
        """How many times as likely each of (n,) encoded values is as under the uniform distribution, (n,), from 0."""
        if not len(self.edges):
            # Only the upper end of a cyclic variable lies above all values: it is the lower end.
            return np.asarray(
                self.shares[np.searchsorted(self.values, values) % len(self.shares)] / self.even
            )
        part = np.clip(
            np.searchsorted(self.edges, values, side="right") - 1, 0, len(self.shares) - 1
        )
        inside = (values >= self.edges[0]) & (values <= self.edges[-1])
        return np.where(inside, self._ratios[part], 0.0)

    @property
    def largest_ratio(self) -> float:
        return float(self._ratios.max())

    @property
    def _last(self) -> int:
        """The last part that occurs at all."""
        return int(np.flatnonzero(self.shares)[-1])

    @property
    def _ratios(self) -> Floats:
        widths = np.diff(self.edges) if len(self.edges) else np.ones(len(self.shares))
        return np.asarray(self.shares / widths / self.even)


def marginal(variable: Variable, plain: Mapping[str, Any]) -> Marginal:
    """The marginal of plain data, `{kind, ...}`; ValueError that names what is wrong.

    uniform; histogram: edges, shares; normal: mean, deviation, cut at the variable's bounds; sun: latitude_deg, hours; shares: one for each
    category by name; groups: of categories by their attributes.
    """
    body = {key: value for key, value in plain.items() if key not in ("kind", "source")}
    if (kind := str(plain.get("kind"))) not in KINDS:
        raise ValueError(f"{variable.name}: there is no kind '{kind}'{nearest(kind, KINDS)}")
    if variable.kind not in FOR[kind]:
        raise ValueError(
            f"{variable.name}: kind '{kind}' is for a variable that is {' or '.join(FOR[kind])}, this one is {variable.kind}"
        )
    try:
        return KINDS[kind](variable, **body)
    except KeyError as error:
        raise ValueError(f"{variable.name}: key {error} is missing") from error
    except TypeError as error:
        raise ValueError(f"{variable.name}: {str(error).partition('() ')[2] or error}") from error
    except ValueError as error:
        raise ValueError(f"{variable.name}: {error}") from error


def uniform(variable: Variable) -> Marginal:
    """Every value equally likely."""
    if variable.kind == "categorical":
        return Marginal.single(np.full(variable.size, 1 / variable.size), np.arange(variable.size))
    return Marginal.parts(variable, [variable.low, variable.high], [1.0])


def _histogram(variable: Variable, edges: Sequence[float], shares: Sequence[float]) -> Marginal:
    return Marginal.parts(variable, edges, shares)


def _normal(variable: Variable, mean: float, deviation: float) -> Marginal:
    from scipy.special import ndtr

    if not deviation > 0:
        raise ValueError(f"deviation must be above 0, got {deviation}")
    edges = np.linspace(variable.low, variable.high, FINE + 1)
    mass = np.diff(ndtr((edges - mean) / deviation))
    if not mass.sum() > 0:
        raise ValueError(
            f"mean {mean} lies so far from [{variable.low:g}, {variable.high:g}] that nothing is left"
        )
    return Marginal.parts(variable, edges, mass / mass.sum())


def _sun(variable: Variable, latitude_deg: float, hours: Sequence[float]) -> Marginal:
    """A sun below the variable's range counts as its lowest degree, where it is night anyhow."""
    heights, mass = altitudes(latitude_deg, hours)
    edges = np.append(np.arange(variable.low, variable.high), variable.high)
    counts, _ = np.histogram(np.clip(heights, variable.low, variable.high), edges, weights=mass)
    return Marginal.parts(variable, edges, counts / counts.sum())


def _shares(variable: Variable, shares: Mapping[str, float]) -> Marginal:
    if set(shares) != set(variable.values):
        missing, unknown = set(variable.values) - set(shares), set(shares) - set(variable.values)
        raise ValueError(
            f"shares must name every category; missing {sorted(missing)}, unknown {sorted(unknown)}"
        )
    return Marginal.single([shares[name] for name in variable.values], np.arange(variable.size))


def _groups(variable: Variable, groups: Sequence[Mapping[str, Any]]) -> Marginal:
    """Each group has a share, divided evenly among the categories whose attributes lie in its ranges, lower end included."""
    attributes = {name: np.array(numbers) for name, numbers in variable.attributes}
    mass, taken = np.zeros(variable.size), np.zeros(variable.size, int)
    for group in groups:
        members = np.ones(variable.size, bool)
        if not isinstance(group["where"], Mapping):
            raise ValueError(f"where must be ranges of attributes by name, got {group['where']!r}")
        for name, (low, high) in group["where"].items():
            if name not in attributes:
                raise ValueError(f"there is no attribute '{name}'{nearest(name, attributes)}")
            members &= (attributes[name] >= low) & (attributes[name] < high)
        if not members.any():
            raise ValueError(f"no category is in the group {dict(group['where'])}")
        mass += members * group["share"] / members.sum()
        taken += members
    if (taken != 1).any():
        odd = [name for name, count in zip(variable.values, taken, strict=True) if count != 1]
        raise ValueError(
            f"every category must be in one group, but {odd[0]} is in {taken[variable.values.index(odd[0])]}"
        )
    return Marginal.single(mass, np.arange(variable.size))


KINDS: Mapping[str, Callable[..., Marginal]] = {
    "uniform": uniform, "histogram": _histogram, "normal": _normal, "sun": _sun, "shares": _shares, "groups": _groups,
}  # fmt: skip
FOR: Mapping[str, tuple[str, ...]] = {
    "uniform": ("continuous", "integer", "categorical"),
    "histogram": ("continuous", "integer"),
    **dict.fromkeys(("normal", "sun"), ("continuous",)),
    **dict.fromkeys(("shares", "groups"), ("categorical",)),
}


def _checked(shares: ArrayLike) -> Floats:
    mass = np.asarray(shares, float)
    if not len(mass) or not (mass >= 0).all() or abs(mass.sum() - 1) > SLACK:
        raise ValueError(
            f"shares must be from 0 and sum to 1, got {mass.tolist()}, which sum to {mass.sum():g}"
        )
    return np.asarray(mass / mass.sum())
