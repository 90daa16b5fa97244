"""The chain on events that the simulation transported through the sensor, against the true events."""

import numpy as np
import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.imaging import DirectionScan

event_readout = pytest.importorskip("support.sensors.event_readout")
events = pytest.importorskip("radron.sim.radiation.events")
timepix3 = pytest.importorskip("radron.sim.radiation.timepix3")
truth = pytest.importorskip("radron.sim.radiation.truth")

LINE = ((661.657, 0.851),)


def simulate(interactions, seed, **beam):
    camera = timepix3.response(truth.CameraTruth())
    return events.simulate(
        LINE, interactions, camera, np.random.default_rng(seed), quota=(interactions // 20, *[interactions] * 2), **beam
    )


def detect(simulated, nuclide="Cs-137"):
    """Detections of the events, which follow each other at equal intervals."""
    return DetectorChain(DetectionConfig(), nuclide, Calibration.nominal()).process(event_readout.readout_of(simulated))


@pytest.fixture(scope="module")
def isotropic():
    simulated = simulate(200_000, 8)
    return simulated, detect(simulated).cones


@pytest.fixture(scope="module")
def readings(isotropic):
    """Per cone: which order is true; ARM, sigma, theta and energy error of that order; and the probability of order 1."""
    simulated, cones = isotropic
    rows = []
    for cone in cones:
        event = cone.stamp_ns // event_readout.SPACING_NS
        first, second = simulated.sites[event]
        order = 0 if cone.axis[0] @ (first[:3] - second[:3]) > 0.0 else 1
        arm = np.arccos(np.clip(cone.axis[order] @ simulated.source[event], -1, 1)) - cone.theta_rad[order]
        energy_error = cone.energies_kev[order] - first[3]
        rows.append((order, arm, cone.sigma_rad[order], cone.theta_rad[order], energy_error, cone.probability[0]))
    return np.array(rows)


def test_most_cones_hold_the_true_first_scatter(readings):
    energy_error = readings[:, 4]
    assert len(readings) > 3000
    assert (np.abs(energy_error) < 40.0).mean() > 0.9


def test_the_angular_resolution_is_that_of_the_reference(readings):
    """At 30 degrees 68 % within 6.3 degrees, or better."""
    _, arm, _, theta, energy_error, _ = readings.T
    near = (np.abs(np.rad2deg(theta) - 30.0) < 10.0) & (np.abs(energy_error) < 40.0)
    assert near.sum() > 200
    assert 4.0 < np.rad2deg(np.quantile(np.abs(arm[near]), 0.68)) < 6.5


@pytest.mark.parametrize("degrees", [(15, 50), (50, 90), (90, 130), (130, 180)])
def test_sigma_is_the_width_of_the_cone(readings, degrees):
    _, arm, sigma, theta, energy_error, _ = readings.T
    part = (np.rad2deg(theta) > degrees[0]) & (np.rad2deg(theta) < degrees[1]) & (np.abs(energy_error) < 40.0)
    pull = np.abs(arm[part]) / sigma[part]
    assert np.quantile(pull, 0.68) == pytest.approx(1.0, abs=0.15)
    assert np.quantile(pull, 0.95) < 3.5


def test_a_reading_beyond_the_edge_points_where_such_events_come_from(readings):
    """Resolution and Doppler broadening put them there; by the energy alone all would have scattered straight back."""
    _, arm, sigma, theta, energy_error, _ = readings.T
    beyond = (np.rad2deg(theta) > 150.0) & (np.abs(energy_error) < 40.0)
    assert beyond.sum() > 300
    assert abs(np.rad2deg(np.median(arm[beyond]))) < 4.0
    assert np.quantile(np.abs(arm[beyond]) / sigma[beyond], 0.68) == pytest.approx(1.0, abs=0.2)


def test_probabilities_are_frequencies(readings):
    """In each tenth of the stated probability, the share of cones whose first order is true."""
    order, probability = readings[:, 0], readings[:, 5]
    stated = np.concatenate((probability, 1.0 - probability))  # either order may be asked for
    true = np.concatenate((order == 0, order == 1))
    for low in np.arange(0.0, 1.0, 0.1):
        part = (stated >= low) & (stated < low + 0.1)
        assert part.sum() > 100
        noise = np.sqrt(0.25 / part.sum())
        assert true[part].mean() == pytest.approx(stated[part].mean(), abs=0.05 + 2.0 * noise)


def test_probabilities_beat_the_later_time_of_arrival(readings):
    order, probability = readings[:, 0], readings[:, 5]
    right = ((probability > 0.5) == (order == 0)).mean()
    assert right > 0.75  # by the time of arrival alone about half


@pytest.mark.parametrize("polar_deg", [0.0, 60.0, 90.0, 180.0])
def test_the_source_is_where_it_was(polar_deg):
    polar = np.deg2rad(polar_deg)
    source = (np.sin(polar), 0.0, np.cos(polar))
    scan = DirectionScan()
    scan.add(detect(simulate(30_000, 9, direction=source)).cones)
    best = scan.best()
    assert best is not None
    off = np.arccos(np.clip(best.unit @ np.array(source), -1, 1))
    assert off < 3.0 * max(best.sigma_rad, np.deg2rad(0.5))
    assert np.rad2deg(best.sigma_rad) < 3.0


def test_sigma_grows_with_the_tracks_of_energetic_electrons():
    """Co-60: an electron of 1 MeV runs half a millimetre; the widths set for Cs-137 would be too small by half."""
    camera = timepix3.response(truth.CameraTruth())
    lines = ((1173.23, 1.0),)
    simulated = events.simulate(lines, 300_000, camera, np.random.default_rng(8), quota=(0, 300_000, 300_000))
    pull = []
    for cone in detect(simulated, "Co-60").cones:
        event = cone.stamp_ns // event_readout.SPACING_NS
        first, second = simulated.sites[event]
        order = 0 if cone.axis[0] @ (first[:3] - second[:3]) > 0.0 else 1
        if abs(cone.energies_kev[order] - first[3]) < 40.0:
            arm = np.arccos(np.clip(cone.axis[order] @ simulated.source[event], -1, 1)) - cone.theta_rad[order]
            pull.append(abs(arm) / cone.sigma_rad[order])
    assert len(pull) > 1000
    assert np.quantile(pull, 0.68) == pytest.approx(1.0, abs=0.2)
