"""The three interfaces of Blindspot: sampler, world and detector.

Adapters (MuJoCo, ONNX Runtime, your own) implement these protocols; `pipeline.testing` provides a
checker for each. This module needs only numpy.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from pipeline.core.interfaces import Detector, Observation, World
from pipeline.core.space import Floats

__all__ = ["Admitted", "Detector", "Observation", "Sampler", "World"]

Admitted = tuple[float, float] | tuple[str, ...]
"""What a world takes of a variable: lowest and highest number, or names; anything if empty."""


@runtime_checkable
class Sampler(Protocol):
    """A test strategy by ask and tell. Its state is its history: telling the same rows restores it.

    Points are (n, d) float64 in the encoding of `pipeline.core.space.Space`: categorical variables
    by index. `pipeline.testing.check_sampler` checks an implementation.

    >>> from pipeline.core.samplers.random import RandomSampler
    >>> from pipeline.core.space import Space
    >>> percent = {"kind": "continuous", "unit": "%", "low": 0, "high": 100, "step": 10}
    >>> sampler = RandomSampler(Space.from_dict({"rain": percent, "fog": percent}), seed=0)
    >>> isinstance(sampler, Sampler), sampler.ask().shape[1]
    (True, 2)
    """

    def ask(self) -> Floats:
        """Choose the next tests.

        Returns:
            The next batch of untested points, (b, d); none, (0, d), ends the campaign.
        """
        ...

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Record the results of the asked points.

        Args:
            points: (b, d), as `ask` returned them.
            kpi: (b,) seconds, NaN for an error. At or below the threshold, a test has failed.
        """
        ...
