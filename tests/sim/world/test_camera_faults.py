"""Flights with one faulty camera: it neither creates a source nor moves one."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.detector.readout import PixelHits
from radron.protocol.codec import decode_from
from radron.sim.faults.network import FaultyRadio
from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override
from radron.sim.world.cameras import Cameras

FAULTY = 1


def flown(monkeypatch, fault, scenario, **changes):
    """The result of a flight in which each readout of one drone passes through ``fault``, and that drone's problems."""
    read_out, send = Cameras.read_out, FaultyRadio.send
    problems = set()

    def faulty(self, drone):
        readout = read_out(self, drone)
        return fault(readout) if drone == FAULTY else readout

    def listen(self, drone, key, payload, *more):
        if drone == FAULTY and key.endswith("/status"):
            problems.update(decode_from(key, payload).problems)
        return send(self, drone, key, payload, *more)

    monkeypatch.setattr(Cameras, "read_out", faulty)
    monkeypatch.setattr(FaultyRadio, "send", listen)
    return fly(override(load_scenario(scenario), changes), seed=4).result, problems


@pytest.mark.slow
@pytest.mark.parametrize("per_s", [10.0, 30.0])
def test_a_noisy_pixel_makes_no_source(monkeypatch, per_s):
    """The fault begins in flight. Unless it were masked, 30 a second would make a source, and 10 a second hide one of 2e9 Bq."""
    rng = np.random.default_rng(1)
    began = {}

    def fault(readout):
        if readout.start_ns < began.setdefault("ns", readout.start_ns) + 5_000_000_000:
            return readout
        first, last = (-((readout.clock_ns - time_ns) * 16 // 25) for time_ns in (readout.start_ns, readout.end_ns))
        count = rng.poisson(per_s * readout.live_time_s)
        noise = PixelHits(rng.integers(first, last, count), np.full(count, 30_000, np.uint16), np.full(count, 80, np.uint16))
        return replace(readout, hits=PixelHits.joined((readout.hits, noise)))

    result, problems = flown(monkeypatch, fault, "empty", **{"end.search_s": 25.0})
    assert not result.false_hypothesis
    assert result.time_to_x0_s is None
    assert result.excluded_bq < 1e9
    assert problems == {"camera: 1 noisy pixel masked"}


@pytest.mark.slow
def test_a_dead_camera_does_not_mislead_the_others(monkeypatch):
    """With its zeros the track of this flight is 11 m off; the three cameras together know the source to 0.1 m."""
    result, problems = flown(
        monkeypatch,
        lambda readout: replace(readout, hits=PixelHits.none()),
        "ideal-static-swarm",
        **{"end.track_s": 25.0},
    )
    assert result.error_median_m < 0.5
    assert any("no hit for 20 s" in problem for problem in problems)
