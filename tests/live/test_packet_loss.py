"""Agents on hosts of their own, the packets between which are lost: TCP repeats them, and the links break and come again."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.live.lossy_flight import LACKING, can_lose_packets, fly_over

pytestmark = pytest.mark.skipif(not can_lose_packets(), reason=LACKING)


@pytest.mark.long
@pytest.mark.parametrize("loss", [0.05, 0.2])
def test_a_swarm_that_loses_packets_finds_the_source_and_has_one_log(tmp_path: Path, loss: float) -> None:
    """The cost in accuracy takes more flights: ``python benchmarks/packet_loss.py``."""
    flown = fly_over(tmp_path, 3, loss, track_s=20.0)
    print(flown)
    assert flown.ended == {}, "a watchdog killed its agent"
    assert not flown.lost
    assert flown.error_m < 2.0
    assert flown.agreed
    assert flown.landed
