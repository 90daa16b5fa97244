"""The page's commands over a real mesh, to a stand-in of a drone that obeys."""

import asyncio
import time
from contextlib import AsyncExitStack

import pytest
from msgspec.structs import replace

from radron.protocol.codec import decode, encode
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Action, Command, Stage, Status, Ticket
from radron.station.commander import Commander, may_command
from support.flights.one_pilot import MISSION
from support.live.agents import free_ports
from support.mesh.identities import identity, new_issuer
from support.mesh.mission_receivers import Drone as Taker

NEW = replace(MISSION, name="new")
STAGES = {Action.HOLD: Stage.HOLD, Action.LAND: Stage.LANDING, Action.START: Stage.TAKEOFF}


class Drone:
    """A drone that obeys a command numbered above the last one."""

    def __init__(self, slow=(), tells_every_s=0.05):
        self.stage, self.number, self.slow = Stage.TRACK, 1, slow
        self.tells_every_s, self.statuses, self.obeyed = tells_every_s, 0, []

    def receive(self, key, payload):
        message = decode(payload)
        if isinstance(message, Command) and message.action not in self.slow and message.to["d1"].number >= self.number:
            self.stage, self.number = STAGES[message.action], message.to["d1"].number + 1
            self.obeyed.append(message.action)

    async def tell(self, mesh):
        while True:
            ticket = Ticket("0" * 16, self.number)
            told = {"mission": "0123456789abcdef", "boot": "0" * 16, "stage": self.stage, "ticket": ticket}
            status = Status(stamp_ns=time.time_ns(), drone="d1", **told)
            mesh.publish(key_of("test", status), encode(status))
            self.statuses += 1
            await asyncio.sleep(self.tells_every_s)


def commanded(drone, *given, within_s=10.0, until, refused=None):
    """A station's report on its commands; ``given``: actions, also with drones; ``refused``: collects why not."""
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
            for one in given:
                action, drones = one if isinstance(one, tuple) else (one, ())
                why = commander.give(action, drones, 0.0)
                assert bool(why) == (refused is not None)
                if why:
                    refused.append(why)
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


def test_nobody_heard_is_told():
    commander = Commander(None, "test", None, lambda line, warning, what: None)
    assert commander.give(Action.LAND, (), 0.0) == "not sent: no drone is heard"
    assert commander.give(Action.LAND, ("d1", "d2"), 0.0) == "not sent: d1, d2 not heard"


def test_a_hold_goes_at_once_to_the_drones_that_are_heard_and_a_start_to_none():
    """Before, the command was held back for 8 s, and then sent to none of them."""
    said = commanded(Drone(), (Action.HOLD, ("d1", "d7")), until=lambda said: ("hold: d1 hold", False) in said, within_s=4.0)
    assert said[0] == ("hold: not sent to d7: not heard", True)
    refused = []
    commanded(Drone(), (Action.START, ("d1", "d7")), until=lambda said: refused, refused=refused)
    assert refused == ["not sent: d7 not heard"]


def test_the_newest_command_counts_though_an_earlier_one_is_still_repeated():
    """Return, then hold within a second: the return was numbered anew, and sent a second time after the hold was obeyed."""
    drone = Drone(tells_every_s=0.6)
    said = commanded(
        drone, Action.LAND, Action.HOLD, until=lambda said: ("hold: d1 hold", False) in said and drone.statuses > 5, within_s=15.0
    )
    assert drone.stage is Stage.HOLD
    assert drone.obeyed[-1] is Action.HOLD
    assert ("land: a later command came first", False) in said


def uploaded(*drones):
    """A station's report on its upload, and whether the page then shows the new mission."""
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
                while why := commander.upload(NEW, taken.append, 0.0):
                    assert why.endswith(" not heard")
                    await asyncio.sleep(0.02)
                assert commander.upload(NEW, taken.append, 0.0) == "refused: another mission is being uploaded"
                async with asyncio.timeout(20.0):
                    while not said or not said[-1][0].startswith(("all drones have", "not taken by")):
                        await asyncio.sleep(0.02)
            finally:
                await commander.close()
                await station.close()

    asyncio.run(run())
    assert {what for _, _, what in said} == {"upload"}
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
