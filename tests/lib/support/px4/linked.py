"""One pilot, its driver and an emulated PX4 without a link between them: in simulated time, as fast as it can be, and the same
again with the same seed. The packets across the link are MAVLink's bytes, and MAVSDK's JSON of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from math import nan
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from radron.agent.config.drone import DroneConfig, VehicleConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.pilot import Pilot
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import VehicleState
from radron.agent.vehicle.mavlink.link import Received
from radron.agent.vehicle.mavlink.messages import DECODERS, ExtendedState, Heartbeat
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.protocol.codec import decode_from
from radron.protocol.messages import Action, Stage, Status
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Faults, Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.vehicle.px4.release import ReleaseName
from radron.sim.world.localization import Localization, LocalizationTruth
from support.flights.one_pilot import MISSION, boot_of, command, nonce_key_of
from support.px4.mavsdk_json import fields_of

STEP_S = 0.01
TICK_STEPS, LOOK_STEPS = 5, 50  # of the pilot, and of its input from the shell
UTC_NS = 1_800_000_000_000_000_000
CEILING_M = 60.0
PARAMETERS = {
    "COM_OBL_RC_ACT": 3,
    "GF_ACTION": 3,
    "GF_MAX_HOR_DIST": 300.0,
    "RTL_RETURN_ALT": 20.0,
    "RTL_DESCEND_ALT": 10.0,
    "MPC_Z_V_AUTO_UP": 3.0,
    "EKF2_NOAID_TOUT": 2_000_000,
}
_COMPANION = (1, 195)  # system and component of an agent


class BytesLink:
    """Stand-in for a link: packs the driver's messages and hands them on."""

    def __init__(self, deliver: Callable[[bytes], None]) -> None:
        self.counters: Counter[str] = Counter()
        self.is_signed: bool | None = None
        self.taken_from: str | None = None
        self._deliver = deliver
        self._mavlink = mavlink.MAVLink(None, *_COMPANION)

    def send(self, name: str, fields: dict[str, Any]) -> None:
        kind = getattr(mavlink, f"MAVLink_{name.lower()}_message")
        filled = {"target_system": 1, "target_component": 1} | fields
        values = [_packed(filled.get(field, 0)) for field in kind.fieldnames]
        self._deliver(kind(*values).pack(self._mavlink))

    def send_command(self, number: int, *parameters: float | None) -> None:
        given = {f"param{place}": value for place, value in enumerate(parameters, start=1)}
        self.send("COMMAND_LONG", {f"param{place}": None for place in range(1, 8)} | given | {"command": number})

    def close(self) -> None:
        """There is nothing to close."""


def _packed(value: Any) -> Any:
    if isinstance(value, str):
        return value.encode()
    return nan if value is None else value


