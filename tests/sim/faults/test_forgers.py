"""Forged messages: what an agent must refuse is refused by the codec or the log, and nothing else is changed."""

import msgspec
import pytest
from of_a_second import at

from protocol.codec import decode_from, encode
from protocol.errors import ProtocolError
from protocol.keys import key_of
from protocol.messages import Action
from sim.faults.forgers import LATE_NS, Forgers, OldCommands
from sim.faults.kinds import KINDS
from sim.faults.schedule import Schedule

DRONES = ("d1", "d2", "d3")


def forged(what, kind, drone=0, second=1.0):
    schedule = Schedule(
        [msgspec.convert({"kind": "forged", "at_s": 0.0, "for_s": 5.0, "target": "d1", "what": what}, KINDS["forged"])], DRONES, 1
    )
    schedule.advance(second)
    message = at(kind, 3)
    key = key_of("s", message)
    return key, Forgers(schedule, DRONES).forged(drone, key, encode(message))


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


def test_an_old_command_comes_after_the_one_that_ended_it() -> None:
    schedule = Schedule([msgspec.convert({"kind": "old-command", "at_s": 1.0, "target": "d2"}, KINDS["old-command"])], DRONES, 1)
    commands, arrived = OldCommands(schedule), []
    for tick in range(300):
        schedule.advance(0.05 * tick)
        arrived += [(tick, *command) for command in commands.due(tick * 50_000_000)]
    assert [(tick, drone, action) for tick, drone, action, _ in arrived] == [
        (20, 1, Action.HOLD),
        (80, 1, Action.RESUME),
        (20 + LATE_NS // 50_000_000, 1, Action.HOLD),
    ]
    assert arrived[2][3] == arrived[0][3] < arrived[1][3]


def test_an_agent_that_was_dead_gets_no_old_command() -> None:
    schedule = Schedule([msgspec.convert({"kind": "old-command", "at_s": 0.0, "target": "d2"}, KINDS["old-command"])], DRONES, 1)
    commands = OldCommands(schedule)
    schedule.advance(0.0)
    assert [command[:2] for command in commands.due(0)] == [(1, Action.HOLD)]
    schedule.advance(0.05)
    commands.forget(1)
    assert commands.due(2 * LATE_NS) == []
