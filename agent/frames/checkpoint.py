"""What is remembered from keyframe to keyframe: the joint estimate, each drone's standing, and what was told of its frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agent.frames.consistency import Tally
from agent.frames.joint import Joint
from agent.frames.placement import Placement

Emission = tuple[int, int, Placement | None]  # drone, from which stamp on, where its continuous frame lies


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Why a drone's frame is not believed, the stamp of the last keyframe that said so, whether it stays so anyway, and whether
    it may as well be another drone's that is wrong."""

    reason: str
    stamp_ns: int
    lasting: bool = False
    ambiguous: bool = False


@dataclass(frozen=True, slots=True)
class Member:
    """What is remembered of one drone from keyframe to keyframe."""

    launched: bool = False  # its layout has been used, or may not be any more
    sound_ns: int = -1  # stamp of the last keyframe at which sightings confirmed its frame, and none contradicted it
    since: int = -1  # keyframe from which on its sightings tell of its present frame
    contradicted: int = 0  # keyframes in a row
    missed: int = 0  # fixes in a row that did not fit
    lost_ns: int | None = None  # from which stamp on its frame is lost; none: it is not
    attempted: int = -1  # keyframe of the last attempt to find its frame
    trusted: bool = True  # its layout and compass count
    suspicion: Suspicion | None = None
    known: bool = False


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The estimate after a keyframe; everything that the next one needs."""

    index: int
    joint: Joint
    members: tuple[Member, ...]
    tallies: tuple[Tally, ...]
    emissions: tuple[Emission, ...] = ()


def beginning(count: int) -> Checkpoint:
    """Before the first keyframe of a mission of ``count`` drones."""
    nobody = Joint(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 0)), np.zeros((count, 3)), np.zeros(count))
    return Checkpoint(-1, nobody, (Member(),) * count, ())
