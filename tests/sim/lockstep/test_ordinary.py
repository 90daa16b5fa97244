"""A mixed swarm: one drone with a camera, two with NaI detectors, over a point source on soil."""

from __future__ import annotations

from collections import defaultdict

import pytest

from radron.agent.pilot import Pilot
from radron.protocol.codec import decode_from
from radron.protocol.entries import Exposure
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario

FLIGHT_S = 60.0


@pytest.mark.slow
def test_mixed_swarm_logs_counts_by_channel() -> None:
    exposures: dict[str, list[Exposure]] = defaultdict(list)
    heard: set[str] = set()

    class Listening(Pilot):
        def observe_detector(self, readout):
            published = super().observe_detector(readout)
            for key, payload in published:
                if isinstance(entry := decode_from(key, payload), Exposure):
                    exposures[entry.drone].append(entry)
            return published

        def receive(self, key, payload, now_ns):
            if key.endswith("/exposure"):
                entry = decode_from(key, payload)
                heard.update([entry.drone] if entry.bins else [])
            return super().receive(key, payload, now_ns)

    watched(load_scenario("ordinary-static"), 1, lambda moment: moment.time_s > FLIGHT_S, Listening)
    assert heard == {"d2", "d3"}
    assert not any(entry.bins for entry in exposures["d1"])
    for drone in ("d2", "d3"):
        live = [entry for entry in exposures[drone] if entry.live_time_s > 0.0]
        assert len(live) > 1.5 * FLIGHT_S
        assert all(len(entry.bins) == 64 and sum(entry.bins) == entry.counts.hits for entry in live)
        first, last = (sum(one.counts.hits for one in some) / len(some) for some in (live[4:10], live[-6:]))
        assert first > 40.0  # in half a second, of the background
        assert last > 2.0 * first  # from 50 m away to around the source
