"""Trajectory tracker by model predictive control: from a reference that may jump to a plan that the vehicle can fly (after Baca
et al. 2018).

The tracker moves a virtual vehicle, a triple integrator without measurement noise, and the real vehicle follows it. Each new plan
optimises the next seconds of the virtual vehicle's motion, so that it follows the reference within the limits. Mostly no limit is
active, and the solution is a matrix product (``prediction``); otherwise OSQP solves the constrained problem (``qp``). If that
fails, or vehicles come too near to each other, the plan is to brake or evade (``steering``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import dist, hypot

import numpy as np
from msgspec import Struct

from radron.agent.config.drone import ResponseConfig
from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.climbing import Climbing
from radron.agent.motion.feedforward import feedforward
from radron.agent.motion.fence import Fence
from radron.agent.motion.goals import Goals
from radron.agent.motion.prediction import predict
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan, sampled
from radron.agent.motion.steering import Situation, Status, Steering

_DEPARTED_M = 5.0  # a vehicle farther than this from the virtual one does not follow it: the next plan begins at its position

__all__ = ["Relief", "Status", "Tracker", "TrackerPlan"]


Relief = Callable[[Array], Array]


class TrackerPlan(Struct, frozen=True):
    """Planned path of a drone for the next seconds, which the vehicle can fly, in H steps.

    positions, velocities, accelerations: (H + 1, 3), at stamp_ns, stamp_ns + step_s, ... status: how the plan was found.
    """

    stamp_ns: int
    step_s: float
    positions: Array
    velocities: Array
    accelerations: Array
    status: Status


class Tracker:
    """Planner of one drone: it makes a path that the vehicle can fly from a wanted path that may jump.

    ``plan`` is called a few times a second; ``sample`` gives setpoints in between, at any rate.
    """

    def __init__(
        self,
        limits: LimitsConfig,
        fence: Fence,
        step_s: float = 0.2,
        horizon: int = 20,
        *,
        response: ResponseConfig | None = None,
        drone_id: str = "",
    ) -> None:
        """Set up the planner.

        ``step_s``, ``horizon``: length and number of the planned steps; ``response``: the vehicle's response to setpoints, until
        ``follow_by`` changes it; ``drone_id``: the own id, which decides the right of way.
        """
        self._step_s, self._horizon = step_s, horizon
        self._response = response or ResponseConfig()
        self._limits = limits
        self._prediction = predict(horizon, step_s)
        self._goals = Goals(limits, fence, step_s, horizon)
        self._steering = Steering(limits, self._prediction, step_s, horizon, drone_id)
        self._climbing = Climbing(limits, fence, self._prediction, step_s, horizon)
        self._times: Array = step_s * np.arange(1, horizon + 1, dtype=np.float64)
        self._plan: TrackerPlan | None = None
        self._start: tuple[Vector3, Vector3] | None = None
        self._guess: Array = np.zeros((horizon, 3))
        self._states: Array = np.zeros((3, horizon + 1, 3))  # position, velocity and acceleration at each step
        self._jerk: Array = np.zeros((horizon, 3))  # constant over the step that begins there

    def reset(self, position: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """Let the next plan begin at this position (m) and velocity (m/s): after a change of mode or a jump of the frame."""
        self._plan = None
        self._start = (position, velocity)

    def follow_by(self, response: ResponseConfig) -> None:
        """Set the vehicle's response to setpoints (drag and lags), which the setpoints allow for from now on."""
        self._response = response

    def confine(self, fence: Fence) -> None:
        """Replace the fence from the next plan on: the estimated position of the area, or the height of the ground, in the
        planning frame has changed.
        """
        self._goals = Goals(self._limits, fence, self._step_s, self._horizon)
        self._climbing.confine(fence)

    def plan(
        self,
        now_ns: int,
        state: PeerState,
        reference: Reference,
        peers: Sequence[PeerPlan] = (),
        ground: Relief | None = None,
    ) -> TrackerPlan:
        """Compute a new plan for the next seconds.

        Args:
            now_ns: own time; the reference begins now.
            state: the vehicle's measured position and velocity.
            reference: wanted path; the vehicle need not be able to fly it.
            peers: the other drones, as obstacles.
            ground: returns the heights (N,) of the ground at positions (N, 2); then the z of the reference, and floor and ceiling
                of the fence, are above the ground along the plan. None: level ground.
        """
        start = self._continued(now_ns, state)
        horizon, (x, y, z) = self._horizon, start[0].tolist()
        below = None if ground is None else float(ground(start[:1, :2])[0])
        wanted = self._goals.of(reference, start, z if below is None else z - below)
        optimum = (self._prediction.optimum @ wanted).reshape(4, horizon, 3)
        peaks = np.abs(optimum).max(axis=1).tolist()
        optimum[1] += start[0]
        situation = Situation(
            now_ns,
            start,
            state,
            self._response,
            previous=partial(self._previous, now_ns, start),
            inside=partial(self._goals.inside, x, y),
            surely_inside=self._goals.surely_inside(x, y, hypot(peaks[1][0], peaks[1][1])),
            guess=self._guess,
        )
        status, flat = self._steering.jerk(situation, optimum, peaks, peers)
        under = None
        if ground is not None and below is not None:
            ahead = optimum[1, :, :2] + self._prediction.position @ (flat - optimum[0, :, :2])
            under = ground(ahead)
            self._lift(optimum[:, :, 2], wanted[:, 2], under - below, z)
            peaks = np.abs(optimum).max(axis=1).tolist()
        upright_status, upright = self._climbing.jerk(start[:, 2:], optimum[:, :, 2:], peaks, self._guess[:, 2:], under)
        if status is Status.FREE and upright_status is Status.FREE:
            return self._adopt(now_ns, start, optimum[1:], optimum[0], status)
        jerk = np.column_stack((flat, upright))
        states = (self._prediction.forced @ jerk + self._prediction.free @ start[1:]).reshape(3, horizon, 3)
        states[0] += start[0]
        return self._adopt(now_ns, start, states, jerk, upright_status if status is Status.FREE else status)

    def state(self, now_ns: int) -> PeerState:
        """Return the position and velocity of the plan now, at which the vehicle should be."""
        position, velocity, _, _ = self._at((now_ns - self._stamp_ns) * 1e-9)
        return PeerState(position, velocity)

    def ahead(self, now_ns: int, here: Vector3) -> Array:
        """Return the positions (H + 1, 3) of the present plan from now on; without a plan, all are ``here``."""
        if self._plan is None:
            return np.repeat(np.array(here)[None], self._horizon + 1, axis=0)
        age_s, times = (now_ns - self._plan.stamp_ns) * 1e-9, np.concatenate(((0.0,), self._times))
        flat, planned = sampled(self._plan.positions, age_s, self._step_s, times), self._plan.positions[:, 2]
        climbs = np.interp(age_s + times, self._step_s * np.arange(len(planned)), planned)
        return np.column_stack((flat, here[2] + climbs - climbs[0]))

    def sample(self, now_ns: int, yaw_rate_rps: float = 0.0) -> tuple[Vector3, Vector3, Vector3]:
        """Return the setpoint for the autopilot now: position, velocity and acceleration. It is that of the plan a little later,
        by the vehicle's lag.

        The acceleration is that with which the vehicle flies the plan (``radron.agent.motion.feedforward``). ``yaw_rate_rps``:
        the yaw rate commanded at the same time.
        """
        response = self._response
        position, velocity, acceleration, jerk = self._at((now_ns - self._stamp_ns) * 1e-9 + response.lag_s)
        return position, velocity, feedforward(response, velocity, acceleration, jerk, yaw_rate_rps)

    @property
    def has_plan(self) -> bool:
        """Whether there is a plan; ``sample`` and ``state`` need one."""
        return self._plan is not None

    @property
    def _stamp_ns(self) -> int:
        if self._plan is None:
            raise RuntimeError("the tracker has no plan yet: call plan() first")
        return self._plan.stamp_ns

    def _at(self, time_s: float) -> tuple[Vector3, Vector3, Vector3, tuple[float, float]]:
        """Return position, velocity, acceleration and horizontal jerk of the virtual vehicle at a time after the plan's stamp;
        from the plan's end on it stands.
        """
        index = max(int(time_s / self._step_s), 0)
        if index >= self._horizon:
            x, y, z = self._states[0, -1].tolist()
            return (x, y, z), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0)
        (px, py, pz), (vx, vy, vz), (ax, ay, az) = self._states[:, index].tolist()
        jx, jy, jz = self._jerk[index].tolist()
        t = time_s - index * self._step_s
        h, s = 0.5 * t, t / 3.0
        return (
            (px + t * (vx + h * (ax + s * jx)), py + t * (vy + h * (ay + s * jy)), pz + t * (vz + h * (az + s * jz))),
            (vx + t * (ax + h * jx), vy + t * (ay + h * jy), vz + t * (az + h * jz)),
            (ax + t * jx, ay + t * jy, az + t * jz),
            (jx, jy),
        )

    def _continued(self, now_ns: int, state: PeerState) -> Array:
        """Return the state (3, 3) at which the new plan begins: that of the virtual vehicle, unless the real one is too far from
        it.
        """
        if self._plan is not None:
            position, velocity, acceleration, _ = self._at((now_ns - self._plan.stamp_ns) * 1e-9)
            if dist(position, state.position) <= _DEPARTED_M:
                return np.array((position, velocity, acceleration))
            self._plan = None
        position, velocity = self._start or (state.position, state.velocity)
        self._start = None
        return np.array([position, velocity, (0.0, 0.0, 0.0)])

    def _lift(self, optimum: Array, wanted: Array, rise: Array, z: float) -> None:
        """Recompute the vertical part (4, H) of the unconstrained optimum, in place, for ground that rises by ``rise`` (H,) along
        the plan. ``wanted``: vertical goals; ``z``: height of the plan's start.
        """
        goals, horizon = wanted.copy(), self._horizon
        goals[2 : 2 + horizon] += rise
        goals[2 + horizon :] += np.gradient(np.concatenate(((0.0,), rise)), self._step_s)[1:]
        optimum[:] = (self._prediction.optimum @ goals).reshape(4, horizon)
        optimum[1] += z

    def _previous(self, now_ns: int, start: Array) -> Array:
        """Return the positions (H, 2) of the previous plan at the steps; without one, all are the start."""
        if self._plan is None:
            return np.repeat(start[None, 0, :2], self._horizon, axis=0)
        return sampled(self._plan.positions, (now_ns - self._plan.stamp_ns) * 1e-9, self._step_s, self._times)

    def _adopt(self, now_ns: int, start: Array, states: Array, jerk: Array, status: Status) -> TrackerPlan:
        self._states = np.concatenate((start[:, None], states), axis=1)
        self._jerk = jerk
        self._guess[:-1] = jerk[1:]
        positions, velocities, accelerations = self._states
        self._plan = TrackerPlan(now_ns, self._step_s, positions, velocities, accelerations, status)
        return self._plan
