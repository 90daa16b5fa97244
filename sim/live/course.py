"""Course of a live mission, from the start of the agents to landed agents with equal logs."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from radron.protocol.messages import Action, Stage
from radron.protocol.stages import ON_GROUND
from radron.sim.live.faults.player import FaultPlayer
from radron.sim.live.operator import Operator
from radron.sim.live.report import LiveReport, ends_of
from radron.sim.live.worldlink import Order, Truth
from radron.sim.live.worldprocess import LiveError
from radron.sim.result import Flight
from radron.sim.scenario import Scenario
from radron.sim.scoring.recorder import MAX_START_S, Recorder
from radron.sim.world.frame import LocalFrames

TRUTH_S = 0.05  # interval of truths
LANDING_S = 120.0
READY_AGAIN_S = 5.0  # time until a vehicle that was just disarmed can be armed again, and its agent knows
SETTLE_S = 15.0  # time for the agents' logs to become equal after the cameras are off


class Course:
    """Conducts one mission of a live swarm whose processes have been started."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        operator: Operator,
        faults: FaultPlayer | None = None,
        watch: Callable[[float, Truth], bool] | None = None,
    ) -> None:
        """``scenario``: with the mission that the agents have. ``watch``: called with each state of the true world during the
        mission, and the time (s) since the start command; True ends the mission.
        """
        mission = scenario.mission
        self._seed = seed
        self._operator = operator
        self._faults = faults
        self._watch = watch
        self._world = operator.world
        frames = LocalFrames([(drone.origin_m, drone.yaw_deg) for drone in mission.drones])
        self._recorder = Recorder(scenario, operator.observer.agents, frames, TRUTH_S)
        self._went_s: float | None = None  # the world's time at the start of the mission
        self._begun = self._over = False
        self._started_drones: set[str] = set()
        self._late_s, self._dropped = 0.0, 0

    async def fly(self, patience_s: float) -> tuple[Flight, LiveReport]:
        """Fly the whole mission, and return its scores and a report. At the end the cameras are off.

        ``patience_s``: time that the agents have to get ready, seconds.

        Raises:
            LiveError: the agents do not get ready, none takes off, or the world fails.
        """
        operator = self._operator
        began_s = time.monotonic()
        late = frozenset() if self._faults is None else self._faults.late
        await operator.get_ready(patience_s, late)
        ready_s = time.monotonic() - began_s
        operator.view.say(f"all agents are ready after {ready_s:.1f} s: start")
        flight = await self.mission_flown()
        await operator.until(lambda: not operator.observer.has_problems(), READY_AGAIN_S)
        self._world.order(Order.CAMERAS_OFF)
        operator.view.say("waiting until the agents' logs are equal")
        agreed = await operator.until(operator.observer.agreed, SETTLE_S)
        return flight, LiveReport(
            agreed=agreed,
            ready_s=ready_s,
            world_late_s=self._late_s,
            truths_dropped=self._dropped,
            mesh=operator.mesh_counters,
            faults=() if self._faults is None else tuple(self._faults.played),
            agents=ends_of(operator.observer.agents, self._world.truth.vehicles),
        )

    async def mission_flown(self) -> Flight:
        """Fly from the start command to the landing, by the scenario's rules; the agents must be ready.

        Raises:
            LiveError: no drone takes off, or the world fails.
        """
        operator = self._operator
        operator.watchers.append(self._see)
        operator.observer.listeners.append(self._recorder.take)
        self._world.order(Order.GO)
        began_s = time.monotonic()
        self._went_s = self._world.truth.time_s
        try:
            await operator.command(Action.START, self._started, None, self._unstarted)
            await operator.until(lambda: self._over, None)
        finally:
            operator.watchers.remove(self._see)
            operator.observer.listeners.remove(self._recorder.take)
        result = self._recorder.result(self._seed, time.monotonic() - began_s)
        try:
            flight = Flight(result, self._recorder.trace(), {})
        except ValueError:
            raise LiveError(f"no drone took off: {'; '.join(operator.observer.obstacles())}") from None
        if not operator.landed:
            operator.view.say("the run is over: the drones land")
            await operator.command(Action.LAND, lambda: operator.landed, LANDING_S)
        return flight

    def _see(self, truth: Truth) -> None:
        """Pass a truth to the recorder and the view."""
        time_s = 0.0
        if self._went_s is not None:
            time_s = truth.time_s - self._went_s
            self._late_s, self._dropped = max(self._late_s, truth.late_s), self._dropped + truth.dropped
            if self._faults is not None:
                self._faults.step(time_s, truth)
            self._started_drones |= {agent.drone for agent in self._operator.observer.agents if agent.stage not in ON_GROUND}
            # Agents on the ground since an earlier mission have not ended this one.
            self._begun = self._begun or not self._all_landed() or time_s > MAX_START_S
            if self._begun and not self._over:
                position, velocity = np.array(truth.position_m), np.array(truth.velocity_mps)
                self._over = self._recorder.sample(time_s, position, velocity, truth.sources)
                if self._watch is not None:
                    self._over = self._watch(time_s, truth) or self._over
        self._operator.view.show(time_s, truth, self._operator.observer.agents)

    def _all_landed(self) -> bool:
        return all(agent.stage is Stage.LANDED for agent in self._operator.observer.agents)

    def _started(self) -> bool:
        return self._over or not self._unstarted()

    def _unstarted(self) -> tuple[str, ...]:
        """Return the drones that have not flown yet. A drone down again after a short flight must not be started once more."""
        return tuple(agent.drone for agent in self._operator.observer.agents if agent.drone not in self._started_drones)
