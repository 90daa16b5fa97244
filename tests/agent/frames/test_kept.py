"""Frames in a state file: writing, reading, and their drift until the log gives them."""

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.drift import Drift
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform, same
from support.flights.one_pilot import MISSION

UNSURE = Transform(0.5, (4.0, 5.0, 0.0), np.diag([0.1, 0.1, 0.1, 0.01]))
KEPT = KeptFrame.of(1, 7, UNSURE, Transform(0.3, (2.0, 1.0, 0.0)))
HERE = (3.0, 4.0, 3.0)


def read(kept):
    return msgspec.json.decode(msgspec.json.encode(kept), type=KeptFrame)


def test_a_frame_is_read_as_it_was_written_with_its_other_explanation():
    assert read(KEPT) == KEPT
    assert same(read(KEPT).mission_from_local, UNSURE)
    assert same(read(KEPT).otherwise.mission_from_local, Transform(0.3, (2.0, 1.0, 0.0)))


def test_an_exact_frame_is_kept_unless_the_mission_tells_it():
    exact = Transform(0.3, (2.0, 1.0, 0.0))
    assert same(read(KeptFrame.of(2, 7, exact)).mission_from_local, exact)
    assert KeptFrame.of(0, 7, exact) is None
    assert KeptFrame.of(1, 7, None) is None


def test_a_frame_of_an_older_release_is_read():
    content = '{"epoch":1,"yaw_rad":0.5,"translation_m":[4.0,5.0,0.0],"covariance":[' + ",".join(["0.1"] * 16) + "]}"
    kept = msgspec.json.decode(content, type=KeptFrame)
    assert kept.mission_from_local.translation == (4.0, 5.0, 0.0)
    assert kept.otherwise is None


def with_variance(value, place=0):
    rows = list(KEPT.covariance)
    rows[place] = value
    return {"covariance": tuple(rows)}


@pytest.mark.parametrize("changes", [
    {"yaw_rad": math.nan}, {"yaw_rad": 1e9}, {"translation_m": (0.0, math.inf, 0.0)}, {"translation_m": (1e6, 0.0, 0.0)},
    with_variance(math.nan), with_variance(math.nan, 1), with_variance(1e300), with_variance(-0.1, 15),
    {"otherwise": replace(KEPT.otherwise, yaw_rad=math.nan)},
], ids=str)  # fmt: skip
def test_what_cannot_be_a_frame_is_none_also_as_a_file_holds_it(changes):
    wrong = replace(KEPT, **changes)
    assert KEPT.is_plausible
    assert not wrong.is_plausible
    assert not read(wrong).is_plausible


@pytest.mark.parametrize("seconds", [12.0, 60.0])
@pytest.mark.parametrize("localization", ["slam", "gnss", "exact"])
def test_a_frame_that_nothing_tells_drifts_as_the_frames_of_the_swarm_do(localization, seconds):
    mission = replace(MISSION, drones=(DroneInMission(id="d1", localization=localization),))
    drift = Drift(mission)
    place, _, _, heading = drift.over(0, seconds, 3.0 * seconds)
    aged = drift.aged("d1", UNSURE, seconds, HERE)
    (before_m, before_rad), (after_m, after_rad) = (one.sigmas_at(HERE) for one in (UNSURE, aged))
    assert after_m == pytest.approx(math.sqrt(before_m**2 + 2.0 * place))
    assert after_rad == pytest.approx(math.hypot(before_rad, math.sqrt(heading)))
    assert (aged.yaw_rad, aged.translation) == (UNSURE.yaw_rad, UNSURE.translation)
    assert (aged is UNSURE) == (localization == "exact")
    if localization == "slam":
        assert after_m - before_m > {12.0: 0.3, 60.0: 1.2}[seconds]


def test_it_does_so_alike_in_one_step_and_in_many_and_not_where_the_clock_was_set_back():
    drift, stepped = Drift(replace(MISSION, drones=(DroneInMission(id="d1", localization="slam"),))), UNSURE
    for before_s, after_s in pairwise(range(0, 13, 3)):
        stepped = drift.aged("d1", stepped, after_s - before_s, HERE)
    assert stepped.covariance == pytest.approx(drift.aged("d1", UNSURE, 12.0, HERE).covariance)
    assert drift.aged("d1", UNSURE, -5.0, HERE) is UNSURE
