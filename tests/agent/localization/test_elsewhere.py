"""Retraction of a drone's measurements before an unannounced jump of its localisation, as far back as it may have slid."""

import numpy as np
import pytest

from radron.agent.config.drone import DroneConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.agent.frames.transform import Transform
from radron.agent.localization.knownframe import SLIDE_MPS, KnownFrame
from radron.agent.vehicle.interface import SeenDrone
from radron.protocol.entries import Exposure, Retraction, Sighting
from support.flights.members import AUTHORITY
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, boot_of, messages, nonce_key_of, pilot, state

HITS = 1_000_000 * np.arange(1, 4)  # of each readout, in pixels that differ: none is taken for noisy, and the camera not for mute
JUMPED_S, FLOWN_S = 15.0, 20.0


def hits(tick):
    pixels = (7919 * (tick + np.arange(3))) % 65536
    return PixelHits(HITS, pixels.astype(np.uint16), np.full(3, 80, np.uint16))


def flown(one, jump_m, back_m=0.0, epoch=0, before_m=None, set_back_s=0):
    """Retractions published in 20 s of hovering.

    ``jump_m``: by which the localisation jumps after 15 s, into that epoch of the vehicle's; ``back_m``: back again after 16 s;
    ``before_m``: place to which it jumps first, half a step earlier. ``set_back_s``: by which its clock is set back after 17 s.
    """
    told = []
    for tick in range(round(FLOWN_S * 20)):
        now_ns, x = START_NS + tick * TICK_NS, 0.0
        if tick >= (JUMPED_S + 2.0) * 20:
            one.observe_clock(-set_back_s * SECOND, now_ns)
        if tick == JUMPED_S * 20 and before_m is not None:
            one.observe_vehicle(state(now_ns - TICK_NS // 2, position=(before_m, 0.0, 3.0)))
        if tick >= JUMPED_S * 20:
            x = jump_m - (back_m if tick >= (JUMPED_S + 1.0) * 20 else 0.0)
        one.observe_vehicle(state(now_ns, position=(x, 0.0, 3.0), epoch=epoch if tick >= JUMPED_S * 20 else 0))
        if tick % 4 == 0 and tick:
            one.observe_detector(Readout(now_ns - 4 * TICK_NS, now_ns, now_ns - 4 * TICK_NS, 0.2, hits(tick)))
        one.advance(now_ns)  # as its shell does where messages have come
        told += messages(one.step(now_ns), Retraction)
    return told


def counting_s(one):
    """Stamps (s) of the exposures that count."""
    log = one.fusion.log
    return [1e-9 * (exposure.stamp_ns - START_NS) for exposure in log.entries(Exposure) if log.counts(exposure.entry_id)]


@pytest.mark.parametrize("jump_m", [4.0, 9.0])
def test_as_far_as_it_may_have_slid(jump_m):
    one = pilot()
    assert len(flown(one, jump_m)) == 1
    stamps_s = counting_s(one)
    before_s = [stamp_s for stamp_s in stamps_s if stamp_s < JUMPED_S]
    after_s = [stamp_s for stamp_s in stamps_s if stamp_s >= JUMPED_S]
    first_s = JUMPED_S - jump_m / SLIDE_MPS
    assert before_s[0] == 0.0
    assert first_s - 2.5 < before_s[-1] < first_s  # numbers are noted once a second, and exposures get theirs when they end
    assert after_s[0] == pytest.approx(JUMPED_S, abs=0.2)  # from the first readout on that begins then
    assert after_s[-1] > FLOWN_S - 1.5


def test_all_of_it_where_the_jump_is_wide():
    one = pilot()
    flown(one, 40.0)
    assert min(counting_s(one)) >= JUMPED_S


@pytest.mark.parametrize(("jump_m", "slid_s"), [(12.0, 12.0), (300.0, 30.0)])
def test_of_half_a_minute_at_most(jump_m, slid_s):
    """A localisation that jumps by hundreds of metres is rather wrong from then on."""
    frame, before, after = KnownFrame(), state(START_NS), state(START_NS + TICK_NS, position=(jump_m, 0.0, 3.0))
    frame.after_jump(Transform(), before, after, 0.0, announced=False)
    assert frame.elsewhere is not None
    assert 1e-9 * (frame.elsewhere[1] - frame.elsewhere[0]) == pytest.approx(slid_s)


def test_once_for_a_jump_and_not_when_it_is_undone():
    assert len(flown(pilot(), 9.0, back_m=9.0)) == 1


def test_of_two_jumps_between_two_steps_as_far_as_the_wider_one():
    one = pilot()
    assert len(flown(one, 17.0, before_m=12.0)) == 1
    assert 0.0 < max(stamp_s for stamp_s in counting_s(one) if stamp_s < JUMPED_S) < JUMPED_S - 12.0 / SLIDE_MPS


def test_nothing_of_a_jump_that_is_undone_before_the_next_step():
    one = pilot()
    assert flown(one, 0.0, before_m=40.0) == []
    assert min(counting_s(one)) == 0.0


def test_a_localisation_that_jumps_all_the_time_has_nothing_taken_back_again_and_again():
    """Once it jumps often nothing is measured by it any more: there were 20 retractions a second of nothing but retractions."""
    one, told = pilot(), []
    flown(one, 0.0)
    for tick in range(200):
        now_ns = START_NS + round(FLOWN_S * SECOND) + tick * TICK_NS
        one.observe_vehicle(state(now_ns, position=(12.0 * (tick + 1), 0.0, 3.0)))
        told += messages(one.step(now_ns), Retraction)
    assert [entry.last - entry.first > 10 for entry in told] == [True]
    assert max(counting_s(one)) < FLOWN_S - 11.0


def test_what_is_measured_between_two_jumps_is_taken_back_too():
    one = pilot()
    first, second = flown(one, 30.0, back_m=12.0)
    assert (first.first, first.last, second.first) == (1, first.last, first.sequence + 1)
    assert not [stamp_s for stamp_s in counting_s(one) if stamp_s < JUMPED_S + 1.0]


def test_what_is_measured_after_the_clock_was_set_back_counts():
    """The measurements were dropped until the time of the jump had come again: for a minute here."""
    one = pilot()
    assert len(flown(one, 4.0, set_back_s=60)) == 2
    assert any(stamp_s < 0.0 for stamp_s in counting_s(one))


def test_what_was_measured_before_but_not_logged_yet_is_dropped():
    """Readouts and sightings come late. Here nothing has been logged before the jump, so there is nothing to take back."""
    one, jump_ns = pilot(), START_NS + 10 * TICK_NS
    for tick in range(40):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, position=(9.0 if now_ns >= jump_ns else 0.0, 0.0, 3.0)))
        if tick % 4 == 0 and tick:
            one.observe_detector(Readout(now_ns - 4 * TICK_NS, now_ns, now_ns - 4 * TICK_NS, 0.2, hits(tick)))
        if tick in (15, 16):
            stamp_ns = now_ns - 5 * TICK_NS - TICK_NS // 2
            one.observe_sightings([SeenDrone(stamp_ns=stamp_ns, target="d2", range_m=6.0, range_sigma_m=0.1)])
        assert not messages(one.step(now_ns), Retraction)
    log = one.fusion.log
    assert [sighting.stamp_ns for sighting in log.entries(Sighting)] == [jump_ns + TICK_NS // 2]
    assert [exposure.stamp_ns >= jump_ns for exposure in log.entries(Exposure)] == [True, True]


def test_nothing_of_an_announced_jump_or_without_one():
    for jump_m, epoch in ((9.0, 1), (0.0, 0)):
        one = pilot()
        assert flown(one, jump_m, epoch=epoch) == []
        assert len(counting_s(one)) > (FLOWN_S - 2.0) / 0.6


def test_in_a_replay_it_is_signed_as_in_flight(tmp_path):
    """Messages published with a step are signed in it: only there the replay has the signature."""
    trust, boot = AUTHORITY.trust("d1"), boot_of("d1")
    header = FlightHeader.of(MISSION, DroneConfig(id="d1"), boot, START_NS, None, trust, nonce_key=nonce_key_of(boot))
    recorder = FlightRecorder(tmp_path, 100, header)
    assert len(flown(RecordedPilot(header.pilot(tmp_path, trust), recorder), 9.0)) == 1
    recorder.close()
    assert replay(tmp_path).identical
