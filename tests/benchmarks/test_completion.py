"""Completions of random small domains are optimal and certified; the search that says so knows what can be completed."""

from __future__ import annotations

import completion
import pytest


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_completions_are_optimal_and_certified(first: int) -> None:
    for seed in range(first, first + 10):
        case = completion.random_case(seed)
        assert completion.is_optimal(case, case.completion), f"case {seed}"


def test_the_search_finds_small_completions() -> None:
    found = 0
    for case in map(completion.random_case, range(20)):
        fewest = len(case.completion.categories)
        if fewest <= 6:
            found += 1
            assert completion.can_complete(case, case.missing(), fewest, set())
    assert found >= 5
