"""The real link, over UDP: recorded bytes through MAVSDK, and other senders on that link."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.config.drone import VehicleConfig
from radron.agent.errors import VehicleError
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.agent.vehicle.mavlink.claim import claim_port, holders
from radron.agent.vehicle.px4 import Px4Vehicle
from support.px4.recorded import packets

GLOBAL_ORIGIN = 49  # message id
SPEED = 1.5  # of the recording's time to the wall's; a launch place takes a second of standing still, and it arms after four


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Foreigner:
    """Another component of the vehicle's system, another vehicle's autopilot, and a ground station: none of them is ours."""

    def __init__(self, system: int) -> None:
        self._voices = [mavlink.MAVLink(None, *who) for who in ((system, 195), (system + 1, 1), (255, 190))]

    def beats(self) -> list[bytes]:
        """Armed and critical, every one of them."""
        return [mavlink.MAVLink_heartbeat_message(2, 12, 0x91, 0x6040000, 5, 3).pack(voice) for voice in self._voices]


@pytest.mark.slow
def test_recorded_bytes_lead_to_the_recorded_states_whoever_else_speaks() -> None:
    async def scenario() -> None:
        recorded = [packet for packet in packets("A_boot_nogcs_armtries") if packet.component == 1]
        system, port = recorded[0].system, free_port()
        config = VehicleConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=8.0, system_id=system)
        vehicle = Px4Vehicle(Demands(config, 60.0))
        states: list[VehicleState] = []
        problems: set[str] = set()
        vehicle.on_state(states.append)
        foreigner = Foreigner(system)
        origin = next(packet.data for packet in recorded if int.from_bytes(packet.data[7:10], "little") == GLOBAL_ORIGIN)
        answered = False
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            connecting = asyncio.create_task(vehicle.connect())
            begun_s = time.monotonic()
            beat_s = 0.0
            for packet in recorded:
                while (now_s := (time.monotonic() - begun_s) * SPEED) < packet.time_s:
                    await asyncio.sleep(0.005)
                if now_s >= beat_s:
                    beat_s = now_s + 0.5
                    for beat in foreigner.beats():
                        sender.sendto(beat, ("127.0.0.1", port))
                sender.sendto(packet.data, ("127.0.0.1", port))
                if connecting.done() and not answered:  # sent only once, before there is a listener, and then on request
                    answered = True
                    sender.sendto(origin, ("127.0.0.1", port))
                problems.update(vehicle.problems)
            await asyncio.sleep(0.2)
            await connecting
        await vehicle.close()
        armed = [state.armed for state in states]
        changes = [armed[0], *(now for before, now in pairwise(armed) if before is not now)]
        assert changes in ([False, True, False], [True, False])
        assert {state.mode for state in states} == {FlightMode.HOLD}
        assert "the autopilot is in a failsafe" not in problems
        assert "the autopilot says: Heading estimate not stable" in problems  # an event: there is no text on this link

    asyncio.run(scenario())


def test_who_holds_a_port_is_named_after_it_was_waited_for() -> None:
    async def scenario() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            port = other.getsockname()[1]
            begun_s = time.monotonic()
            with pytest.raises(VehicleError, match=rf"in use for 0\.5 s by .*process {os.getpid()}"):
                await claim_port(f"udpin://127.0.0.1:{port}", patience_s=0.5)
            assert time.monotonic() - begun_s >= 0.5
            waiting = asyncio.create_task(claim_port(f"udpin://127.0.0.1:{port}"))
            await asyncio.sleep(0.1)
            assert not waiting.done()
        await waiting  # released
        assert holders(port) == []

    asyncio.run(scenario())


def test_an_autopilot_with_another_number_is_not_ours() -> None:
    async def scenario() -> None:
        port = free_port()
        config = VehicleConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=0.6, system_id=7)
        connecting = asyncio.create_task(Px4Vehicle(Demands(config, 60.0)).connect())
        voice = mavlink.MAVLink(None, 3, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not connecting.done():
                sender.sendto(mavlink.MAVLink_heartbeat_message(2, 12, 0x1D, 0x3040000, 3, 3).pack(voice), ("127.0.0.1", port))
                await asyncio.sleep(0.1)
        with pytest.raises(VehicleError, match="system_id 7"):
            await connecting

    asyncio.run(scenario())
