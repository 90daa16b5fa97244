"""Two drones that meet by their plans alone, with late messages: vehicles fly exactly along their plans, without errors.

Both fly 6.5 m/s towards places near each other's start, and plan every 0.2 s at different phases. ``turns``: share of the
plans at which the reference jumps to a random place near the middle.
"""

from __future__ import annotations

from math import cos, dist, pi, sin

import numpy as np
import shapely

from radron.agent.config.mission import LimitsConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.geometry import Array
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan
from radron.agent.motion.tracker import Tracker, TrackerPlan
from radron.agent.navigation.moment import HORIZON, STEP_S
from radron.agent.navigation.navigator import REPLAN_NS

LIMITS, SPEED_MPS = LimitsConfig(), SurveyConfig().search_speed_mps
WIDE = Fence(shapely.box(-500.0, -500.0, 500.0, 500.0), 1.5, 60.0)
POSE_NS, PLANS, LOOKS = 100_000_000, 35, 5
NAMES = ("d1", "d2")


def towards(place: tuple[float, ...], goal: Array) -> Reference:
    """Straight to a goal, and a stop there."""
    here = np.array(place)
    way = goal - here[:2]
    far_m = max(float(np.hypot(*way)), 1e-9)
    along = np.minimum(SPEED_MPS * STEP_S * np.arange(HORIZON + 2.0), far_m)
    points = np.column_stack((here[:2] + np.outer(along / far_m, way), np.full(len(along), here[2])))
    return Reference(points[:-1], np.diff(points, axis=0) / STEP_S, STEP_S)


def told(name: str, sent: list[TrackerPlan], now_ns: int, delay_ns: int) -> list[PeerPlan]:
    """The newest plan that has arrived, with the newest pose that has; nothing before the first plan."""
    arrived = [one for one in sent if one.stamp_ns <= now_ns - delay_ns]
    if not arrived:
        return []
    one = arrived[-1]
    plan = PeerPlan(name, one.stamp_ns, one.step_s, [(x, y, z) for x, y, z in one.positions.tolist()])
    stamp_ns = max(one.stamp_ns, (now_ns - delay_ns) // POSE_NS * POSE_NS)
    at = plan.state(stamp_ns)
    return [
        PeerPlan(
            name, plan.stamp_ns, plan.step_s, plan.positions, 0.0, PeerState(at.position, at.velocity, (now_ns - stamp_ns) * 1e-9)
        )
    ]


def least_m(seed: int, delay_s: float, turns: float = 0.0) -> float:
    """Return the least horizontal distance in one encounter, m. ``delay_s``: of all messages."""
    rng, delay_ns = np.random.default_rng(seed), round(delay_s * 1e9)
    bearing, far_m = rng.uniform(0.0, 2.0 * pi), rng.uniform(12.0, 25.0)
    first = far_m * np.array([cos(bearing), sin(bearing)])
    places = [(*first, 3.0), (*(rng.normal(0.0, 2.0, 2) - first), 3.0)]
    goals = [rng.normal(0.0, 2.0, 2) - np.array(place[:2]) for place in places]
    trackers = [Tracker(LIMITS, WIDE, drone_id=name) for name in NAMES]
    sent: tuple[list[TrackerPlan], list[TrackerPlan]] = [], []
    phases, least = (0, int(rng.integers(0, REPLAN_NS))), np.inf
    for now_ns, me in sorted((phase + count * REPLAN_NS, me) for count in range(PLANS) for me, phase in enumerate(phases)):
        mine, peer = trackers[me], trackers[1 - me]
        state = mine.state(now_ns) if mine.has_plan else PeerState(places[me])
        if rng.random() < turns:
            goals[me] = rng.uniform(-20.0, 20.0, 2)
        peers = told(NAMES[1 - me], sent[1 - me], now_ns, delay_ns)
        sent[me].append(mine.plan(now_ns, state, towards(state.position, goals[me]), peers))
        for look in range(LOOKS if peer.has_plan else 0):
            at_ns = now_ns + look * REPLAN_NS // (2 * LOOKS)
            least = min(least, dist(mine.state(at_ns).position[:2], peer.state(at_ns).position[:2]))
    return least