class Solo:
    """``pilot``, ``vehicle``: under test. ``states``: all telemetry; ``stages``: when which began, s; ``asked``: packets sent
    to the vehicle (s, name, packet)."""

    def __init__(
        self,
        seed: int,
        mission: MissionConfig = MISSION,
        parameters: dict[str, float] | None = None,
        faults: Faults = Faults(),  # noqa: B008 - frozen
        localization: LocalizationTruth = LocalizationTruth(),  # noqa: B008 - frozen
        release: ReleaseName = "1.17",
    ) -> None:
        rng = np.random.default_rng(seed)
        self.motion = Multirotors(MultirotorTruth(), np.zeros((1, 3)), np.zeros(1), STEP_S, rng)
        error = Localization(localization, 1, STEP_S, rng)
        config = Px4Config(onboard=("127.0.0.1", 1), parameters=PARAMETERS | (parameters or {}), faults=faults, release=release)
        self.fleet = Px4Fleet([config], self.motion, error, STEP_S, rng, clock_ns=lambda: self.now_ns)
        self.face = self.fleet.faces[0]
        self._arrived: list[bytes] = []
        self.face.links[0].attach(self._arrived.append)
        self.asked: list[tuple[float, str, bytes]] = []
        self.vehicle = Px4Vehicle(
            Demands(VehicleConfig(), CEILING_M),
            clock_ns=lambda: self.now_ns,
            exact=True,
            clock_s=lambda: self.time_s,
            link=BytesLink(self._sent),  # type: ignore[arg-type]
        )
        self.pilot = Pilot(mission, DroneConfig(id="d1"), boot=boot_of("d1"), nonce_key=nonce_key_of(boot_of("d1")))
        self._mission = mission
        self.heard: list[tuple[float, Heartbeat | ExtendedState]] = []
        self.states: list[VehicleState] = []
        self.statuses: list[Status] = []
        self.stages: list[tuple[float, Stage]] = [(0.0, self.pilot.stage)]
        self.vehicle.on_state(self._observe)
        self.deaf = False  # no packet from the vehicle arrives
        self._steps = 0

    @property
    def time_s(self) -> float:
        return self.fleet.time_s if hasattr(self, "fleet") else 0.0

    @property
    def now_ns(self) -> int:
        return UTC_NS + round(self.time_s * 1e9)

    @property
    def true_height_m(self) -> float:
        return float(self.motion.position_m[0, 2])

    @property
    def told(self) -> tuple[str, ...]:
        """The problems of the newest status."""
        return self.statuses[-1].problems if self.statuses else ()

    def order(self, action: Action) -> None:
        """An operator's command."""
        self.pilot.receive(*command(action, self._mission, stamp_ns=self.now_ns), self.now_ns)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self._step()

    def until(self, condition: Callable[[], bool], limit_s: float) -> None:
        """Fails where it does not come about in so long."""
        end_s = self.time_s + limit_s
        while not condition():
            assert self.time_s < end_s, (self.pilot.stage, self.told, self.states[-1:], self.fleet.reports())
            self._step()

    def ready(self) -> None:
        """Nothing stands against a start."""
        self.until(lambda: bool(self.statuses) and self.told == (), 30.0)

    def began(self, stage: Stage) -> float | None:
        """When the newest stage of this kind began."""
        return next((time_s for time_s, one in reversed(self.stages) if one is stage), None)

    def setpoints(self, since_s: float) -> list[float]:
        """When any were sent."""
        return [time_s for time_s, name, _ in self.asked if name == "SET_POSITION_TARGET_LOCAL_NED" and time_s >= since_s]

    def _sent(self, packet: bytes) -> None:
        found = fields_of(packet)
        assert found is not None
        self.asked.append((self.time_s, found[0], packet))
        self.face.links[0].hear(packet, self.now_ns)

    def _observe(self, state: VehicleState) -> None:
        self.states.append(state)
        self.pilot.observe_vehicle(state)

    def _step(self) -> None:
        self.fleet.step()
        burst = [received for received in map(self._decoded, self._arrived) if received is not None]
        self._arrived.clear()
        if burst and not self.deaf:
            self.vehicle._receive(burst)
        self._steps += 1
        if self._steps % LOOK_STEPS == 0:
            self.pilot.block(self.vehicle.problems)
        if self._steps % TICK_STEPS == 0:
            self._tick()

    def _tick(self) -> None:
        step = self.pilot.step(self.now_ns)
        self.vehicle.command(step.command)
        for key, payload in step.publications:
            message = decode_from(key, payload)
            if isinstance(message, Status):
                self.statuses.append(message)
        if self.pilot.stage is not self.stages[-1][1]:
            self.stages.append((self.time_s, self.pilot.stage))

    def _decoded(self, packet: bytes) -> Received | None:
        found = fields_of(packet)
        if found is None or found[0] not in DECODERS:
            return None
        message = DECODERS[found[0]].decode(found[1])
        if isinstance(message, Heartbeat | ExtendedState):
            self.heard.append((self.time_s, message))
        return Received(message, self.now_ns, self.time_s)
