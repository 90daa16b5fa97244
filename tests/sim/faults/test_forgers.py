"""Forged messages: what an agent must refuse is refused by the codec or the log, and nothing else is changed."""

import msgspec
import pytest

from radron.protocol.codec import decode_from, encode
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import key_of
from radron.protocol.messages import Action
from radron.sim.faults.forgers import COPY_AFTER_NS, RESUME_AFTER_NS, Forgers, OldCommands
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Schedule
from radron.sim.lockstep.members import SimulatedAuthority
from support.flights.drone_messages import at

DRONES = ("d1", "d2", "d3")
TRUSTS = [SimulatedAuthority(1).trust(name) for name in DRONES]


def forged(what, kind, drone=0, second=1.0):
    schedule = Schedule(
        [msgspec.convert({"kind": "forged", "at_s": 0.0, "for_s": 5.0, "target": "d1", "what": what}, KINDS["forged"])], DRONES, 1
    )
    schedule.advance(second)
    message = at(kind, 3)
    key = key_of("s", message)
    return key, Forgers(schedule, DRONES, TRUSTS, Poisoners(schedule, [])).forged(drone, key, encode(message))


@pytest.mark.parametrize("what", ["impossible", "impersonated"])
@pytest.mark.parametrize("kind", ["pose", "plan", "cone", "exposure"])
def test_what_contradicts_itself_or_its_key_is_refused(what: str, kind: str) -> None:
    key, (payload,) = forged(what, kind)
    with pytest.raises(ProtocolError):
        decode_from(key, payload)


def test_entries_of_another_mission_and_second_versions_are_valid_messages() -> None:
    key, (payload,) = forged("other-mission", "cone")
    assert decode_from(key, payload).mission != at("cone", 3).mission
    key, (payload,) = forged("two-versions", "cone")
    other = decode_from(key, payload)
    assert other.entry_id == at("cone", 3).entry_id
    assert other != at("cone", 3)


def test_nobody_else_forges_nor_when_it_is_over_nor_what_is_no_measurement() -> None:
    assert forged("impossible", "pose", drone=1)[1] == []
    assert forged("impossible", "pose", second=6.0)[1] == []
    assert forged("other-mission", "pose")[1] == []
    assert forged("impossible", "sighting")[1] == []


def commanded(schedule):
    """Messages that a drone receives in the first 15 s: tick, drone, action, or "copy" for bytes that came before."""
    commands, arrived = OldCommands(schedule), []

    def command(drones, action):
        arrived.append((tick, drones[0], action))
        return f"{action} at {tick}".encode()

    for tick in range(300):
        schedule.advance(0.05 * tick)
        commands.advance(
            tick * 50_000_000, command, lambda now_ns, drone, payload: arrived.append((now_ns // 50_000_000, drone, payload))
        )
    return arrived


def test_an_old_command_comes_after_the_one_that_ended_it() -> None:
    schedule = Schedule([msgspec.convert({"kind": "old-command", "at_s": 1.0, "target": "d2"}, KINDS["old-command"])], DRONES, 1)
    assert commanded(schedule) == [
        (20, 1, Action.HOLD),
        (20 + RESUME_AFTER_NS // 50_000_000, 1, Action.RESUME),
        (20 + COPY_AFTER_NS // 50_000_000, 1, b"hold at 20"),
    ]
