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
    """The distribution of a variable over parts of its range, or over single values.

    Args:
        shares: (m,) of the parts or values; they sum to 1.
        even: the variable's uniform density, or the uniform share of a value.
        edges: (m + 1,) ends of the parts; inside a part every value is equally likely.
        values: (m,) encoded, for an integer or categorical variable; `edges` is empty then.
    """

    shares: Floats
    even: float
    edges: Floats
    values: Floats

    @staticmethod
    def parts(variable: Variable, edges: ArrayLike, shares: ArrayLike) -> Marginal:
        """A marginal of a continuous or integer variable.

        Args:
            variable: its upper bound counts as its lower bound if it is cyclic.
            edges: (m + 1,) ends of the parts, rising inside the variable's bounds. A part of an
                integer variable has the whole numbers from its lower end to below its upper end,
                the last part also that end.
            shares: (m,) of the parts; they sum to 1.

        Raises:
            ValueError: wrong edges or shares.
        """
        ends, mass = np.asarray(edges, float), _checked(shares)
        if (
            len(ends) != len(mass) + 1
            or not (np.diff(ends) > 0).all()
            or ends[0] < variable.low
            or ends[-1] > variable.high
        ):
            raise ValueError(
                f"edges must rise within [{variable.low:g}, {variable.high:g}], "
                f"one more than shares ({len(mass)}), got {ends.tolist()}"
            )
        if variable.kind == "continuous":
            return Marginal(mass, 1 / (variable.high - variable.low), ends, np.zeros(0))
        # A cyclic variable's ends are one value.
        whole = np.arange(variable.low, variable.high + (0 if variable.cyclic else 1))
        part = np.searchsorted(ends, whole, side="right") - 1
        part = np.where(whole == ends[-1], len(mass) - 1, part)
        inside = (part >= 0) & (part < len(mass))
        counts = np.bincount(part[inside], minlength=len(mass))
        if (mass[counts == 0] > 0).any():
            raise ValueError(f"edges must leave a whole number in every part, got {ends.tolist()}")
        each = (mass / np.maximum(counts, 1))[np.clip(part, 0, len(mass) - 1)]
        return Marginal.single(np.where(inside, each, 0.0), whole)

    @staticmethod
    def single(shares: ArrayLike, values: ArrayLike) -> Marginal:
        """A marginal of a categorical or integer variable, with a share for each value."""
        mass = _checked(shares)
        return Marginal(mass, 1 / len(mass), np.zeros(0), np.asarray(values, float))

    def quantile(self, unit: Floats) -> Floats:
        """Convert (n,) uniform numbers in [0, 1) to encoded values that have this distribution."""
        ends = np.concatenate([[0.0], np.cumsum(self.shares)])
        last = int(np.flatnonzero(self.shares)[-1])  # The last part that occurs at all.
        part = np.clip(np.searchsorted(ends, unit * ends[-1], side="right") - 1, 0, last)
        if not len(self.edges):
            return np.asarray(self.values[part])
        within = (unit * ends[-1] - ends[part]) / self.shares[part]
        return np.asarray(self.edges[part] + np.clip(within, 0, 1) * np.diff(self.edges)[part])

    def ratio(self, values: Floats) -> Floats:
        """How many times as likely each value is as under the uniform distribution.

        Args:
            values: (n,) encoded.

        Returns:
            (n,) from 0.
        """
        if not len(self.edges):
            # Only the upper end of a cyclic variable lies above all values: it is the lower end.
            index = np.searchsorted(self.values, values) % len(self.shares)
            return np.asarray(self.shares[index] / self.even)
        part = np.searchsorted(self.edges, values, side="right") - 1
        part = np.clip(part, 0, len(self.shares) - 1)
        inside = (values >= self.edges[0]) & (values <= self.edges[-1])
        return np.where(inside, self._ratios[part], 0.0)

    @property
    def largest_ratio(self) -> float:
        return float(self._ratios.max())

    @property
    def _ratios(self) -> Floats:
        widths = np.diff(self.edges) if len(self.edges) else np.ones(len(self.shares))
        return np.asarray(self.shares / widths / self.even)


def marginal(variable: Variable, plain: Mapping[str, Any]) -> Marginal:
    """The marginal of plain data.

    Args:
        variable: of the marginal.
        plain: `{kind, ...}`. Kinds and their keys: uniform; histogram: edges, shares; normal:
            mean, deviation, cut at the variable's bounds; sun: latitude_deg, hours; shares: a
            share for each category by name; groups: of categories by their attributes.

    Raises:
        ValueError: wrong data; the message names the variable and the key.

    >>> speed = Variable("speed", "continuous", "m/s", low=0, high=3, step=0.5)
    >>> plain = {"kind": "histogram", "edges": [0, 1, 3], "shares": [0.75, 0.25]}
    >>> marginal(speed, plain).quantile(np.array([0.0, 0.375, 0.75])).tolist()
    [0.0, 0.5, 1.0]
    """
    body = {key: value for key, value in plain.items() if key not in ("kind", "source")}
    if (kind := str(plain.get("kind"))) not in KINDS:
        raise ValueError(f"{variable.name}: there is no kind '{kind}'{nearest(kind, KINDS)}")
    if variable.kind not in FOR[kind]:
        kinds = " or ".join(FOR[kind])
        raise ValueError(
            f"{variable.name}: kind '{kind}' is for a variable that is {kinds}, "
            f"this one is {variable.kind}"
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


def _normal(variable: Variable, mean: float, deviation: float) -> Marginal:
    from scipy.special import ndtr

    if not deviation > 0:
        raise ValueError(f"deviation must be above 0, got {deviation}")
    edges = np.linspace(variable.low, variable.high, FINE + 1)
    mass = np.diff(ndtr((edges - mean) / deviation))
    if not mass.sum() > 0:
        raise ValueError(
            f"mean {mean} lies so far from [{variable.low:g}, {variable.high:g}] "
            "that nothing is left"
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
    """Each group divides its share evenly among the categories with attributes in its ranges.

    A range includes its lower end.
    """
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
        wrong = int(np.flatnonzero(taken != 1)[0])
        name = variable.values[wrong]
        raise ValueError(f"every category must be in one group, but {name} is in {taken[wrong]}")
    return Marginal.single(mass, np.arange(variable.size))


KINDS: Mapping[str, Callable[..., Marginal]] = {
    "uniform": uniform,
    "histogram": Marginal.parts,
    "normal": _normal,
    "sun": _sun,
    "shares": _shares,
    "groups": _groups,
}
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
