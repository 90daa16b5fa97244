"""Comparison of another drone's poses with its published plans, both in its own local frame, which need not be known for that."""

from __future__ import annotations

from math import hypot

from radron.agent.config.drone import ResponseConfig
from radron.agent.motion.feedforward import Deviation
from radron.agent.motion.separation import PeerPlan, margin_m
from radron.agent.navigation.peers.newest import OLDEST_NS, Peer
from radron.protocol.messages import Plan, Pose
from radron.protocol.stages import DESCENDING

_PLAN_AGE_NS = 1_000_000_000  # an older plan is stale
_EXPECTED_M = ResponseConfig().tracking_error_m  # RMS deviation of a drone from its plans before any is measured


class Following:
    """Deviations of the other drones from their plans: which drones follow their plans, and how well."""

    def __init__(self) -> None:
        self._deviations: dict[str, Deviation] = {}
        self._departed: set[str] = set()  # drones whose poses deviate from their plans beyond the margin
        self._doubted: set[str] = set()  # of these, drones steered by their agents: either their poses or their plans are false

    def compare(self, name: str, peer: Peer, pose: Pose) -> None:
        """Compare a drone's newest pose with its plan.

        A deviation beyond the margin of plans means that it does not follow the plan; it does not count in the RMS deviation.
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
        """Return the RMS deviation (m) of a drone from its plans; ``compare`` must have been called for it."""
        return self._deviations[name].rms_m

    def plan(self, name: str, peer: Peer, pose: Pose, now_ns: int, oldest_ns: int = _PLAN_AGE_NS) -> Plan | None:
        """Return a drone's plan if it follows it: steered by its agent, not older than ``oldest_ns``, and in agreement with its
        poses. Else None.
        """
        return None if self._contradicts(name, peer, now_ns) else _recent(peer, pose, now_ns, oldest_ns)

    def contradicted(self, name: str, peer: Peer, pose: Pose, now_ns: int) -> Plan | None:
        """Return the recent plan of a drone that reports to be steered by its agent, if its poses contradict the plan; else None.
        Its poses may be false, and then it is where its plan says.

        Once it is no longer steered, such a plan still counts for two seconds, and during a landing until it is down: with false
        poses it lands at the end of that plan.
        """
        plan = peer.plan
        if not pose.steered and name in self._doubted:
            return plan if plan is not None and plan.epoch == pose.epoch else None
        return _recent(peer, pose, now_ns, _PLAN_AGE_NS) if self._contradicts(name, peer, now_ns) else None

    def is_blind(self, name: str, peer: Peer, pose: Pose, now_ns: int) -> bool:
        """Whether a drone has published plans, but does not follow one now. Then it is assumed to give no way."""
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
