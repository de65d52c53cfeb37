"""Finds the rule that sets failures apart from passing tests: a beam search in which each condition pays for its description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True)
class FoundRule:
    """A rule, the length of its description, and its gain: log-likelihood over one rate for all tests, less this length; both in nats."""

    rule: Rule
    price: float
    gain: float


def find_rule(space: Space, points: Floats, failed: Bools, words: Sequence[Word] = ()) -> FoundRule:
    """Find the conjunction of at most `MAX_CONDITIONS` conditions that best tells failures from passing tests.

    points: (n, d). failed: (n,). words: that conditions may use. The best rule explains the outcomes by two rates, inside and outside, in
    the fewest words: the gain in log-likelihood less the description length (Rissanen 1978). So a list of names, long to describe, wins
    only if no word, attribute or interval tells as much. The rule is empty if nothing pays.
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
        best = max(best, beam[0], key=lambda found: found[0])
    gain, conditions = search.polished(best)
    return FoundRule(
        _in_words(_rule(conditions), meanings(space, words)),
        sum(offer.price for offer in conditions.values()),
        gain,
    )


def _rule(partial: Partial) -> Rule:
    return Rule(
        tuple(
            sorted(
                (offer.condition for offer in partial.values()),
                key=lambda condition: condition.variable,
            )
        )
    )


def _in_words(rule: Rule, known: Sequence[Meaning]) -> Rule:
    """The rule with a word for each attribute and value that means the same."""
    words = {(meaning.variable, meaning.values): meaning for meaning in known}
    same = [
        (condition, words.get((condition.variable, condition.values)))
        for condition in rule.conditions
    ]
    return Rule(
        tuple(
            replace(condition, text=word.text, order=word.order) if word else condition
            for condition, word in same
        )
    )


@dataclass(frozen=True)
class _Search:
    """descriptions: of the tests. points: (n, d). failed: (n,)."""

    descriptions: Sequence[Description]
    points: Floats
    failed: Bools

    def extended(self, beam: Sequence[tuple[float, Partial]]) -> list[tuple[float, Partial]]:
        """The best rules with one more condition than those of the beam, best first."""
        found: dict[Rule, tuple[float, Partial]] = {}
        for _, partial in beam:
            inside = _rule(partial).holds(self.points)
            for index in sorted(set(range(len(self.descriptions))) - set(partial)):
                gain, longer = self.with_condition(partial, index, inside)
                if index in longer:
                    found[_rule(longer)] = gain, longer
        return sorted(found.values(), key=lambda one: -one[0])[:BEAM]

    def with_condition(self, partial: Partial, index: int, inside: Bools) -> tuple[float, Partial]:
        """The rule with the best condition of one description; without it if there is none. inside: (n,), what `partial` admits."""
        offer = self.descriptions[index].best(inside, self.failed)
        if offer is None:
            return -np.inf, partial
        return offer.gain - sum(other.price for other in partial.values()), {
            **partial,
            index: offer,
        }

    def polished(self, found: tuple[float, Partial]) -> tuple[float, Partial]:
        """The rule with every condition fitted again beside the others, until none improves it."""
        best = found
        for _ in range(POLISHES):
            before = best[0]
            for index in best[1]:
                others = {other: offer for other, offer in best[1].items() if other != index}
                again = self.with_condition(others, index, _rule(others).holds(self.points))
                best = max(best, again, key=lambda one: one[0])
            if best[0] <= before:
                break
        return best
