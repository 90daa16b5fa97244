"""Answers of an emulated vehicle to questions for missions, fences and rally points: it has none, and accepts none.

A ground station asks for all three when it connects, and considers a vehicle without an answer broken.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.mavlink.link import Link
from radron.sim.vehicle.px4.state import Message


class MissionLink:
    """Answers the mission messages of one vehicle's links. ``mission_type``: mission, fence or rally points."""

    def list(self, link: Link, message: Message) -> None:
        """Answer MISSION_REQUEST_LIST: the list is empty."""
        link.send(mavlink.MAVLink_mission_count_message(*_sender(message), 0, message.mission_type))

    def clear(self, link: Link, message: Message) -> None:
        """Answer MISSION_CLEAR_ALL: accepted."""
        _answer(link, message, mavlink.MAV_MISSION_ACCEPTED)

    def upload(self, link: Link, message: Message) -> None:
        """Answer MISSION_COUNT: an empty list is accepted; for any other list the vehicle answers that it flies none."""
        _answer(link, message, mavlink.MAV_MISSION_ACCEPTED if message.count == 0 else mavlink.MAV_MISSION_UNSUPPORTED)


def _answer(link: Link, message: Message, result: int) -> None:
    link.send(mavlink.MAVLink_mission_ack_message(*_sender(message), result, message.mission_type))


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()
