"""Flights of the lockstep, recorded as the agents record theirs."""

import fcntl
import itertools
import os
import sys
import time
from pathlib import Path

import pytest
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario, override

MISSION = MissionConfig(
    name="recorded",
    area=AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0))),
    drones=(DroneInMission(id="d1"),),
)
DATUM = {"mission__datum": {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}}
HEADER = FlightHeader.of(MISSION, DroneConfig(id="d1"), "0123456789abcdef", 1_800_000_000_000_000_000, nonce_key=b"")


class LockstepPilot(RecordedPilot):
    """Takes a pilot's place in the lockstep. Makes the calls too that only a live agent makes."""

    def __init__(self, folder, mission, config, boot, listeners, memory, trust, *, nonce_key, computing):
        pilot = Pilot(mission, config, boot, listeners, memory, trust, nonce_key=nonce_key, computing=computing)
        self.fusion, self.listeners = pilot.fusion, pilot.listeners
        self.recorder = FlightRecorder(
            folder / config.id, 100, FlightHeader.of(mission, config, boot, time.time_ns(), memory, trust, nonce_key=nonce_key)
        )
        super().__init__(pilot, self.recorder)
        self._steps = itertools.count()

    def step(self, now_ns):
        count = next(self._steps)
        if count % 50 == 0:
            self.warn((CodedText(Code.NO_CONTACT, f"step {count}", "d2"),))
            self.block(())
            self.log_answer(b"no summary" if count % 100 else self.log_summary())
        return super().step(now_ns)


def fly_recorded(folder, seed=1, name="paper-demo", **changes):
    """Fly a scenario in lockstep; the folders of the drones' records. ``changes``: keys of the scenario with __ for the dot."""
    pilots = []

    def made(*args, **kwargs):
        pilots.append(LockstepPilot(folder, *args, **kwargs))
        return pilots[-1]

    try:
        scenario = override(load_scenario(name), {key.replace("__", "."): value for key, value in changes.items()})
        watched(scenario, seed, lambda moment: False, made)
    finally:
        for pilot in pilots:
            pilot.recorder.close()
    return sorted(folder.iterdir())


@pytest.fixture(scope="session")
def flights(tmp_path_factory):
    """Records of three drones, on Earth, that find the source and follow it for 5 s. Flown once for all that read them."""
    own = tmp_path_factory.getbasetemp()
    common = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own  # each of xdist's workers has its own below it
    done = common / "flights"
    with (common / "flights.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not done.exists():
            fly_recorded(common / "flying", mission__track__duration_s=5.0, **DATUM)
            (common / "flying").rename(done)
    return sorted(done.iterdir())


def rewritten(source, target, change):
    """Copy a segment; ``change(topic, data)`` gives each record's data, or None to leave the record out."""
    topics = {}
    with source.open("rb") as stream, target.open("wb") as copy:
        writer = Writer(copy)
        writer.start()
        for item in StreamReader(stream).records:
            match item:
                case Schema():
                    writer.register_schema(item.name, item.encoding, item.data)
                case Channel() if item.id not in topics:
                    topics[item.id] = item.topic
                    writer.register_channel(item.topic, item.message_encoding, item.schema_id)
                case Metadata():
                    writer.add_metadata(item.name, item.metadata)
                case Attachment():
                    writer.add_attachment(item.create_time, item.log_time, item.name, item.media_type, item.data)
                case Message():
                    data = change(topics[item.channel_id], item.data)
                    if data is not None:
                        writer.add_message(item.channel_id, item.log_time, data, item.publish_time, item.sequence)
        writer.finish()
    return target


def telemetry(now_ns):
    """Of a vehicle that stands ready."""
    return VehicleState(
        stamp_ns=now_ns,
        epoch=0,
        position_m=(0.1, -0.0, now_ns % 1000 * 1e-9),
        velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        height_m=0.0,
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
        mode=FlightMode.HOLD,
        armed=False,
        in_air=False,
        healthy=True,
    )


def record_until_killed(folder):
    """A pilot on the ground in real time; prints the wall time of every step."""
    pilot = RecordedPilot(HEADER.pilot(folder), FlightRecorder(folder, 100, HEADER))
    while True:
        now_ns = time.time_ns()
        pilot.observe_vehicle(telemetry(now_ns))
        pilot.step(now_ns)
        print(now_ns, flush=True)
        time.sleep(0.02)


if __name__ == "__main__":
    record_until_killed(Path(sys.argv[1]))
