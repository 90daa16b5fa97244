"""Agreement of another drone's poses with its plans; both are in its own frame, known or not."""

from __future__ import annotations

from math import hypot

from radron.agent.config.drone import ResponseConfig
from radron.agent.motion.feedforward import Deviation
from radron.agent.motion.separation import PeerPlan, margin_m
from radron.agent.navigation.peers.newest import OLDEST_NS, Peer
from radron.protocol.messages import Plan, Pose
from radron.protocol.stages import DESCENDING

_PLAN_AGE_NS = 1_000_000_000  # an older plan is stale
_EXPECTED_M = ResponseConfig().tracking_error_m  # prior of a drone's deviation from its plans


class Following:
    """Record of the other drones' deviations from their plans so far."""

    def __init__(self) -> None:
        self._deviations: dict[str, Deviation] = {}
        self._departed: set[str] = set()  # drones with poses off their plans
        self._doubted: set[str] = set()  # of these, drones steered by their agents: their poses are false, or their plans

    def compare(self, name: str, peer: Peer, pose: Pose) -> None:
        """Compare a drone's pose with its plan.

        Deviations beyond the margin of plans are left out of the RMS deviation.
        """
        deviation = self._deviations.setdefault(name, Deviation(_EXPECTED_M))
        plan = peer.plan
        if plan is None or (pose.stamp_ns - plan.stamp_ns > OLDEST_NS and not _comes_down(peer)):
            self._doubted.discard(name)  # no plan gives its position any more
        if plan is None or plan.epoch != pose.epoch or not 0 <= pose.stamp_ns - plan.stamp_ns + _PLAN_AGE_NS <= 2 * _PLAN_AGE_NS:
            return
        x, y, _ = PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, plan.positions_m).state(pose.stamp_ns).position
        dx, dy = pose.position_m[0] - x, pose.position_m[1] - y
        if hypot(dx, dy) > margin_m(0.0, deviation.rms_m):
            self._departed.add(name)
            if pose.steered:
                self._doubted.add(name)
        else:
            self._departed.discard(name)
            self._doubted.discard(name)
            deviation.add(pose.stamp_ns, dx, dy)

    def deviation_m(self, name: str) -> float:
        """Return the RMS deviation of a compared drone from its plans."""
        return self._deviations[name].rms_m

    def plan(self, name: str, peer: Peer, pose: Pose, now_ns: int, oldest_ns: int = _PLAN_AGE_NS) -> Plan | None:
        """Return the plan in agreement with a drone's poses; None without a recent one."""
        return None if self._contradicts(name, peer, now_ns) else _recent(peer, pose, now_ns, oldest_ns)

    def contradicted(self, name: str, peer: Peer, pose: Pose, now_ns: int) -> Plan | None:
        """Return the recent plan of a drone that is steered, by its own report, and that its poses contradict; None without one.

        Once it is steered no more: its last plan for two seconds, and until it is down if it lands. If its poses are false, it
        stands at the end of that plan. Its status, a second later at most, reports the landing.
        """
        plan = peer.plan
        if not pose.steered and name in self._doubted:
            return plan if plan is not None and plan.epoch == pose.epoch else None
        return _recent(peer, pose, now_ns, _PLAN_AGE_NS) if self._contradicts(name, peer, now_ns) else None

    def is_blind(self, name: str, peer: Peer, pose: Pose, now_ns: int) -> bool:
        """Whether a drone has published plans, and follows none now: its agent does not steer it."""
        return peer.plan is not None and self.plan(name, peer, pose, now_ns) is None

    def _contradicts(self, name: str, peer: Peer, now_ns: int) -> bool:
        return name in self._departed or peer.sources.are_two(now_ns)


def _recent(peer: Peer, pose: Pose, now_ns: int, oldest_ns: int) -> Plan | None:
    plan = peer.plan
    if not pose.steered or plan is None or plan.epoch != pose.epoch or now_ns - plan.stamp_ns > oldest_ns:
        return None
    return plan


def _comes_down(peer: Peer) -> bool:
    return peer.stage in DESCENDING  # an old plan still gives its position, without newer ones
