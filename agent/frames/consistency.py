"""Agreement of the sightings between each pair of drones with their estimated poses.

A wrong frame (a spoofed or faulty pose, an unreported jump) turns nearly all sightings of that drone into outliers; correct
drones have one outlier in ten. With three or more drones the pairs identify the faulty drone: it disagrees with all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radron.agent.frames.residuals import Sightings
from radron.agent.geometry import Array

Flags = NDArray[np.bool_]

KEYFRAMES = 4  # number of keyframes over which sightings are counted
_FEWEST, _FEW, _ENOUGH = 2, 4, 8  # sightings of a pair to agree once, to agree, to disagree (rarely by chance)
_AGREE, _DISAGREE = 0.6, 0.35  # shares of inliers


@dataclass(frozen=True, slots=True)
class Tally:
    """How well the sightings (relative observations) between each pair of N drones agree with the estimated poses, in one
    keyframe (time of an estimate).

    Arrays (N, N) by observer and target: believed: sum of the probabilities that the sightings are correct; seen: number of
    sightings.
    """

    believed: Array
    seen: Array


def tally(count: int, sightings: Sightings, weights: Array) -> Tally:
    """Count for each pair of drones the sightings in one keyframe (time of a frame estimate), and how many of them fit the
    estimate.

    count: number of drones in the mission. weights: (M,) probability that each of the M sightings is correct.
    """
    believed, seen = np.zeros((count, count)), np.zeros((count, count))
    np.add.at(believed, (sightings.observer, sightings.target), weights)
    np.add.at(seen, (sightings.observer, sightings.target), 1.0)
    return Tally(believed, seen)


def without(one: Tally, drone: int) -> Tally:
    """Return a copy of the counts in which the counts of one drone are zero."""
    believed, seen = one.believed.copy(), one.seen.copy()
    for array in (believed, seen):
        array[drone] = array[:, drone] = 0.0
    return Tally(believed, seen)


def agreeing(one: Tally) -> Flags:
    """Return a mask (N,) of the drones whose sightings agree with the estimate for at least one other drone."""
    both, believed = one.seen + one.seen.T, one.believed + one.believed.T
    fits: Flags = (both >= _FEWEST) & (believed >= _AGREE * both)
    confirmed: Flags = np.any(fits, axis=1)
    return confirmed


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of comparing the sightings between N drones with the estimated poses.

    agree, disagree: (N, N), symmetric masks of pairs of drones, whichever was the observer. blind: (N,) mask of drones nearly all
    of whose own sightings are wrong.
    """

    agree: Flags
    disagree: Flags
    blind: Flags

    def faulty_drone(self) -> int | None:
        """Return the drone whose frame is certainly wrong; None without a contradiction, or if several drones may be the cause.

        The faulty drone disagrees with more drones than it agrees with, and more so than the drones in disagreement with it.
        Several faulty drones are found one after another.
        """
        score = self.disagree.sum(1) - self.agree.sum(1)
        for drone in np.argsort(-score, kind="stable"):
            against = self.disagree[drone]
            if against.any() and score[drone] > 0 and score[against].min() < score[drone] >= score[against].max():
                return int(drone)
        return None

    def conflicts(self) -> list[tuple[int, int]]:
        """Return the pairs of drones whose relative observations contradict the estimated poses, each pair once."""
        return [(int(a), int(b)) for a, b in np.argwhere(np.triu(self.disagree))]


def verdict(tallies: Sequence[Tally]) -> Verdict:
    """Judge for each pair of drones whether their relative observations agree with the estimated poses.

    tallies: the counts of several keyframes (times of an estimate), which are added.
    """
    believed, seen = sum(one.believed for one in tallies), sum(one.seen for one in tallies)
    assert isinstance(believed, np.ndarray)
    assert isinstance(seen, np.ndarray)
    # One agreeing direction is enough: a drone with a faulty camera is still seen at its true place.
    good = (seen >= _FEW) & (believed >= _AGREE * seen)
    bad = (seen >= _ENOUGH) & (believed <= _DISAGREE * seen)
    both = seen + seen.T
    agree = good | good.T | ((both >= _FEW) & (believed + believed.T >= _AGREE * both))
    disagree = (bad | bad.T | ((both >= _ENOUGH) & (believed + believed.T <= _DISAGREE * both))) & ~agree
    own = seen.sum(1)
    return Verdict(agree, disagree, (own >= _ENOUGH) & (believed.sum(1) <= _DISAGREE * own))
