"""Spectra that are sums of few shapes, and the derivatives of the likelihood by the numbers of their strengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from radron.agent.fusion.sources.hidden import Expected, Views
from radron.agent.geometry import Array


@dataclass(frozen=True)
class Part:
    """Dependence of a mixture on some numbers of a solution. of: slice of the mixture's shapes, n of them. by: (n, numbers, R)
    derivatives of the shapes' strengths in each row.
    """

    of: slice
    by: Array


@dataclass(frozen=True)
class Fields:
    """Derivatives of a mixture's counts by F further numbers, which are no sums of few shapes: (F, R, BINS) each. ``direct``: the
    photons in them from the source's side.
    """

    whole: Array
    direct: Array


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

    @property
    def ends(self) -> list[int]:
        """Index of the first number of each part, and the count of all numbers."""
        return [0, *accumulate(part.by.shape[1] for part in self.parts)]


def derived(
    mixture: Mixture, fields: Fields | None, expected: Expected, seen: Views, groups: Sequence[slice]
) -> tuple[Array, Array]:
    """Return gradient (G, p) and Fisher information (G, p, p) of each group of rows, by the p numbers of a mixture and of
    fields, the last ones.
    """
    towards = seen.along(mixture.shapes, mixture.direct).T  # (Q, R)
    between, pairs = products(mixture.shapes, seen.information[:, None] / expected.clear)
    ends, size = mixture.ends, mixture.ends[-1] + (0 if fields is None else len(fields.whole))
    gradients, informations = np.empty((len(groups), size)), np.empty((len(groups), size, size))
    for place, part in enumerate(mixture.parts):
        own = slice(ends[place], ends[place + 1])
        by_row = (part.by * towards[part.of, None]).sum(axis=0)  # (numbers, R)
        for group, rows in enumerate(groups):
            gradients[group, own] = by_row[:, rows].sum(axis=1)
        for other in range(place + 1):
            theirs = slice(ends[other], ends[other + 1])
            before = mixture.parts[other]
            crossed = np.einsum("abr,bjr->ajr", between[pairs[part.of, before.of]], before.by)
            for group, rows in enumerate(groups):
                block = (part.by[:, :, rows] @ crossed[:, :, rows].swapaxes(1, 2)).sum(axis=0)
                informations[group, own, theirs] = block
                informations[group, theirs, own] = block.T
    if fields is not None:
        _enter(fields, mixture, expected, seen, groups, gradients, informations)
    return gradients, informations


def _enter(
    fields: Fields,
    mixture: Mixture,
    expected: Expected,
    seen: Views,
    groups: Sequence[slice],
    gradients: Array,
    informations: Array,
) -> None:
    """Enter the F last numbers of gradients (G, p) and informations (G, p, p), those of the fields."""
    weighted = fields.whole * (seen.information[:, None] / expected.clear)  # (F, R, BINS)
    towards, crossed = seen.along_fields(fields.whole, fields.direct), weighted @ mixture.shapes.T  # (F, R), (F, R, Q)
    own = slice(mixture.ends[-1], None)
    for group, rows in enumerate(groups):
        gradients[group, own] = towards[:, rows].sum(axis=1)
        informations[group, own, own] = np.tensordot(weighted[:, rows], fields.whole[:, rows], ((1, 2), (1, 2)))
        for place, part in enumerate(mixture.parts):
            theirs = slice(mixture.ends[place], mixture.ends[place + 1])
            block = np.einsum("frq,qnr->fn", crossed[:, rows, part.of], part.by[:, :, rows], optimize=True)
            informations[group, own, theirs], informations[group, theirs, own] = block, block.T


def products(shapes: Array, weight: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return (P, R) sums over the bins of the products of any two shapes (Q, BINS), times the weight (R, BINS); and the index (Q,
    Q) of each two shapes' product.
    """
    first, second = np.tril_indices(len(shapes))
    pairs = np.empty((len(shapes), len(shapes)), np.int64)
    pairs[first, second] = pairs[second, first] = np.arange(len(first))
    return (shapes[first] * shapes[second]) @ weight.T, pairs
