"""Conditions on the commands to the autopilots and on the agents' messages: fresh, finite, and limited in number."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

import numpy as np

from radron.sim.scoring.invariants.base import Breach, Invariant, Setting
from radron.sim.scoring.moment import Moment

MAX_SETPOINT_AGE_S = 1.3  # PX4 leaves offboard after COM_OF_LOSS_T = 1 s, and needs a little to do so
MAX_SENT_MESSAGES = 200  # messages of one agent in one tick; a busy agent sends five
MAX_WAITING_FOR_AGENT = 20_000  # messages on their way to one agent: of a flood for a second or two


class FreshSetpoint(Invariant[Moment]):
    """Requires that no vehicle obeys a setpoint older than 1.3 s.

    With an older setpoint its agent is late, without a link, or dead, and nobody steers the vehicle.
    """

    name = "setpoint-age"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the vehicles that follow a setpoint that is too old."""
        for drone, autopilot in enumerate(moment.autopilots):
            age_s = autopilot.setpoint_age_s
            if age_s is not None and age_s > MAX_SETPOINT_AGE_S:
                yield Breach((drone,), f"obeys a setpoint of {age_s:.2f} s ago")


class Finite(Invariant[Moment]):
    """Requires that every number in commands, source estimates and true states is finite.

    A non-finite number spreads to all results computed from it. The numbers in messages are checked by the codec, and the agent
    counts refused messages.
    """

    name = "finite"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._seen: list[object] = [None] * len(setting.names)

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones with a number that is not finite."""
        total = float(moment.position_m.sum() + moment.velocity_mps.sum())
        if not isfinite(total):
            bad = np.flatnonzero(~np.isfinite(moment.position_m + moment.velocity_mps).all(axis=1))
            yield Breach(tuple(bad.tolist()), "true position or velocity")
        for drone, (command, pilot) in enumerate(zip(moment.commands, moment.pilots, strict=True)):
            if command is not None and (setpoint := command.setpoint) is not None:
                numbers = (*setpoint.position_m, *setpoint.velocity_mps, *setpoint.acceleration_mps2)
                if not isfinite(sum(numbers) + setpoint.yaw_rad + setpoint.yaw_rate_rps):
                    yield Breach((drone,), f"setpoint {setpoint}")
            if pilot is not None and any(kind.startswith("unsendable") for kind in pilot.counters):
                yield Breach((drone,), "a message that the codec refuses")
            hypothesis = pilot.hypothesis if pilot is not None else None
            if hypothesis is not None and hypothesis is not self._seen[drone]:
                if isfinite(float(hypothesis.position.sum() + hypothesis.covariance.sum() + hypothesis.velocity.sum())):
                    self._seen[drone] = hypothesis
                else:
                    yield Breach((drone,), f"hypothesis at {hypothesis.position.tolist()}")


class Queues(Invariant[Moment]):
    """Requires that no queue grows without bound.

    Judged are the number of an agent's publications in one step, and of messages on their way to an agent.
    """

    name = "queues"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that send, or have waiting for them, too many messages."""
        for drone, (sent, waiting) in enumerate(zip(moment.sent, moment.inboxes, strict=True)):
            if sent > MAX_SENT_MESSAGES:
                yield Breach((drone,), f"{sent} messages sent in one step, {MAX_SENT_MESSAGES} at most wanted")
            if waiting > MAX_WAITING_FOR_AGENT:
                yield Breach((drone,), f"{waiting} messages on their way, {MAX_WAITING_FOR_AGENT} at most wanted")
