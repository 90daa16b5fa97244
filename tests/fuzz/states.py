"""State files: an agent that starts with one reports unreadable parts, and flies in any case."""

from __future__ import annotations

import hashlib
from pathlib import Path
from random import Random

import msgspec
import numpy as np
import structlog

from radron.agent.config.drone import DroneConfig, VehicleConfig
from radron.agent.frames.kept import KeptFrame, KeptTransform
from radron.agent.mission.memory import Memory
from radron.agent.navigation.identification import FoundResponse
from radron.agent.pilot import Pilot
from radron.agent.shell.statestore import State, StateStore, encode_state
from radron.agent.vehicle.interface import FlightMode, LaunchPlace
from radron.agent.vehicle.mavlink.messages import Attitude, ExtendedState, GlobalOrigin, Heartbeat, LocalPosition, SystemStatus
from radron.agent.vehicle.telemetry import Telemetry
from radron.protocol.messages import Stage
from support.flights.one_pilot import MISSION, SECOND, START_NS, state
from tests.fuzz.mutation import HOSTILE_NUMBERS, HOSTILE_TEXTS, broken_text, mutated
from tests.fuzz.target import Probe, Target, expect

_FLOWN = 10  # of so many files one is flown on with
_MONSTERS = (
    b"",
    b"null",
    b"[]",
    b"{}",
    b"[" * 100_000,
    b'{"memory":' * 50_000,
    b'{"x":' + b"[" * 100_000,
    b"\xff",
    b'"\xff"',
    b"{" * 1000,
)
_ORIGIN = (473977420, 85455940, 488000)
_ROWS = tuple(np.diag([0.1, 0.1, 0.1, 0.01]).ravel().tolist())


class States(Target):
    """State files of a drone that flies, with other numbers, texts and bytes."""

    name = "states"
    inputs = 100_000
    batch = 50
    limit_s = 0.1

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._log = structlog.wrap_logger(structlog.ReturnLogger(), processors=[])
        self._examples = tuple(map(encode_state, _states()))

    def case(self, rng: Random, probe: Probe) -> None:
        """A series of files, under the same name."""
        path = self.folder / "d1.json"
        for _ in range(self.batch):
            data = self._content(rng)
            path.write_bytes(data)
            probe.feed(data, self._start, data, rng.randrange(_FLOWN) == 0)

    def _content(self, rng: Random) -> bytes:
        example, pick = rng.choice(self._examples), rng.random()
        if pick < 0.01:
            return rng.choice(_MONSTERS)
        if pick < 0.6:
            document = msgspec.json.decode(example)
            for _ in range(rng.choice((1, 1, 2, 3))):
                document = mutated(
                    rng, document, lambda rng: rng.choice((*HOSTILE_NUMBERS, *HOSTILE_TEXTS, None, [], {}, True, 1e308))
                )
            return _checked(document)
        return broken_text(rng, example)

    def _start(self, data: bytes, flown: bool) -> None:
        store = StateStore(str(self.folder), "d1", self._log)
        found = store.load()
        expect(store.problem is None or "\n" not in store.problem, "a problem of several lines")
        expect(store.problem is None or found == State(), "a state from a file that cannot be read")
        if flown:
            _fly_on(found)


def _checked(document: object) -> bytes:
    """The content of a file with the content's own check, if it has any: a wrong content has been written so."""
    if isinstance(document, dict) and "check" in document:
        written = msgspec.json.encode({key: value for key, value in document.items() if key != "check"})
        document = document | {"check": hashlib.blake2b(written, digest_size=8).hexdigest()}
    return msgspec.json.encode(document)


def _fly_on(found: State) -> None:
    """The agent starts with its vehicle in the air."""
    telemetry = Telemetry(VehicleConfig(), found.launch)
    sensors = 0x1000_0027
    for message in (
        Heartbeat(0x9D, 0x60000, 4),
        ExtendedState(2),
        SystemStatus(sensors, sensors, sensors, 90),
        GlobalOrigin(*_ORIGIN),
    ):
        telemetry.receive(message, START_NS, 1.0)
    pilot = Pilot(MISSION, DroneConfig(id="d1"), boot="1" * 16, memory=found.memory, nonce_key=b"")
    for tick in range(4):
        now_ns, now_s = START_NS + tick * SECOND // 20, 1.0 + 0.05 * tick
        telemetry.receive(Attitude(tick * 50, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), now_ns, now_s)
        own = telemetry.receive(LocalPosition(tick * 50, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0), now_ns, now_s)
        pilot.observe_vehicle(own or state(now_ns, FlightMode.OFFBOARD))
        pilot.step(now_ns)
    if pilot.memory is not None:
        msgspec.json.encode(State(memory=pilot.memory, launch=telemetry.launch.to_keep))


def _states() -> tuple[State, ...]:
    memory = Memory(
        mission=MISSION.mission_id,
        stamp_ns=START_NS,
        started_ns=START_NS - 60 * SECOND,
        stage=Stage.TRACK,
        resume=Stage.TRACK,
        stays=True,
        holds=True,
        tracking_since_ns=START_NS - 20 * SECOND,
        searching_since_ns=START_NS - 40 * SECOND,
        home_m=(5.0, 5.0, 0.0),
        epoch_offset=1,
        response=FoundResponse(**{field.name: 0.3 for field in msgspec.structs.fields(FoundResponse)}),
        frames={
            "d1": KeptFrame(
                epoch=1,
                stamp_ns=START_NS,
                yaw_rad=0.3,
                translation_m=(1.0, 2.0, 0.0),
                covariance=_ROWS,
                otherwise=KeptTransform(yaw_rad=0.1, translation_m=(3.0, 2.0, 0.0), covariance=None),
            ),
            "d2": KeptFrame(epoch=2, stamp_ns=START_NS, yaw_rad=0.3, translation_m=(1.0, 2.0, 0.0), covariance=None),
        },
        copied=("d2",),
    )
    launch = LaunchPlace(
        north_m=1.0,
        east_m=2.0,
        down_m=0.1,
        origin_latitude_deg=_ORIGIN[0] * 1e-7,
        origin_longitude_deg=_ORIGIN[1] * 1e-7,
        origin_altitude_m=_ORIGIN[2] * 1e-3,
        booted_ns=START_NS - 100 * SECOND,
        resets=3,
    )
    return State(memory=memory, launch=launch), State(memory=msgspec.structs.replace(memory, response=None)), State(launch=launch)
