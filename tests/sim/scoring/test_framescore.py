"""The agents' frames against the true ones: errors, stated uncertainty, suspects, and recovery after a jump."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DatumConfig
from radron.sim.scenario import load_scenario
from radron.sim.scoring.framescore import MAX_RECOVERY_S, FrameScore
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import EventTruth, LiarTruth, SlamTruth, VehicleTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.streams import streams

PLACES = np.array([[10.0, 5.0, 3.0], [20.0, 5.0, 3.0], [15.0, 15.0, 3.0]])
NOTHING = np.zeros((3, 3))


class KnownFrames:
    """Frames as an agent has them: by drone, and at last the true ones of all with offsets."""

    def __init__(self, truth):
        self.truth, self.offsets, self.flagged, self.counted = truth, {}, {}, {}
        self.graph = self

    def mission_from_local(self, drone, epoch):
        place = int(drone[1]) - 1
        if drone not in self.offsets or epoch != self.truth.epoch[place] + self.counted.get(drone, 0):
            return None
        shifted = self.truth.origin[place] + np.array(self.offsets[drone])
        return SimpleNamespace(yaw_rad=float(self.truth.yaw_rad[place]), translation=tuple(shifted.tolist()))

    def suspects(self):
        return self.flagged


def watched(event_s=None, **vehicles):
    still = SlamTruth(drift=0.0, vertical=0.0, yaw_degpm=0.0)
    given = {name: VehicleTruth(kind="slam", yaw_deg=180.0, slam=still) for name in ("d1", "d2", "d3")} | vehicles
    layout = [((6.0 * k, 0.0, 0.0), 0.0) for k in range(3)]
    datum = DatumConfig(latitude_deg=47.0, longitude_deg=8.0)
    truth = MovingFrames(LocalizationTruth(vehicles=given), list(given), layout, datum, 0.05, streams(2, 3))
    known = KnownFrames(truth)
    return FrameScore(load_scenario("no-gnss").mission, known, truth, event_s), known, truth


def test_errors_are_those_of_the_places_by_the_frames_that_are_known():
    score, known, _ = watched()
    known.offsets = {"d1": (0.0, 0.0, 0.0), "d2": (0.3, 0.4, 5.0)}
    errors = score.sample(1.0, True, PLACES, NOTHING)
    assert score.known_s is None
    np.testing.assert_allclose(errors, [[0.0, 0.0, 0.0], [0.3, 0.4, 5.0], [0.0, 0.0, 0.0]], atol=1e-9)
    assert score.error_median_m == pytest.approx(0.25)  # of 0 and 0.5; the third one's is not known
    known.offsets["d3"] = (0.0, 2.0, 0.0)
    score.sample(1.2, True, PLACES, NOTHING)
    score.sample(1.4, True, PLACES, NOTHING)
    assert score.known_s == 1.2
    assert score.error_median_m == pytest.approx(0.5)
    assert score.best_position_error_m == pytest.approx(0.0, abs=1e-9)


def test_a_frame_is_that_of_the_epoch_which_the_drone_itself_tells():
    """Its localisation has jumped and said nothing; its agent has noticed, and counts an epoch more than the vehicle."""
    score, known, _ = watched()
    known.offsets, known.counted = {"d2": (0.3, 0.4, 0.0)}, {"d2": 1}
    score.hear(1, 1)
    np.testing.assert_allclose(score.sample(1.0, True, PLACES, NOTHING)[1], [0.3, 0.4, 0.0], atol=1e-9)


def test_small_errors_of_the_localisation_count_and_nothing_is_scored_before_the_tracking():
    score, known, _ = watched()
    known.offsets = dict.fromkeys(("d1", "d2", "d3"), (0.0, 0.0, 0.0))
    wrong = np.array([[0.6, 0.8, 0.0]] * 3)
    assert score.sample(1.0, False, PLACES, wrong) == pytest.approx(wrong)
    assert (score.error_median_m, score.best_position_error_m, score.known_s) == (None, None, 1.0)
    score.sample(1.2, True, PLACES, wrong)
    assert (score.error_median_m, score.best_position_error_m) == pytest.approx((1.0, 1.0))


def test_the_best_drone_is_the_one_whose_own_localisation_errs_least():
    score, _, truth = watched(d2=VehicleTruth(kind="rtk"), d3=VehicleTruth(kind="gnss"), d1=VehicleTruth(kind="gnss"))
    for step in range(40):
        truth.step(0.05 * step, PLACES)
        score.sample(0.05 * step, True, PLACES, NOTHING)
    assert score.best_position_error_m == pytest.approx(np.hypot(*truth.own_error_m(PLACES)[1, :2]), abs=0.01)


def test_who_is_suspected_most_of_the_time_is_named():
    score, known, _ = watched()
    for k in range(10):
        known.flagged = {"d3": "contradicts the sightings"} | ({"d1": "not known yet"} if k < 4 else {})
        score.sample(0.2 * k, True, PLACES, NOTHING)
    assert score.suspects == "d3"


def test_how_long_it_takes_to_get_over_an_event():
    def after(errors, before=0.5):
        score, _, _ = watched(event_s=90.0)
        for k in range(50):
            score.follow(80.0 + 0.2 * k, before)
        for k, error in enumerate(errors):
            score.follow(90.0 + 0.2 * k, error)
        return score.recovery_s

    assert after([1.0] * 100) == 0.0
    assert after([1.0] * 10 + [8.0] * 20 + [1.0] * 50) == pytest.approx(5.8)
    assert after([1.0] * 10 + [8.0] * 20 + [None] * 5 + [1.0] * 50) == pytest.approx(6.8)  # no hypothesis is no good one
    assert after([5.0] * 20 + [1.0] * 50, before=2.6) == 0.0  # twice the error before is allowed
    assert after([8.0] * 400) == MAX_RECOVERY_S
    assert after([]) is None
    assert watched()[0].recovery_s is None


def test_the_event_is_the_first_thing_that_happens_to_any_frame():
    nothing = LocalizationTruth()
    assert nothing.event_s is None
    two = {
        "d1": VehicleTruth(kind="slam", events=(EventTruth(at_s=120.0, jump_m=3.0),)),
        "d2": VehicleTruth(kind="gnss", events=(EventTruth(at_s=90.0, switch_to="slam"), EventTruth(at_s=99.0, jump_m=1.0))),
    }
    assert replace(nothing, vehicles=two).event_s == 90.0
    assert replace(nothing, vehicles=two, liar=LiarTruth(at_s=60.0)).event_s == 60.0
    assert replace(nothing, vehicles=two, liar=LiarTruth()).event_s == 90.0  # lies from the start on: nothing is to be got over
