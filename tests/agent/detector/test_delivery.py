"""Deliveries into readouts: every hit, loss and dead nanosecond is in exactly one of them."""

import numpy as np
import pytest

from radron.agent.detector.delivery import Delivery, Gathering
from radron.agent.detector.readout import PixelHits


def hits(*ticks):
    return PixelHits(np.array(ticks, np.int64), np.zeros(len(ticks), np.uint16), np.full(len(ticks), 30, np.uint16))


def test_losses_are_told_once_and_missing_time_is_paid_by_the_next_readouts():
    gathering = Gathering()
    gathering.add(Delivery(hits(0, 16), lost_hits=2, lost_ns=1500, repaired_hits=3))
    first = gathering.readout(0, 1000, 0)
    assert (len(first.hits), first.lost_hits, first.repaired_hits, first.live_time_s) == (2, 2, 3, 0.0)
    second = gathering.readout(1000, 2000, 0)
    assert (len(second.hits), second.lost_hits, second.repaired_hits) == (0, 0, 0)
    assert second.live_time_s == pytest.approx(500e-9)


def test_later_hits_wait_for_their_readout():
    gathering = Gathering()
    gathering.add(Delivery(hits(0, 639, 640)), offset=0)  # 640 ticks are 1000 ns
    gathering.add(Delivery(hits(10)), offset=640)
    assert (gathering.first_tick, gathering.latest_tick) == (0, 650)
    assert gathering.readout(0, 1000, 0, later_hits=False).hits.tick.tolist() == [0, 639]
    assert gathering
    assert gathering.readout(1000, 2000, 0, later_hits=False).hits.tick.tolist() == [640, 650]
    assert not gathering
