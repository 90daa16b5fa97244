"""A camera that is turned against its drone's heading is reported, with its side; the others are not."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from radron.agent.fusion.bayes.turned import turned_deg, with_score
from radron.protocol.entries import Cone
from support.flights.bayes import SOURCE, entries_of, fusion_of


def turned(entry, turn_deg):
    """A cone of drone b turned to the left about the vertical; all else as it is."""
    if not isinstance(entry, Cone) or entry.drone != "b":
        return entry
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))

    def about_up(order):
        x, y, z = order.axis
        return msgspec.structs.replace(order, axis=(cosine * x - sine * y, sine * x + cosine * y, z))

    return msgspec.structs.replace(entry, orders=tuple(map(about_up, entry.orders)))


def found(kit, turn_deg, seed):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(seed), 60.0, lambda _: SOURCE, 3e10)
    fusion = fusion_of(mission)
    kit.feed(fusion, [turned(entry, turn_deg) for entry in entries])
    kit.settle(fusion, kit.T0_NS + 60_000_000_000)
    return fusion.hypothesis.turned_deg


@pytest.mark.parametrize("turn_deg", [8.0, -8.0])
def test_a_turned_camera_is_told_with_its_side(kit, turn_deg):
    """About 200 cones each: a camera seen from all sides of the circle; the estimate is of first order."""
    told = found(kit, turn_deg, 1)
    assert set(told) == {"b"}
    assert 4.0 < told["b"] * math.copysign(1.0, turn_deg) < 10.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_camera_that_looks_where_its_file_says_is_told(kit, seed):
    assert found(kit, 0.0, seed) == {}


def test_what_is_uncertain_or_small_is_not_told():
    turns = {}
    for _ in range(24):
        turns = with_score(turns, 0, 10.0)
    assert turned_deg(turns, 0) is None  # 5.7 deg at just under 5 sigmas
    assert turned_deg(with_score(turns, 0, 10.0), 0) is None  # faded a little
    assert turned_deg(with_score(with_score(turns, 0, 10.0), 0, 10.0), 0) == pytest.approx(5.7, abs=0.1)
    for _ in range(100):
        turns = with_score(turns, 1, 50.0)
    assert turned_deg(turns, 1) is None  # 1.1 deg
    assert turned_deg({}, 2) is None
