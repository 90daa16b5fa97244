"""Small parts of the agent's shell: logs that never block, state that survives, contained exceptions."""

import asyncio
import json
import os
import random
import shutil
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
import structlog
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.mission.memory import Memory
from radron.agent.shell import faultbarrier, statestore
from radron.agent.shell.faultbarrier import FaultBarrier
from radron.agent.shell.heartbeat import Heartbeat
from radron.agent.shell.logs import Logger, UnblockingStream
from radron.agent.shell.missionstore import InForce
from radron.agent.shell.node import Node
from radron.agent.shell.statestore import State, StateFile, StateStore
from radron.agent.vehicle.interface import LaunchPlace
from radron.protocol import versions
from radron.protocol.messages import Stage
from support.flights.one_pilot import MISSION, START_NS, command, pilot, state

STATE = State(
    memory=Memory(mission="0" * 16, stamp_ns=5, started_ns=3, stage=Stage.SURVEY, resume=Stage.SURVEY, home_m=(1.0, 2.0, 3.0)),
    launch=LaunchPlace(
        north_m=1.5, east_m=-2.5, down_m=0.25, origin_latitude_deg=47.4, origin_longitude_deg=8.5, origin_altitude_m=488.0
    ),
)


@pytest.fixture
def log() -> Logger:
    """A logger that shows nothing."""
    capture = structlog.testing.LogCapture()
    return structlog.wrap_logger(None, processors=[capture], wrapper_class=structlog.make_filtering_bound_logger(0))


def test_a_log_that_nobody_reads_does_not_stop_the_writer() -> None:
    reader, writer = os.pipe()
    try:
        stream = UnblockingStream(writer)
        for _ in range(1000):  # 1 MB: sixteen times the pipe's capacity
            assert stream.write("x" * 1000) == 1000
        held = os.read(reader, 1 << 20)
        assert 4096 <= len(held) < 1_000_000
        stream.write("again\n")
        assert os.read(reader, 1 << 20) == b"again\n"
    finally:
        os.close(reader)
        os.close(writer)


def test_state_survives(tmp_path: Path, log: Logger) -> None:
    async def save() -> None:
        store = StateStore(str(tmp_path / "state"), "d1", log)
        assert store.load() == State()
        store.save(STATE)
        store.save(State())  # while the first is being written: it comes again with the next look
        while not (tmp_path / "state/d1.json").exists():
            await asyncio.sleep(0.01)

    asyncio.run(save())
    assert StateStore(str(tmp_path / "state"), "d1", log).load() == STATE
    assert json.loads((tmp_path / "state/d1.json").read_text())["memory"]["stage"] == "survey"


def test_the_state_of_an_older_release_is_read(tmp_path: Path) -> None:
    """The file is from before the state had the frames of all drones."""
    file = StateFile(str(tmp_path), "d1")
    file.path.write_text(
        '{"memory":{"mission":"m1","stamp_ns":7,"started_ns":5,"stage":"track","resume":"survey","released":false,'
        '"tracking_since_ns":null,"home_m":[1.5,2.0,0.25],"epoch_offset":0,"response":null},"launch":null,'
        '"check":"91198b6a2279f0a7"}'
    )
    memory = file.load().memory
    assert memory is not None
    assert (memory.stage, memory.home_m, memory.frames) == (Stage.TRACK, (1.5, 2.0, 0.25), {})


def test_what_a_step_changes_is_saved_with_that_step_and_the_launch_place(tmp_path: Path, log: Logger) -> None:
    """An agent that was killed within half a second of its start knew neither of the flight nor of its launch place."""
    node = Node(DroneConfig(id="d1", state=str(tmp_path)), MISSION, InForce(MISSION), Heartbeat(), log)
    vehicle = SimpleNamespace(launch_to_keep=None)
    node._pilot, node._vehicle = pilot(), vehicle  # type: ignore[assignment]
    node._send_command = node._publish = lambda *_: None

    async def step() -> State:
        node._step()
        if node._store._saving is not None:
            await node._store._saving
        return StateFile(str(tmp_path), "d1").load()

    assert asyncio.run(step()) == State()
    vehicle.launch_to_keep = STATE.launch
    node._pilot.observe_vehicle(state(START_NS))
    node._pilot.receive(*command(), START_NS)
    saved = asyncio.run(step())
    assert STATE.launch is not None
    assert saved == State(memory=node._pilot.memory, launch=replace(STATE.launch, mission=MISSION.mission_id))
    assert saved.memory is not None


@pytest.mark.parametrize("jumped", [True, False])
def test_after_a_jump_that_was_not_announced_the_launch_place_is_not_kept_once_it_has_landed(
    tmp_path: Path, log: Logger, jumped: bool
) -> None:
    """Nothing would show an agent restarted then that its frame has changed."""
    node = Node(DroneConfig(id="d1", state=str(tmp_path)), MISSION, InForce(MISSION), Heartbeat(), log)
    assert STATE.memory is not None
    assert STATE.launch is not None
    node._vehicle = SimpleNamespace(launch_to_keep=replace(STATE.launch, flown=True))  # type: ignore[assignment]
    kept = []
    node._store = SimpleNamespace(save=kept.append)  # type: ignore[assignment]
    for memory in (replace(STATE.memory, epoch_offset=int(jumped)), None):
        node._pilot = SimpleNamespace(memory=memory)  # type: ignore[assignment]
        node._save()
    assert [state.launch.flown for state in kept] == [True, not jumped]


