"""Search cues before a report is certain: the source of a track, or of its search, leads the swarm.

On lanes the swarm would pass a source and learn little of it. A moving source would be elsewhere at the next pass. So the search
of a track leads the drones to the measured source. Before any report this lasts for ``_LEADS_NS`` from the track's begin. With
one reported source of its nuclide, at rest, it lasts as long from the first doubt of this rest. A search for one source is in the
middle of several: with more reported sources of the nuclide, it leads nowhere.

The source found by the search may move and is verified. For ``_LOOK_NS`` from the doubt, the first source is reported with the
track as its ``look``, as long as P(at rest) < ``_CLEAR``. Drones circle that place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from msgspec.structs import replace

from radron.agent.fusion.bayes.estimator import BayesEstimator
from radron.agent.fusion.estimator import GridStep, Outlook
from radron.agent.fusion.sources.tracker import Track

_LEADS_NS, _LOOK_NS = 60_000_000_000, 25_000_000_000
_CLEAR = 0.8  # P(at rest) from which on a source needs no verification
_IS_NONE = 0.5  # P(no source) from which on there is no search cue


def led(
    known: Outlook | None, told: Sequence[str], track: Track, bayes: BayesEstimator, nuclide: str, step: GridStep
) -> Outlook | None:
    """Return the search for further sources (``known``), led by the track's search where that finds a source.

    told: the nuclides of all reported sources. bayes: the estimator of the track, and nuclide its nuclide.
    """
    since_ns = track.doubted_ns if told else track.begun_ns
    if step.start_ns - since_ns > _LEADS_NS or told.count(nuclide) > 1:
        return known
    lead = bayes.outlook(track.state, step)
    if lead is None or lead.none >= _IS_NONE:
        return known
    lead = dataclasses.replace(lead, excluded_bq=None)  # a limit for one nuclide says nothing of the others
    return lead if known is None else dataclasses.replace(known, lead=lead)


def doubted(track: Track, now_ns: int) -> Track:
    """Return the track with the time of the first doubt whether the reported source is at rest."""
    return track if track.doubted_ns or track.at_rest >= _CLEAR else replace(track, doubted_ns=now_ns)


def looks(track: Track, step: GridStep) -> bool:
    """Return whether the source may move and the time of its verification is not over."""
    return not track.at_rest >= _CLEAR and step.start_ns - track.doubted_ns < _LOOK_NS
