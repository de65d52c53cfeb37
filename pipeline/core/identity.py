"""The identity of campaigns and tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.core.columns import column


@dataclass(frozen=True, order=True)
class CampaignId:
    """A campaign: a strategy tests a model version on a scenario.

    Campaigns with other seeds repeat it.
    """

    scenario: str = column("functional scenario")
    strategy: str = column("test strategy")
    version: str = column("model version under test")
    seed: int = column("seed of the campaign")

    def __str__(self) -> str:
        return f"{self.scenario}-{self.strategy}-{self.version}-{self.seed}"

    def tests(self, count: int) -> Iterator[TestId]:
        """Its first `count` tests."""
        return (TestId(self, index) for index in range(count))


@dataclass(frozen=True, order=True)
class TestId:
    """A test execution: the campaign that it belongs to and its number in it, from 0."""

    campaign: CampaignId
    index: int

    def __str__(self) -> str:
        """Its name in the tables, as `F1-random-base-0-00007`."""
        return f"{self.campaign}-{self.index:05d}"
