"""Finite fields, as tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.space import Ints


@dataclass(frozen=True)
class Field:
    """A field of q elements 0 to q - 1, where 0 is zero and 1 is one.

    add, times: (q, q) sums and products.
    characteristic: the prime p of which q is a power.
    """

    add: Ints
    times: Ints
    characteristic: int

    def powers(self) -> Ints:
        """The powers 0 to q - 2 of an element that generates all units."""
        for element in range(1, len(self.times)):
            powers = [1]
            while (following := int(self.times[powers[-1], element])) != 1:
                powers.append(following)
            if len(powers) == len(self.times) - 1:
                return np.array(powers)
        raise AssertionError("the units of a finite field are cyclic")

    def translations(self) -> tuple[Ints, ...]:
        """Generators of x -> x + b: a basis of the field's sums."""
        basis, element = [], 1
        while element < len(self.add):
            basis.append(self.add[element])
            element *= self.characteristic
        return tuple(basis)


def galois_field(order: int) -> Field | None:
    """The field of `order` elements; None if the order is no prime power.

    An element is a polynomial over the integers modulo p, its coefficients the digits of its
    number. Products are taken modulo the first polynomial that leaves no zero divisors.

    >>> galois_field(4).times.tolist()
    [[0, 0, 0, 0], [0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2]]
    >>> galois_field(6) is None
    True
    """
    if order < 2:
        return None
    prime = next(divisor for divisor in divisors(order) if divisor > 1)
    degree = round(np.log(order) / np.log(prime))
    if prime**degree != order:
        return None
    weights = prime ** np.arange(degree)
    digits = np.arange(order)[:, None] // weights % prime
    add = (digits[:, None] + digits) % prime @ weights
    for modulus in digits:
        shifted = [digits]
        for _ in range(degree - 1):
            last = shifted[-1]
            raised = np.pad(last[:, :-1], ((0, 0), (1, 0)))
            shifted.append((raised + last[:, -1:] * modulus) % prime)
        times = np.einsum("ai,ibk->abk", digits, np.array(shifted)) % prime @ weights
        if times[1:, 1:].all():
            return Field(add, times, prime)
    raise AssertionError("there is an irreducible polynomial of every degree")


def divisors(number: int) -> list[int]:
    """The divisors, smallest first."""
    return [divisor for divisor in range(1, number + 1) if number % divisor == 0]
