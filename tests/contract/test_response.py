"""The emulated vehicle follows setpoints as a real PX4 did (``recordings/README.md``), and its filter errs likewise.

Nothing was fitted to the recordings that are there for checking only. A single run of a real one scatters about its mean by
0.05 s and 0.26 m (SD of lag and radius error of seven runs), by its filter's slow errors; the emulated one scatters as much.
"""

import re
from collections import defaultdict

import numpy as np
import pytest

from radron.sim.vehicle.multirotor import MultirotorTruth
from radron.sim.world.localization import Localization, LocalizationTruth
from support.px4.recorded_series import CHANGED, Recording, fly, is_for_fitting, recordings

SEEDS = 10
LAG_S, RADIUS_M = 0.06, 0.3
WITHOUT_EFFECT = ("ACCHOR8_JERKAUTO20_", "hex_", "rate20Hz_")


def rms(deviation):
    return float(np.sqrt(np.mean(np.sum(np.square(deviation), axis=-1))))


def deviations_m(step_s, flown=None, vehicles=None):
    """Horizontal, rms: true position flown with the recorded errors of the estimate against the recorded one."""
    flown = list(recordings().values()) if flown is None else flown
    times, course, _ = fly(flown, step_s, vehicles=vehicles)
    result = {}
    for recording, time_s, flight in zip(flown, times, course, strict=True):
        known = time_s <= recording.end_s
        result[recording.name] = rms(flight[known, :2] - recording.truth(time_s[known])[:, :2])
    return result


def together(values):
    return float(np.sqrt(np.mean(np.square(list(values)))))


@pytest.mark.parametrize("step_s", [0.01, 0.05])  # the fleet's and the lockstep's
def test_true_positions_follow_all_recordings(step_s):
    deviations = deviations_m(step_s)
    report = "\n".join(f"{deviation:.3f} m {name}" for name, deviation in deviations.items())
    assert len(deviations) == 70
    assert together(deviations.values()) < 0.20, report
    assert together(deviation for name, deviation in deviations.items() if not is_for_fitting(name)) < 0.20, report
    assert max(deviations.values()) < 0.40, report


@pytest.mark.parametrize("changed", ["XYP1.4", "VELP3", "KDV0.3"])
def test_gains_and_drag_are_what_it_depends_on(changed):
    """With the gains and drag of the other recordings, the vehicle goes astray."""
    flown = [recording for recording in recordings().values() if changed in recording.name]
    nominal = [MultirotorTruth(gust_mps2=0.0)] * len(flown)
    assert together(deviations_m(0.05, flown).values()) < 0.20
    assert together(deviations_m(0.05, flown, nominal).values()) > 0.35


def test_heights_follow_climbs():
    flown = [recording for recording in recordings().values() if "climb" in recording.name]
    times, course, _ = fly(flown, 0.01)
    for recording, time_s, flight in zip(flown, times, course, strict=True):
        known = time_s <= recording.end_s
        assert rms(flight[known, 2:3] - recording.truth(time_s[known])[:, 2:3]) < 0.05, recording.name


# Circles, flown by itself


def circle_of(name):
    """Radius and speed; the centre lies as far north of the local origin."""
    radius, speed = re.search(r"_r(\d+)_v(\d+)", name).groups()
    return float(radius), float(speed)


