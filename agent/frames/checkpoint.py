"""The state carried from keyframe to keyframe: the joint estimate, each drone's status, and the published frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radron.agent.frames.consistency import Tally
from radron.agent.frames.joint import Joint
from radron.agent.frames.placement import Placement

Emission = tuple[int, int, Placement | None]  # drone, first stamp, placement of its continuous frame


@dataclass(frozen=True, slots=True)
class Suspicion:
    """The reason why a drone's frame is not trusted.

    ``stamp_ns``: last keyframe (time of an estimate) with that finding. ``lasting``: the suspicion is never cleared.
    ``ambiguous``:
    the other drone of the pair that contradicts each other may be faulty instead.
    """

    reason: str
    stamp_ns: int
    lasting: bool = False
    ambiguous: bool = False


@dataclass(frozen=True, slots=True)
class Member:
    """The state of one drone's frame estimate between two keyframes (times of an estimate)."""

    launched: bool = False  # its layout has been used, or must not be used any more
    sound_ns: int = -1  # stamp of the last keyframe at which sightings confirmed its frame and none contradicted it
    since: int = -1  # first keyframe with sightings in its present frame
    contradicted: int = 0  # consecutive keyframes
    missed: int = 0  # consecutive fixes less likely right than by the prior
    lost_ns: int | None = None  # stamp since which its frame is unknown; None while it is known
    attempted: int = -1  # keyframe of the last attempt to align its frame
    trusted: bool = True  # whether its layout and compass are used
    suspicion: Suspicion | None = None
    known: bool = False
    moved_m: tuple[float, float] = (0.0, 0.0)  # by which corrections have moved its track lately (``slides``)
    moved_var: float = 0.0  # m^2 of each axis, by which it may have drifted meanwhile
    slid_ns: int | None = None  # stamp of the last keyframe at which its track slid; None: it does not


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The complete state of the frame estimate after a keyframe, from which the next one is computed."""

    index: int
    joint: Joint
    members: tuple[Member, ...]
    tallies: tuple[Tally, ...]
    emissions: tuple[Emission, ...] = ()


def beginning(count: int) -> Checkpoint:
    """Return the state of the frame estimate before the first keyframe, for a mission of ``count`` drones."""
    nobody = Joint(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 0)), np.zeros((count, 3)), np.zeros(count))
    return Checkpoint(-1, nobody, (Member(),) * count, ())