def test_a_launch_place_is_flown_from_in_its_mission_only() -> None:
    """For another mission the vehicle may have been carried to another launch place."""
    assert STATE.launch is not None
    flown = State(launch=replace(STATE.launch, flown=True, mission="m1"))
    assert flown.launch_in("m1") == flown.launch
    assert flown.launch_in("m2") == replace(STATE.launch, mission="m1")
    assert State().launch_in("m1") is None


def test_a_damaged_state_is_no_state(tmp_path: Path, log: Logger) -> None:
    StateFile(str(tmp_path), "d1").save(STATE)
    path = tmp_path / "d1.json"
    whole = path.read_bytes()
    for damaged in (whole[:-20], whole.replace(b"survey", b"\xffurvey"), b'{"x":' + b"[" * 100_000):
        path.write_bytes(damaged)
        store = StateStore(str(tmp_path), "d1", log)
        assert store.load() == State()
        assert store.problem is not None
        assert path.read_bytes() == damaged


def test_the_state_of_a_newer_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a rollback to the other slot, an older agent finds the file of a newer one."""
    file = StateFile(str(tmp_path), "d1")
    with monkeypatch.context() as newer:
        newer.setattr(statestore.versions, "STATE", versions.STATE + 1)
        file.save(STATE)
    with pytest.raises(msgspec.ValidationError, match=r"version 2 of the state, and this release reads up to 1"):
        file.load()
    written = json.loads(file.path.read_text())
    del written["version"]  # as before the file named it
    file.path.write_text(json.dumps(written, separators=(",", ":")))
    assert file.load() == STATE


def test_a_flipped_bit_is_no_state_either(tmp_path: Path, log: Logger) -> None:
    file = StateFile(str(tmp_path), "d1")
    file.save(STATE)
    whole = file.path.read_bytes()
    rng = random.Random(1)
    for _ in range(300):
        at, bit = rng.randrange(len(whole)), 1 << rng.randrange(8)
        file.path.write_bytes(whole[:at] + bytes([whole[at] ^ bit]) + whole[at + 1 :])
        with suppress(msgspec.MsgspecError):
            assert file.load() == STATE


def test_a_disk_that_stands_still_is_told(tmp_path: Path, log: Logger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statestore, "SLOW_S", 0.02)
    stands = threading.Event()
    monkeypatch.setattr(StateFile, "save", lambda file, state: stands.wait(10.0))

    async def run() -> None:
        store = StateStore(str(tmp_path), "d1", log)
        store.save(STATE)
        while store.problem is None:
            await asyncio.sleep(0.005)
        assert "the disk is too slow" in store.problem
        stands.set()
        while store.problem is not None:
            await asyncio.sleep(0.005)

    asyncio.run(run())


def test_a_folder_that_takes_no_state_is_a_problem_and_no_failure(tmp_path: Path, log: Logger) -> None:
    (tmp_path / "taken").write_text("a file where the folder should be")

    async def save() -> str | None:
        store = StateStore(str(tmp_path / "taken"), "d1", log)
        store.save(State())  # on the ground, where there is still time to mend it
        while store.problem is None:
            await asyncio.sleep(0.01)
        return store.problem

    problem = asyncio.run(asyncio.wait_for(save(), 5.0))
    assert problem is not None
    assert problem.startswith("state not saved (")


def test_a_disk_that_fills_while_nothing_changes_is_told(tmp_path: Path, log: Logger, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the ground: a flight without any storage began."""
    monkeypatch.setattr(statestore, "PROBE_S", 0.02)
    folder = tmp_path / "state"

    async def run() -> None:
        store = StateStore(str(folder), "d1", log)
        store.save(STATE)
        while store._saving is None or not store._saving.done():
            await asyncio.sleep(0.005)
        assert store.problem is None
        assert StateFile(str(folder), "d1").load() == STATE
        shutil.rmtree(folder)  # nothing is being written now
        folder.write_text("a file where the folder should be")
        while store.problem is None:
            store.save(STATE)
            await asyncio.sleep(0.005)
        folder.unlink()
        while store.problem is not None:
            store.save(STATE)
            await asyncio.sleep(0.005)

    asyncio.run(asyncio.wait_for(run(), 20.0))


def test_a_handler_that_fails_ends_nothing(log: Logger) -> None:
    barrier = FaultBarrier(log)
    divide = barrier.call("numbers", lambda divisor: 6 // divisor, -1)
    assert [divide(3), divide(0), divide(0), divide(2)] == [2, -1, -1, 3]
    assert barrier.failures == {"numbers": 2}
    assert barrier.problems == ("internal error in the handling of numbers: see the agent's log",)


def test_work_that_fails_is_done_anew(log: Logger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faultbarrier, "AGAIN_S", 0.0)
    attempts: list[int] = []

    async def work() -> None:
        attempts.append(len(attempts))
        if len(attempts) < 3:
            raise ValueError("not yet")

    asyncio.run(asyncio.wait_for(FaultBarrier(log).work("work", work), 5.0))
    assert attempts == [0, 1, 2]
