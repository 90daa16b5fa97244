"""Round trip and loss to the other drones, from the output of ping."""

from __future__ import annotations

import asyncio
import shutil

import pytest

from radron.agent.doctor.reach import judged, reach

SAID = "--- 10.7.1.12 ping statistics ---\n{} packets transmitted, {} received, {}% packet loss, time 4821ms\n"
TIMES = "rtt min/avg/max/mdev = {}/{}/{}/0.1 ms\n"


@pytest.mark.parametrize(
    ("said", "verdict", "text"),
    [
        (SAID.format(25, 25, 0) + TIMES.format(1.0, 2.31, 9.5), "ok", "10.7.1.12: 2.3 ms (at most 9.5), 0 % of 25 lost"),
        (SAID.format(25, 22, 12) + TIMES.format(1.0, 2.31, 9.5), "check", "12 % of 25 lost: check antennas and channel"),
        (SAID.format(25, 25, 0) + TIMES.format(90.0, 140.0, 300.0), "check", "140.0 ms (at most 300.0)"),
        (SAID.format(25, 0, 100), "not yet", "10.7.1.12 does not answer"),
        ("ping: socket: Operation not permitted\n", "not yet", "ping says: ping: socket: Operation not permitted"),
        ("", "not yet", "ping says: nothing"),
    ],
)
def test_what_ping_says(said: str, verdict: str, text: str) -> None:
    found = judged("reach d2", "10.7.1.12", said)
    assert found.verdict == verdict
    assert text in found.text


@pytest.mark.skipif(shutil.which("ping") is None, reason="ping is missing on this computer: `apt-get install iputils-ping`")
@pytest.mark.slow
def test_a_computer_that_answers() -> None:
    found = asyncio.run(reach("d2", "tls/127.0.0.1:7447"))
    assert (found.verdict, found.text.endswith("0 % of 25 lost")) == ("ok", True)


def test_a_drone_without_an_endpoint() -> None:
    assert asyncio.run(reach("d2", None)).verdict == "failed"
