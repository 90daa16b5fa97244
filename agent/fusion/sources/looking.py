"""Where the swarm looks before it is clear what is there: at what the track, or its search, takes for a source.

On lanes the swarm would pass a source and learn little of it, and one that moves is elsewhere when they come by again. So the
search of a track leads the drones to what was measured: before anything is told, for ``_LEADS_NS`` from when the track began; and
where one source of its nuclide is told, at rest, for as long from when that became doubtful. A search for one source is in the
middle of several: where more of the nuclide are told it leads nowhere.

What the search finds may move, and is looked at: for ``_LOOK_NS`` from the doubt the first source is told with the track as its
``look``, as long as P(at rest) < ``_CLEAR``. Drones circle that place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from msgspec.structs import replace

from agent.fusion.bayes.estimator import BayesEstimator
from agent.fusion.estimator import GridStep, Outlook
from agent.fusion.sources.tracker import Track

_LEADS_NS, _LOOK_NS = 60_000_000_000, 25_000_000_000
_CLEAR = 0.8  # P(at rest) from which on a source needs no look
_IS_NONE = 0.5  # P(no source), with which there is nothing to look for


def led(
    known: Outlook | None, told: Sequence[str], track: Track, bayes: BayesEstimator, nuclide: str, step: GridStep
) -> Outlook | None:
    """Where further sources may hide (``known``), led by the track's search where that takes something to be there.

    told: the nuclides of all sources that are told. bayes: the estimator of the track, and nuclide its nuclide.
    """
    since_ns = track.doubted_ns if told else track.begun_ns
    if step.start_ns - since_ns > _LEADS_NS or told.count(nuclide) > 1:
        return known
    lead = bayes.outlook(track.state, step)
    if lead is None or lead.none >= _IS_NONE:
        return known
    lead = dataclasses.replace(lead, excluded_bq=None)  # of one nuclide it would say nothing of the others
    return lead if known is None else dataclasses.replace(known, lead=lead)


def doubted(track: Track, now_ns: int) -> Track:
    """Since when it is not clear whether what is told is at rest."""
    return track if track.doubted_ns or track.at_rest >= _CLEAR else replace(track, doubted_ns=now_ns)


def looks(track: Track, step: GridStep) -> bool:
    """Whether it is not clear that the source is at rest, and a look at it does not last too long."""
    return not track.at_rest >= _CLEAR and step.start_ns - track.doubted_ns < _LOOK_NS