def lag_and_radius_error(recording: Recording, time_s, position):
    """While the reference goes round steadily, in the last lap; of one lap, the last two thirds."""
    radius, speed = circle_of(recording.name)
    centre = (0.0, radius)
    asked = np.unwrap(np.arctan2(recording.setpoints[:, 1] - centre[1], recording.setpoints[:, 0] - centre[0]))
    reference = np.interp(time_s, recording.sent_s, asked)
    rate = np.gradient(reference, time_s)
    sense = np.sign(np.median(rate))
    steady = np.flatnonzero(np.abs(sense * rate * radius / speed - 1.0) < 0.1)
    begin, end = steady[0], steady[-1]
    used = slice(begin + (end - begin) // (3 if abs(asked[-1] - asked[0]) < 3.0 * np.pi else 2), end)
    from_centre = position[used, :2] - centre
    behind = sense * (reference[used] - np.arctan2(from_centre[:, 1], from_centre[:, 0]))
    behind = np.remainder(behind + np.pi, 2.0 * np.pi) - np.pi
    return np.mean(behind) * radius / speed, np.mean(np.hypot(*from_centre.T)) - radius


def kind_of(name):
    """Recordings without an effective difference are one kind; MPC_ACC_HOR has none in offboard, nor have two more rotors."""
    for part in WITHOUT_EFFECT:
        name = name.replace(part, "")
    return name.replace("C_yaw_circle_r12_v3_tangent", "C_circle_r12_v3_pva")


@pytest.fixture(scope="module")
def circles():
    """Lag and radius error by kind, of the recorded runs (K, 2) and of the emulated vehicle's (L, 2), by estimate."""
    flown = [recording for name, recording in recordings().items() if "circle" in name and "jump" not in name]
    step_s = 0.01
    steps = int(max(recording.end_s - recording.begin_s for recording in flown) / step_s) + 1
    errors = localized(SEEDS * len(flown), step_s, steps)
    # The height has drifted before.
    errors[..., 2] -= errors[:, :1, 2]
    times, course, _ = fly(flown * SEEDS, step_s, errors)
    recorded, emulated = defaultdict(list), defaultdict(list)
    for recording in flown:
        time_s = np.arange(recording.begin_s, recording.end_s, 0.05)
        recorded[kind_of(recording.name)].append(lag_and_radius_error(recording, time_s, recording.estimate(time_s)))
    for recording, time_s, flight, error in zip(flown * SEEDS, times, course, errors, strict=True):
        known = time_s <= recording.end_s
        estimated = flight[known, :3] + error[known, :3]
        emulated[kind_of(recording.name)].append(lag_and_radius_error(recording, time_s[known], estimated))
    return {kind: (np.array(runs), np.array(emulated[kind])) for kind, runs in recorded.items()}


def localized(count, step_s, steps):
    """(N, T, 6) errors of position and velocity."""
    localization = Localization(LocalizationTruth(), count, step_s, np.random.default_rng(1))
    errors = np.empty((count, steps, 6))
    for step in range(steps):
        errors[:, step, :3], errors[:, step, 3:] = localization.position_error_m, localization.velocity_error_mps
        localization.step()
    return errors


def compared(circles):
    return "\n".join(
        f"{kind}: {len(runs)} runs {runs.mean(axis=0).round(2)}, own {own.mean(axis=0).round(2)} SD {own.std(axis=0).round(2)}"
        for kind, (runs, own) in circles.items()
    )


def test_circles_that_were_repeated_have_the_recorded_lag_and_radius(circles):
    repeated = {kind: both for kind, both in circles.items() if len(both[0]) > 1}
    assert sorted(len(runs) for runs, _ in repeated.values()) == [3, 4, 5]
    for kind, (runs, own) in repeated.items():
        lag, radius = np.abs(own.mean(axis=0) - runs.mean(axis=0))
        assert lag < LAG_S, f"{kind}\n{compared(circles)}"
        assert radius < RADIUS_M, f"{kind}\n{compared(circles)}"


def test_circles_flown_once_are_runs_that_the_emulated_vehicle_might_have_flown(circles):
    """A single run is not a mean: it may be off by two of the emulated vehicle's own standard deviations more."""
    single = {kind: both for kind, both in circles.items() if len(both[0]) == 1}
    differences = []
    for kind, (runs, own) in single.items():
        differences.append(own.mean(axis=0) - runs[0])
        lag, radius = np.abs(differences[-1]) - 2.0 * own.std(axis=0)
        assert lag < LAG_S, f"{kind}\n{compared(circles)}"
        assert radius < RADIUS_M, f"{kind}\n{compared(circles)}"
    lag, radius = np.abs(np.mean(differences, axis=0))
    assert lag < 0.5 * LAG_S, compared(circles)
    assert radius < 0.5 * RADIUS_M, compared(circles)


def test_runs_scatter_as_recorded(circles):
    """SD of seven recorded runs with acceleration and of four without: 0.05 and 0.01 s, 0.26 and 0.14 m."""
    for kind in ("C_circle_r12_v3_pva", "C_circle_r12_v3_pv"):
        lag, radius = circles[kind][1].std(axis=0)
        assert 0.02 < lag < 0.1
        assert 0.1 < radius < 0.35


def test_true_positions_wander_as_recorded():
    """By their filters' errors vehicles stray from where they would fly without any: 0.43 m an axis, both axes together."""
    flown = [recording for name, recording in recordings().items() if "KDV" not in name]
    step_s = 0.05
    own = localized(len(flown), step_s, int(max(one.end_s - one.begin_s for one in flown) / step_s) + 1)
    times, exact, _ = fly(flown, step_s, np.zeros_like(own))
    _, erring, _ = fly(flown, step_s, own)
    recorded_m, own_m = [], []
    for recording, time_s, without, with_errors in zip(flown, times, exact, erring, strict=True):
        known = (time_s <= recording.end_s) & (time_s > recording.begin_s + 3.0)
        recorded_m.append(rms(without[known, :2] - recording.truth(time_s[known])[:, :2]))
        own_m.append(rms(without[known, :2] - with_errors[known, :2]))
    assert together(own_m) == pytest.approx(together(recorded_m), rel=0.15)


# Pattern of the filter's errors


def memory(errors, lags_s, step_s, first, second):
    """Correlation of two of the errors, the second one so much later; (T, 6) each, their means taken away."""
    result = []
    for lag in (round(lag_s / step_s) for lag_s in lags_s):
        number = sum(np.mean(_pairs(error[:, first], error[:, second], lag)) for error in errors)
        size = sum(np.var(error[:, first]) for error in errors) * sum(np.var(error[:, second]) for error in errors)
        result.append(number / np.sqrt(size))
    return np.array(result)


def _pairs(first, second, lag):
    first, second = first - first.mean(), second - second.mean()
    count = len(first)
    return first[max(0, -lag) : count - max(0, lag)] * second[max(0, lag) : count + min(0, lag)]


def spread(errors, column):
    return float(np.sqrt(np.mean([np.var(error[:, column]) for error in errors])))


@pytest.fixture(scope="module", params=["for fitting", "for checking"])
def errors(request):
    """Of the recordings and of as many vehicles for as long, at 0.05 s."""
    step_s = 0.05
    chosen = [one for name, one in recordings().items() if is_for_fitting(name) == (request.param == "for fitting")]
    recorded = [one.error(np.arange(one.begin_s, one.end_s, step_s)) for one in chosen]
    lengths = [len(error) for error in recorded]
    own = localized(8 * len(chosen), step_s, max(lengths))
    return recorded, [error[:length] for error, length in zip(own, lengths * 8, strict=True)]


@pytest.mark.parametrize("columns", [(0, 1), (2,), (3, 4), (5,)], ids=["position", "height", "velocity", "climb"])
def test_spread_of_the_estimation_error(errors, columns):
    recorded, own = ([spread(some, column) for column in columns] for some in errors)
    assert together(own) == pytest.approx(together(recorded), rel=0.2)


@pytest.mark.parametrize("columns", [(0, 1), (2,), (3, 4), (5,)], ids=["position", "height", "velocity", "climb"])
def test_memory_of_the_estimation_error(errors, columns):
    lags_s = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0)
    recorded, own = (np.mean([memory(some, lags_s, 0.05, column, column) for column in columns], axis=0) for some in errors)
    np.testing.assert_allclose(own, recorded, atol=0.15)


def test_errors_of_position_and_velocity_belong_together(errors):
    """The velocity's comes first, and is far from being the derivative of the position's."""
    lags_s = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
    recorded, own = (np.mean([memory(some, lags_s, 0.05, axis, axis + 3) for axis in (0, 1)], axis=0) for some in errors)
    np.testing.assert_allclose(own, recorded, atol=0.15)


def test_changed_parameters_are_named():
    for part in CHANGED:
        assert any(part in name for name in recordings())
