"""Without room for both, the margin for an uncertain position gives way before the fence does."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from radron.agent.config.mission import LimitsConfig
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan
from radron.agent.motion.tracker import Tracker

STEP_NS = 200_000_000
LIMITS = LimitsConfig()
THERE = (-8.0, 0.0, 3.0)


def silent(now_ns: int, sigma_m: float) -> PeerPlan:
    return PeerPlan("a", now_ns, 0.2, [THERE] * 21, sigma_m, blind=True)


def beyond_a_line(now_ns: int, sigma_m: float) -> PeerPlan:
    return PeerPlan("a", now_ns, 0.2, [THERE] * 21, sigma_m, blind=True, away=np.tile((-1.0, 0.0), (21, 1)))


def heard(now_ns: int, sigma_m: float) -> PeerPlan:
    return PeerPlan.from_pose("c", now_ns, PeerState(THERE), sigma_m)


@pytest.mark.parametrize("other", [silent, beyond_a_line, heard])
def test_the_doubt_about_another_pushes_nobody_through_the_fence(other) -> None:
    """14 m or more are wanted of it, and 10.5 m are left; the fence gave up to 4 m of the 1.5 m that plans keep from it."""
    fence = Fence(shapely.box(-20.0, -200.0, 200.0, 200.0), 1.5, 60.0)
    tracker, state, clear_m = Tracker(LIMITS, fence, drone_id="b"), PeerState((-14.0, 0.0, 3.0)), []
    place = Reference(np.tile((-14.0, 0.0, 3.0), (31, 1)), np.zeros((31, 3)), 0.2)
    for step in range(60):
        now_ns = step * STEP_NS
        tracker.plan(now_ns, state, place, [other(now_ns, 5.0)])
        state = tracker.state(now_ns + STEP_NS)
        clear_m.append(fence.clearance(*state.position[:2]))
    assert min(clear_m) > 1.2
    assert np.hypot(state.position[0] - THERE[0], state.position[1] - THERE[1]) > 10.0  # as far as there is room
