"""Who contradicts whom: of which pairs of drones the sightings fit to where the two are taken to be.

A frame that is wrong (a drone that lies, a jump nobody told of) makes nearly all sightings of that drone false positives; honest
ones are false in one case of ten. With three drones and more the pairs tell who it is: the one that nobody agrees with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.frames.sightings import Array, Sightings

Flags = NDArray[np.bool_]

KEYFRAMES = 4  # over which sightings are counted
_FEWEST, _FEW, _ENOUGH = (
    2,
    4,
    8,
)  # sightings of one kind for them to agree for a moment, to agree, to disagree (hardly ever by chance)
_AGREE, _DISAGREE = 0.6, 0.35  # shares believed


@dataclass(frozen=True, slots=True)
class Tally:
    """Of one keyframe, by observer and target: believed (N, N) sum of the weights, seen (N, N) number of sightings."""

    believed: Array
    seen: Array


def tally(count: int, sightings: Sightings, weights: Array) -> Tally:
    """Count the sightings of a keyframe; ``count``: drones of the mission."""
    believed, seen = np.zeros((count, count)), np.zeros((count, count))
    np.add.at(believed, (sightings.observer, sightings.target), weights)
    np.add.at(seen, (sightings.observer, sightings.target), 1.0)
    return Tally(believed, seen)


def without(one: Tally, drone: int) -> Tally:
    """The same, nothing counted of one drone."""
    believed, seen = one.believed.copy(), one.seen.copy()
    for array in (believed, seen):
        array[drone] = array[:, drone] = 0.0
    return Tally(believed, seen)


def agreeing(one: Tally) -> Flags:
    """(N,) drones of which a keyframe's sightings between them and another one fit."""
    both, believed = one.seen + one.seen.T, one.believed + one.believed.T
    fits: Flags = (both >= _FEWEST) & (believed >= _AGREE * both)
    confirmed: Flags = np.any(fits, axis=1)
    return confirmed


@dataclass(frozen=True, slots=True)
class Verdict:
    """agree, disagree: (N, N) symmetric, between two drones whichever saw the other. blind: (N,) drones whose own sightings
    are nearly all wrong."""

    agree: Flags
    disagree: Flags
    blind: Flags

    def culprit(self) -> int | None:
        """The drone whose frame must be wrong; None where there is no contradiction, or where it cannot be told whose it is.

        More disagree with it than agree, and more so than with those that disagree with it (several may lie: one after another).
        """
        score = self.disagree.sum(1) - self.agree.sum(1)
        for drone in np.argsort(-score, kind="stable"):
            against = self.disagree[drone]
            if against.any() and score[drone] > 0 and score[against].min() < score[drone] >= score[against].max():
                return int(drone)
        return None

    def quarrels(self) -> list[tuple[int, int]]:
        """Pairs that disagree, each once."""
        return [(int(a), int(b)) for a, b in np.argwhere(np.triu(self.disagree))]


def verdict(tallies: Sequence[Tally]) -> Verdict:
    """What the sightings of some keyframes say together."""
    believed, seen = sum(one.believed for one in tallies), sum(one.seen for one in tallies)
    assert isinstance(believed, np.ndarray)
    assert isinstance(seen, np.ndarray)
    # A pair agrees if either direction does: one with a broken camera is still seen where it is.
    good = (seen >= _FEW) & (believed >= _AGREE * seen)
    bad = (seen >= _ENOUGH) & (believed <= _DISAGREE * seen)
    both = seen + seen.T
    agree = good | good.T | ((both >= _FEW) & (believed + believed.T >= _AGREE * both))
    disagree = (bad | bad.T | ((both >= _ENOUGH) & (believed + believed.T <= _DISAGREE * both))) & ~agree
    own = seen.sum(1)
    return Verdict(agree, disagree, (own >= _ENOUGH) & (believed.sum(1) <= _DISAGREE * own))
