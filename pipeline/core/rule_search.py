"""Finds the rule that sets failures apart from passing tests.

A beam search in which each condition pays for its description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from pipeline.core.descriptions import Description, Offer, describe
from pipeline.core.rules import Bools, Rule
from pipeline.core.space import Floats, Space
from pipeline.core.words import Meaning, Word, meanings

MAX_CONDITIONS = 4
BEAM = 4
"""Partial rules that are carried on."""
POLISHES = 4
"""Passes in which each condition is fitted again beside the others."""
Partial = Mapping[int, Offer]
"""Conditions by the index of their description."""
_gain = itemgetter(0)


@dataclass(frozen=True)
class FoundRule:
    """A rule with its description length and its gain, both in nats.

    gain: log-likelihood over a common failure rate for all tests, less the description length.
    """

    rule: Rule
    price: float
    gain: float


def find_rule(space: Space, points: Floats, failed: Bools, words: Sequence[Word] = ()) -> FoundRule:
    """The conjunction of at most `MAX_CONDITIONS` conditions that best separates failures.

    The best rule explains the outcomes by two rates, inside and outside, in the fewest words: the
    gain in log-likelihood less the description length (Rissanen 1978). So a list of names, long to
    describe, wins only if no word, attribute or interval separates the failures as well.

    Args:
        space: of the tests.
        points: (n, d) tests.
        failed: (n,) whether each test failed.
        words: that conditions may use.

    Returns:
        The rule; without conditions if none gains more than its description costs.

    >>> from pipeline.core.space import Variable
    >>> fog = Variable("fog", "continuous", "%", low=0, high=100, step=10)
    >>> space = Space((fog,))
    >>> points = np.arange(0.0, 101.0, 2.0)[:, None]
    >>> find_rule(space, points, points[:, 0] >= 60).rule.text(space)
    'fog >= 60 %'
    """
    if failed.all() or not failed.any():
        return FoundRule(Rule(()), 0.0, 0.0)
    search = _Search(describe(space, points, words), points, failed)
    beam: list[tuple[float, Partial]] = [(0.0, {})]
    best = beam[0]
    for _ in range(MAX_CONDITIONS):
        beam = search.extended(beam)
        if not beam:
            break
        best = max(best, beam[0], key=_gain)
    gain, conditions = search.polished(best)
    rule = _in_words(_rule(conditions), meanings(space, words))
    return FoundRule(rule, sum(offer.price for offer in conditions.values()), gain)


def _rule(partial: Partial) -> Rule:
    conditions = [offer.condition for offer in partial.values()]
    return Rule(tuple(sorted(conditions, key=lambda condition: condition.variable)))


def _in_words(rule: Rule, all_meanings: Sequence[Meaning]) -> Rule:
    """The rule with a word for each attribute and value that means the same."""
    words = {(meaning.variable, meaning.values): meaning for meaning in all_meanings}
    conditions = []
    for condition in rule.conditions:
        word = words.get((condition.variable, condition.values))
        if word:
            condition = replace(condition, text=word.text, order=word.order)
        conditions.append(condition)
    return Rule(tuple(conditions))


@dataclass(frozen=True)
class _Search:
    """descriptions: of the tests. points: (n, d). failed: (n,)."""

    descriptions: Sequence[Description]
    points: Floats
    failed: Bools

    def extended(self, beam: Sequence[tuple[float, Partial]]) -> list[tuple[float, Partial]]:
        """The best rules with one more condition than those of the beam, best first."""
        extended: dict[Rule, tuple[float, Partial]] = {}
        for _, partial in beam:
            inside = _rule(partial).holds(self.points)
            for index in sorted(set(range(len(self.descriptions))) - set(partial)):
                gain, longer = self.with_condition(partial, index, inside)
                if index in longer:
                    extended[_rule(longer)] = gain, longer
        return sorted(extended.values(), key=_gain, reverse=True)[:BEAM]

    def with_condition(self, partial: Partial, index: int, inside: Bools) -> tuple[float, Partial]:
        """The rule with the best condition of a description; without it if there is none.

        inside: (n,) whether `partial` admits each test.
        """
        offer = self.descriptions[index].best(inside, self.failed)
        if offer is None:
            return -np.inf, partial
        gain = offer.gain - sum(other.price for other in partial.values())
        return gain, {**partial, index: offer}

    def polished(self, candidate: tuple[float, Partial]) -> tuple[float, Partial]:
        """The rule with every condition fitted again beside the others, until none improves it."""
        best = candidate
        for _ in range(POLISHES):
            before = best[0]
            for index in best[1]:
                others = {other: offer for other, offer in best[1].items() if other != index}
                refitted = self.with_condition(others, index, _rule(others).holds(self.points))
                best = max(best, refitted, key=_gain)
            if best[0] <= before:
                break
        return best
