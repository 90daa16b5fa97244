"""The autopilot's firmware, from AUTOPILOT_VERSION as MAVLink's JSON has it."""

from __future__ import annotations

import msgspec
import pytest

from radron.agent.vehicle.mavlink.messages import DECODERS, AutopilotVersion


def version(number: int, commit: tuple[int, ...] = (0,) * 8) -> AutopilotVersion:
    document = {"flight_sw_version": number, "flight_custom_version": commit, "vendor_id": 9900, "capabilities": 1}
    message = DECODERS["AUTOPILOT_VERSION"].decode(msgspec.json.encode(document))
    assert isinstance(message, AutopilotVersion)
    return message


@pytest.mark.parametrize(
    ("number", "commit", "text"),
    [
        (0x01_11_00_FF, (0,) * 8, "PX4 1.17.0"),
        (0x01_0F_04_80, (0,) * 8, "PX4 1.15.4 (beta)"),
        (0x01_10_00_FF, (0xEF, 0xBE, 0xAD, 0xDE, 0xD4, 0xC3, 0xB2, 0xA1), "PX4 1.16.0, a1b2c3d4"),
    ],
)
def test_what_is_told_of_it(number: int, commit: tuple[int, ...], text: str) -> None:
    assert version(number, commit).text == text


@pytest.mark.parametrize(("number", "old"), [(0x01_0C_03_FF, True), (0x01_0D_00_FF, False), (0x02_00_00_00, False), (0, False)])
def test_what_is_too_old(number: int, old: bool) -> None:
    assert version(number).is_too_old == old
