"""Spectra that are sums of few shapes, and products of these."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from radron.agent.geometry import Array


@dataclass(frozen=True)
class Part:
    """Dependence of a mixture on some numbers of a solution. of: slice of the mixture's shapes, n of them. by: (n, numbers, R)
    derivatives of the shapes' strengths in each row.
    """

    of: slice
    by: Array


@dataclass(frozen=True)
class Mixture:
    """Spectra that are sums of few shapes (Q, BINS) with their own strengths (Q, R) in each row. ``direct``: the photons in the
    shapes from the source's side, (Q, BINS). All derivatives are such sums, too; so gradient and information follow from products
    of the few shapes.
    """

    shapes: Array
    direct: Array
    parts: list[Part]
    strengths: Array

    @property
    def counts(self) -> Array:
        """(R, BINS) counts."""
        result: Array = self.strengths.T @ self.shapes
        return result

    @property
    def straight(self) -> Array:
        """(R, BINS) direct photons among the counts."""
        result: Array = self.strengths.T @ self.direct
        return result

    def plus(self, shape: Array, strength: Array) -> Mixture:
        """Return the mixture with a further shape (BINS,), without direct photons, and a number, the logarithm of its strength
        (R,).
        """
        part = Part(slice(len(self.shapes), len(self.shapes) + 1), strength[None, None])
        shapes, direct = np.vstack((self.shapes, shape)), np.vstack((self.direct, np.zeros_like(shape)))
        return Mixture(shapes, direct, [*self.parts, part], np.vstack((self.strengths, strength)))

    def varied(self, by: Array) -> Mixture:
        """Return the mixture with a further number; ``by`` (Q, R): derivatives of the strengths by it."""
        return Mixture(self.shapes, self.direct, [*self.parts, Part(slice(0, len(by)), by[:, None])], self.strengths)

    @property
    def ends(self) -> list[int]:
        """Index of the first number of each part, and the count of all numbers."""
        return [0, *accumulate(part.by.shape[1] for part in self.parts)]


def products(shapes: Array, weight: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return (P, R) sums over the bins of the products of any two shapes (Q, BINS), times the weight (R, BINS); and the index (Q,
    Q) of each two shapes' product.
    """
    first, second = np.tril_indices(len(shapes))
    pairs = np.empty((len(shapes), len(shapes)), np.int64)
    pairs[first, second] = pairs[second, first] = np.arange(len(first))
    return (shapes[first] * shapes[second]) @ weight.T, pairs
