"""Where the swarm looks before it is clear what is there: at what the track, or its search, takes for a source.

Before anything is told, the search of a track that has begun leads the drones to what was measured, for ``_LEADS_NS`` at most: on
its lanes the swarm would pass a source and learn little of it, and one that moves is elsewhere when they come by again.

Once sources are told, at rest, it may be that one of them moves, and neither its motion nor its place may show from lanes. So
for ``_LOOK_NS`` from when something is told the first one is told with a ``look``, as long as P(at rest) < ``_CLEAR``: the track,
or the mean and covariance of its search, which knows better than the fit where a source is that moves. Drones circle that place.
Where several of the nuclide are told, its search, which is for one, tells nothing.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from msgspec.structs import replace

from agent.fusion.bayes.estimator import BayesEstimator
from agent.fusion.estimator import GridStep, Hypothesis, Outlook
from agent.fusion.sources.tracker import Track
from agent.terrain.ground import Ground

_LEADS_NS = 60_000_000_000
_LOOK_NS = 25_000_000_000  # after the first doubt whether it is at rest; later on there is no look at it
_CLEAR = 0.8  # P(at rest) from which on a source needs no look
_IS_NONE = 0.5  # P(no source), with which there is nothing to look at


def led(known: Outlook | None, track: Track | None, bayes: BayesEstimator | None, step: GridStep) -> Outlook | None:
    """Where further sources may hide (``known``), led by the track's search where that takes something to be there.

    bayes: the estimator of the track; None without one.
    """
    if track is None or bayes is None or step.start_ns - track.begun_ns > _LEADS_NS:
        return known
    lead = bayes.outlook(track.state, step)
    if lead is None or lead.none >= _IS_NONE:
        return known
    lead = dataclasses.replace(lead, excluded_bq=None)  # of one nuclide it would say nothing of the others
    return lead if known is None else dataclasses.replace(known, lead=lead)


def doubted(track: Track, now_ns: int) -> Track:
    """Since when it is not clear whether what is told is at rest."""
    return track if track.doubted_ns or track.at_rest >= _CLEAR else replace(track, doubted_ns=now_ns)


def is_doubted(track: Track, step: GridStep) -> bool:
    """Whether it is not clear that the source is at rest, and a look at it does not last too long."""
    return not track.at_rest >= _CLEAR and step.start_ns - track.doubted_ns < _LOOK_NS


def looked_for(
    told: Hypothesis, track: Track, bayes: BayesEstimator, nuclide: str, ground: Ground, step: GridStep
) -> Hypothesis | None:
    """Where the source is if it moves: by the track, or by its search; None where that has nothing to say.

    told: sources at rest. bayes: the estimator of the track, and nuclide its nuclide.
    """
    if (tracked := bayes.hypothesis(track.state, step)) is not None:
        return tracked
    if sum(one.nuclide == nuclide for one in (told, *told.others)) > 1:
        return None  # a search for one source is in the middle of several
    outlook = bayes.outlook(track.state, step)
    if outlook is None or outlook.none >= _IS_NONE:
        return None
    weight = outlook.weight / outlook.weight.sum()
    mean = weight @ outlook.places
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.cov(outlook.places.T, aweights=weight, ddof=0)
    position = np.array((*mean, ground.height_m(*mean.tolist())))
    return replace(told, position=position, covariance=covariance, sights={}, others=())
