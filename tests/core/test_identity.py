"""Campaigns and tests have unique names."""

from __future__ import annotations

from pipeline.core.identity import CampaignId


def test_the_name_of_a_test_contains_its_campaign_and_index() -> None:
    first, second = CampaignId("F1", "random", "base", 0).tests(2)
    assert (str(first), str(second)) == ("F1-random-base-0-00000", "F1-random-base-0-00001")
    *_, last = CampaignId("left-turn", "forest", "adaptive-r2-s1", 3).tests(100_001)
    assert (str(last), last.campaign.scenario, last.index) == (
        "left-turn-forest-adaptive-r2-s1-3-100000",
        "left-turn",
        100_000,
    )
