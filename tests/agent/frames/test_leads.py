"""Satellite fixes that lead the track of an autopilot which follows its receiver."""

import math

import numpy as np
import pytest

from radron.agent.frames.leads import leads_m
from radron.agent.frames.residuals import Fixes
from support.flights.sighted_swarm import SECOND, Drone, fly, run

SPOOFED = {"shift_m": (6.0, -2.5, 0.0), "shift_s": 17.0, "shift_lasts_s": 2.6, "shift_lag_s": 1.0}  # 2.5 m/s
ODOMETRY = {"drift_m": 0.1, "yaw_drift_deg": 0.1, "origin_sigma_m": 2.0}


def fixes(at, lead_m, sigma_m=0.02, yaw_rad=0.0):
    """A fix a second, in a frame with its origin at (3, 2); the last fixes lead the frame."""
    at = np.asarray(at, dtype=float)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    place = at @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + (3.0, 2.0, 0.0)
    place[len(place) - len(lead_m) :, 0] += lead_m
    count = len(at)
    stamps = np.arange(count) * SECOND
    return Fixes(np.zeros(count, dtype=np.int64), stamps, at, place, np.full((count, 3), sigma_m**2), np.ones(count))


def along(count, step_m=3.0):
    return [(step_m * k, 0.0, 5.0) for k in range(count)]


def test_fixes_that_a_track_does_not_follow_lead_it():
    assert leads_m(fixes(along(10), (2.0, 2.5)), 0.0, 0.0) == pytest.approx([0.0] * 8 + [2.0, 2.5])


@pytest.mark.parametrize(
    ("lead_m", "sigma_m", "leads"), [(0.9, 0.02, False), (1.1, 0.02, True), (1.9, 1.0, False), (2.1, 1.0, True)]
)
def test_a_lead_is_more_than_a_filter_corrects_and_than_the_stated_error(lead_m, sigma_m, leads):
    found = leads_m(fixes(along(10), (lead_m,), sigma_m), 0.0, 0.0)
    assert bool(found[-1]) == leads
    assert not found[:-1].any()


def test_a_wrong_heading_of_the_frame_is_no_lead():
    """By a heading that is wrong by 0.03 rad, places 60 m away are 1.8 m from where the fixes have them."""
    turned = fixes([(0.0, 0.0, 5.0)] * 6 + [(60.0, 0.0, 5.0)] * 2, (), yaw_rad=0.03)
    assert leads_m(turned, 0.0, 0.0)[-2:] == pytest.approx(1.8, abs=0.01)
    assert not leads_m(turned, 0.0, 0.02).any()


def test_of_a_few_fixes_none_leads():
    assert not leads_m(fixes(along(3), (5.0,)), 0.0, 0.0).any()


@pytest.mark.parametrize("seed", range(4))
def test_a_receiver_that_is_dragged_away_does_not_take_the_others_along(seed):
    """The only drone with fixes, good to centimetres, slides by 6.5 m in three seconds. The two others know by their odometry
    that they do not slide.
    """
    drones = [Drone("d1", kind="rtk", wander_m=0.02, fixes=True, yaw_sigma_deg=2.0, **SPOOFED)]
    drones += [Drone("d2", yaw_deg=70.0, **ODOMETRY), Drone("d3", yaw_deg=-130.0, **ODOMETRY)]
    flown = fly(drones, 26.0, seed, datum=True)
    frames = run(flown)
    for drone in ("d1", "d2", "d3"):
        off, _ = flown.error(frames, drone, 25.0)
        assert np.hypot(*off[:2]) < 2.0
    assert set(frames.suspects()) == {"d1"}
