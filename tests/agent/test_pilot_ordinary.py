"""A pilot with an ordinary detector: its exposures, and what it tells of a faulty device."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.drone import DetectorConfig, DroneConfig
from radron.agent.config.estimators import FusionConfig, GivenHypothesisConfig
from radron.agent.config.loading import with_files
from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError
from radron.agent.flight.topics import decode_readout, encode_readout
from radron.agent.pilot import Pilot
from radron.protocol.codec import decode_from
from radron.protocol.entries import Exposure
from radron.protocol.messages import Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, boot_of, messages, nonce_key_of, state


def mission_of(detector: str = "spectrum", response: str = "nai-2x2") -> MissionConfig:
    drones = (DroneInMission(id="d1", detector=detector, response=response), DroneInMission(id="d2"))
    fusion = FusionConfig(estimator="given", given=GivenHypothesisConfig(schedule=((0.0, 20.0, 20.0),)))
    return with_files(replace(MISSION, fusion=fusion, drones=drones), Path())


def pilot(mission: MissionConfig, **detector: object) -> Pilot:
    kind = mission.member("d1").detector
    boot = boot_of("d1")
    drone = DroneConfig(id="d1", detector=DetectorConfig(**{"kind": kind, **detector}))
    return Pilot(mission, drone, boot=boot, nonce_key=nonce_key_of(boot))


def told(one: Pilot, counts_of, seconds: int = 10, period_ns: int = SECOND, live_s: float = 0.9):
    """The last status and all exposures with live time, of readouts with these counts."""
    status, exposures = None, []
    for k in range(seconds * SECOND // period_ns):
        start_ns = START_NS + k * period_ns
        now_ns = start_ns + period_ns
        for tick in range(period_ns // TICK_NS):
            one.observe_vehicle(state(start_ns + tick * TICK_NS, armed=False, in_air=False))
        counts = counts_of(k)
        if counts is not None:
            readout = Readout(start_ns, now_ns, start_ns, live_s * period_ns * 1e-9, PixelHits.none(), counts=np.array(counts))
            recorded = decode_readout(encode_readout(readout))  # as in a flight record
            published = one.observe_detector(recorded)
            exposures += [entry for key, payload in published if isinstance(entry := decode_from(key, payload), Exposure)]
        step = one.step(now_ns)
        status = (messages(step, Status) or [status])[-1]
    return status, [one for one in exposures if one.live_time_s > 0.0]


@pytest.mark.parametrize("period_ns", [SECOND, SECOND // 5])
def test_exposures_carry_the_counts_by_channel(period_ns: int) -> None:
    mission = mission_of()
    status, exposures = told(pilot(mission), lambda k: [1] * 63 + [k], period_ns=period_ns)
    assert len(exposures) >= 9
    for exposure in exposures:
        assert len(exposure.bins) == 64
        assert sum(exposure.bins) == exposure.counts.hits
        duration_s = (exposure.end_ns - exposure.stamp_ns) * 1e-9
        assert exposure.live_time_s == pytest.approx(0.9 * duration_s)
        assert exposure.bins[0] == round(duration_s * SECOND / period_ns)
    assert not [problem for problem in status.problems if problem.startswith(("camera", "detector"))]


def test_wrong_number_of_channels_is_told_counted_and_dropped() -> None:
    status, exposures = told(pilot(mission_of()), lambda k: [1] * 100)
    assert not exposures
    assert "detector: spectra of 100 channels, its table of response has 64; give detector.energy_kev" in status.problems
    assert status.counters["readouts_unusable"] == 10


def test_saturated_counter_is_told_and_not_used() -> None:
    one = pilot(mission_of("counts", "gm-sbm20"), dead_time_us=190.0)
    status, exposures = told(one, lambda k: [5200])
    assert not exposures
    assert "detector: dead for 99% of the time; its counts are not used" in status.problems


def test_quiet_counter_is_not_taken_for_a_dead_one() -> None:
    """A tube counts 0.3 a second of background: 15 s without a count are one in ninety."""
    status, exposures = told(pilot(mission_of("counts", "gm-sbm20")), lambda k: [k % 15 == 0], seconds=30)
    assert sum(one.live_time_s for one in exposures) > 25.0
    assert not [problem for problem in status.problems if problem.startswith("detector")]


def test_silent_device_is_told() -> None:
    status, _ = told(pilot(mission_of()), lambda k: [1] * 64 if k < 5 else None, seconds=20)
    assert "detector: it delivers nothing any more" in status.problems


@pytest.mark.parametrize(("wanted", "kind"), [("spectrum", "minipix"), ("counts", "spectrum")])
def test_drone_file_and_mission_name_the_same_kind(wanted: str, kind: str) -> None:
    mission = mission_of(wanted, {"spectrum": "nai-2x2", "counts": "gm-sbm20"}[wanted])
    with pytest.raises(ConfigError, match=rf"detector\.kind = '{kind}' in the drone file of d1, but '{wanted}' in the mission"):
        pilot(mission, kind=kind)
