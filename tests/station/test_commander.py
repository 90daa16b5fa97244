"""The page's commands over a real mesh, to a stand-in of a drone that obeys."""

import asyncio
import time
from contextlib import AsyncExitStack

import pytest
from identities import identity, new_issuer
from live_agents import free_ports
from mission_takers import Drone as Taker
from msgspec.structs import replace
from one_pilot import MISSION

from protocol.codec import decode, encode
from protocol.identity import Role
from protocol.keys import key_of
from protocol.mesh.session import Mesh, MeshConfig
from protocol.messages import Action, Command, Stage, Status, Ticket
from station.commander import MOST_AT_ONCE, Commander, may_command

NEW = replace(MISSION, name="new")
STAGES = {Action.HOLD: Stage.HOLD, Action.LAND: Stage.LANDING, Action.START: Stage.TAKEOFF}


class Drone:
    """Does what it is told, if the number is above that of the last command."""

    def __init__(self, slow=()):
        self.stage, self.number, self.slow = Stage.TRACK, 1, slow

    def receive(self, key, payload):
        message = decode(payload)
        if isinstance(message, Command) and message.action not in self.slow and message.to["d1"].number >= self.number:
            self.stage, self.number = STAGES[message.action], message.to["d1"].number + 1

    async def tell(self, mesh):
        while True:
            ticket = Ticket("0" * 16, self.number)
            told = {"mission": "0123456789abcdef", "boot": "0" * 16, "stage": self.stage, "ticket": ticket}
            status = Status(stamp_ns=time.time_ns(), drone="d1", **told)
            mesh.publish(key_of("test", status), encode(status))
            await asyncio.sleep(0.05)


def commanded(drone, *given, within_s=10.0, until):
    """What a station tells of its commands."""
    said = []

    async def run():
        endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
        aircraft = await Mesh.open(MeshConfig(listen=endpoint), "test", "d1", receive=drone.receive)
        telling = asyncio.create_task(drone.tell(aircraft))
        heard = asyncio.Event()

        def receive(key, payload):
            commander.receive(key, payload)
            heard.set()

        station = await Mesh.open(MeshConfig(connect=(endpoint,)), "test", None, receive=receive)
        commander = Commander(station, "test", None, lambda line, warning, what: said.append((line, warning)))
        try:
            await asyncio.wait_for(heard.wait(), within_s)
            for action in given:
                commander.give(action, ())
            async with asyncio.timeout(within_s):
                while not until(said):
                    await asyncio.sleep(0.02)
        finally:
            await commander.close()
            await station.close()
            telling.cancel()
            await aircraft.close()

    asyncio.run(run())
    return said


def test_a_command_is_sent_and_told_to_be_obeyed():
    drone = Drone()
    said = commanded(drone, Action.HOLD, until=lambda said: len(said) == 2)
    assert said == [("hold: to d1, mission 0123456789abcdef", False), ("hold: d1 hold", False)]
    assert drone.stage is Stage.HOLD


def test_a_landing_does_not_wait_for_a_start_that_nobody_obeys():
    said = commanded(
        Drone(slow=(Action.START,)), Action.START, Action.LAND, until=lambda said: ("land: d1 landing", False) in said
    )
    assert not any(warning for _, warning in said)


@pytest.mark.parametrize(("role", "may"), [(Role.OPERATOR, True), (Role.OBSERVER, False), (Role.DRONE, False)])
def test_only_an_operators_certificate_commands(tmp_path, role, may):
    assert may_command(identity(new_issuer(), tmp_path, "one", role)) is may


def test_nobody_heard_and_too_many_at_once_are_told():
    said = []
    commander = Commander(None, "test", None, lambda line, warning, what: said.append((line, warning)))
    commander.give(Action.LAND, ())
    assert said == [("land: no drone is heard", True)]
    actions = [Action.START] * (MOST_AT_ONCE + 1)
    told = commanded(Drone(slow=(Action.START,)), *actions, until=lambda said: any(warning for _, warning in said))
    assert ("start: too many commands at once", True) in told


def uploaded(*drones):
    """What a station tells of its upload, and whether it shows the new mission then."""
    said, taken, commander = [], [], None

    def receive(key, payload):
        commander.receive(key, payload)

    async def run():
        nonlocal commander
        async with AsyncExitStack() as stack:
            dial = ()
            for drone in drones:
                await stack.enter_async_context(drone.running(dial))
                dial += (drone.endpoint,)
            station = await Mesh.open(MeshConfig(connect=dial), "radron", None, receive=receive)
            commander = Commander(station, "radron", None, lambda line, warning, what: said.append((line, warning, what)))
            try:
                commander.upload(NEW, taken.append)
                commander.upload(NEW, taken.append)
                async with asyncio.timeout(20.0):
                    while not said[-1][0].startswith(("all drones have", "not taken by")):
                        await asyncio.sleep(0.02)
            finally:
                await commander.close()
                await station.close()

    asyncio.run(run())
    assert {what for _, _, what in said} == {"upload"}
    assert said.pop(0) == ("refused: another mission is being uploaded", True, "upload")
    return [(line, warning) for line, warning, _ in said], taken


def test_a_mission_goes_to_all_drones_and_each_answer_is_told():
    said, taken = uploaded(Taker("d1"), Taker("d2"))
    assert said[0] == (f"upload: to d1, d2, mission {NEW.mission_id}", False)
    assert {line for line, _ in said[1:-1]} == {
        f"{name}: {does} it{rest}" for name in ("d1", "d2") for does, rest in (("takes", " over"), ("has", ""))
    }
    assert said[-1] == (f"all drones have the mission {NEW.mission_id}", False)
    assert taken == [NEW]


def test_a_mission_that_one_drone_refuses_is_told_with_what_follows():
    said, taken = uploaded(Taker("d1", refuses="its mission has begun (survey)"), Taker("d2"))
    assert ("d1: refused: its mission has begun (survey)", False) in said
    assert said[-1] == ("not taken by d1: no start is possible until all have the same mission", True)
    assert taken == [NEW]
    assert uploaded(Taker("d1", refuses="x"), Taker("d2", refuses="x"))[1] == []
