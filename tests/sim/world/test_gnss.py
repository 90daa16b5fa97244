"""Satellite receivers: errors of the given size and correlation, outages, jumps, and geodetic fixes."""

import numpy as np
import pymap3d
import pytest

from radron.agent.config.mission import DatumConfig
from radron.sim.world.gnss import RTK, GnssTruth, Receiver

DATUM = DatumConfig(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)


def receivers(truth, count, step_s=1.0):
    return [Receiver(truth, DATUM, step_s, np.random.default_rng([7, k])) for k in range(count)]


def errors(sky):
    return np.array([receiver.error_m for receiver in sky])


def test_errors_wander_with_the_given_size_and_memory():
    sky = receivers(GnssTruth(correlation_s=60.0), 600)
    first = errors(sky)
    for receiver in sky:
        for _ in range(60):
            receiver.step()
    then = errors(sky)
    for moment in (first, then):
        assert moment.std(axis=0) == pytest.approx([1.0, 1.0, 1.5], rel=0.1)  # 3 sigma of 600 draws is 9 %
    assert np.corrcoef(first[:, 0], then[:, 0])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.12)


def test_fixes_lie_where_the_drone_is_but_for_the_error():
    place = np.array([40.0, -30.0, 12.0])
    for truth, sigmas in ((GnssTruth(), (1.04, 1.52)), (RTK, (0.02, 0.033))):
        sky, offsets, told = receivers(truth, 400, step_s=1.0), [], None
        for receiver in sky:
            fix = receiver.fix(5, place)
            assert fix is not None
            assert fix.stamp_ns == 5
            told = fix
            east, north, up = pymap3d.geodetic2enu(
                fix.latitude_deg, fix.longitude_deg, fix.altitude_m, DATUM.latitude_deg, DATUM.longitude_deg, DATUM.altitude_m
            )
            offsets.append((east, north, up) - place)
        spread = np.std(offsets, axis=0)
        assert (spread[:2].mean(), spread[2]) == pytest.approx(sigmas, rel=0.12)
        assert (told.horizontal_sigma_m, told.vertical_sigma_m) == pytest.approx((2.0**0.5 * sigmas[0], sigmas[1]), rel=0.12)


def test_fixes_come_at_their_rate_and_not_all_at_once():
    moments = []
    for receiver in receivers(GnssTruth(rate_hz=1.0), 8, step_s=0.05):
        came = []
        for step in range(100):
            receiver.step()
            if receiver.fix(0, np.zeros(3)) is not None:
                came.append(step)
        assert np.diff(came).tolist() == [20] * (len(came) - 1)
        assert len(came) == 5
        moments.append(came[0])
    assert len(set(moments)) > 3


def test_outages_come_and_go_and_a_lost_receiver_is_silent():
    out = 0
    sky = receivers(GnssTruth(available_s=20.0, outage_s=5.0), 100)
    for receiver in sky:
        for _ in range(100):
            receiver.step()
            out += not receiver.available
            assert (receiver.fix(0, np.zeros(3)) is None) == (not receiver.available)
    assert out / 1e4 == pytest.approx(0.2, abs=0.04)
    sky[0].lost = True
    assert not sky[0].available
    assert sky[0].fix(0, np.zeros(3)) is None


def test_reflected_signals_shift_a_receiver_for_a_while():
    quiet = GnssTruth(horizontal_m=0.0, vertical_m=0.0, undisturbed_s=30.0, jump_m=5.0, jump_s=10.0)
    course = []
    for receiver in receivers(quiet, 100):
        for _ in range(150):
            receiver.step()
            course.append(receiver.error_m)
    off = np.hypot(*np.array(course)[:, :2].T)
    assert (off > 0.0).mean() == pytest.approx(0.25, abs=0.05)
    assert np.sqrt((off[off > 0.0] ** 2).mean()) == pytest.approx(5.0 * 2.0**0.5, rel=0.15)
