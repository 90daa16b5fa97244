"""Keys name swarm, sender and kind; anything else is refused."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.protocol.errors import ProtocolError
from radron.protocol.keys import Key, command_key, drone_key, key_of, parse_key
from radron.protocol.message import Message
from radron.protocol.messages import DRONE_KINDS
from radron.protocol.units import IDENTIFIER, STATION

identifiers = st.from_regex(IDENTIFIER)
drones = identifiers.filter(lambda name: name != STATION)


def parts(key: Key) -> tuple[str, str, str]:
    return key.swarm, key.sender, key.kind


@given(identifiers, drones, st.sampled_from(sorted(DRONE_KINDS)))
def test_drone_keys_are_read_back(swarm: str, drone: str, kind: str) -> None:
    key = drone_key(swarm, drone, kind)
    assert key == f"radron/2/{swarm}/{drone}/{kind}"
    assert parts(parse_key(key)) == (swarm, drone, kind)


@given(identifiers, identifiers)
def test_command_keys_are_read_back(swarm: str, station: str) -> None:
    assert parts(parse_key(command_key(swarm, station))) == (swarm, station, "command")


@given(identifiers, drones, st.sampled_from(sorted(DRONE_KINDS)))
def test_a_key_that_was_read_is_passed_on_as_it_is(swarm: str, drone: str, kind: str) -> None:
    key = parse_key(drone_key(swarm, drone, kind))
    assert parse_key(key) is key


@given(
    st.text(max_size=60)
    | st.lists(st.sampled_from(["radron", "1", "2", "s", "d1", "station", "pose", "command", "*", "**", ""])).map("/".join)
)
def test_any_text_is_a_key_or_refused(text: str) -> None:
    with contextlib.suppress(ProtocolError):
        address = parse_key(text)
        made = (
            command_key(address.swarm, address.sender)
            if address.kind == "command"
            else drone_key(address.swarm, address.sender, address.kind)
        )
        assert made == text


@pytest.mark.parametrize(
    "key",
    [
        "",
        "radron/1/s/d/pose",
        "radron/3/s/d/pose",
        "radron/2/s/d",
        "radron/2/s/d/pose/x",
        "radron/2/s/d/command",
        "radron/2/s/station/pose",
        "radron/2/s/station/t/pose",
        "radron/2/S/d/pose",
        "radron/2/s/d\n/pose",
        "radron/2/s/*/pose",
        "radron/2/s/d/alive",
    ],
)
def test_what_names_no_message_is_refused(key: str) -> None:
    with pytest.raises(ProtocolError):
        parse_key(key)


def test_liveliness_and_log_have_keys() -> None:
    assert drone_key("s", "d", "alive") == "radron/2/s/d/alive"
    assert drone_key("s", "d", "log") == "radron/2/s/d/log"


def test_names_that_make_no_key_are_refused() -> None:
    for swarm, drone, kind in (
        ("S", "d", "pose"),
        ("s", "D", "pose"),
        ("s", "station", "pose"),
        ("s", "d", "command"),
        ("", "d", "pose"),
    ):
        with pytest.raises(ProtocolError):
            drone_key(swarm, drone, kind)
    with pytest.raises(ProtocolError):
        command_key("s", "the tower")
    with pytest.raises(ProtocolError, match="no key"):
        key_of("s", Message(stamp_ns=1))
