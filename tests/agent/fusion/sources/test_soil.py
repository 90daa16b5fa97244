"""Sources over soil: the expected spectra against a simulated camera with a transport code of its own, and the fit."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.windows import Windows
from radron.agent.fusion.bayes.response import REFERENCE_BQ, Channel
from radron.agent.fusion.facing import MEAN_FACING, Facing
from radron.agent.fusion.sources.bins import pooled
from radron.agent.fusion.sources.soil import AS_TABULATED, SOFT, Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import KNOWN, PER_MM2, Spectra
from radron.agent.fusion.sources.tracker import _bins, _response
from radron.protocol.spectrum import BINS

camera = pytest.importorskip("radron.sim.radiation.camera")
truth = pytest.importorskip("radron.sim.radiation.truth")

OVER_SOIL = truth.CameraTruth(scatter_near=0.05, background_hits_per_s=0.3)
LIVE_S, EVENTS_PS = 4.0, 3000.0
SOURCES = [("Cs-137", 12.0, 20.0, 3e9), ("Ir-192", 30.0, 15.0, 5e8)]
MORE, SOFTER = 1.3, 0.35  # scatter of the ground, relative to the tables, and its composition: water's
GROUND = np.array((np.log(MORE), SOFTER))


def compared(nuclide, height_m, horizontal_m, heading_deg):
    """(BINS,) counted by a camera at a height, a source at a horizontal distance, and expected; the softest bins pooled."""
    spectra = Spectra.of((nuclide,), "soil")
    distance, turn = float(np.hypot(height_m, horizontal_m)), np.deg2rad(heading_deg)
    towards = (horizontal_m * np.sin(turn) / distance, -height_m / distance, horizontal_m * np.cos(turn) / distance)
    facing = Facing.of(np.array(towards[2]), np.array(-towards[0]), np.array(1.0), 1.0, 0.0).cosine() - MEAN_FACING
    depth = float(spectra.air_per_m[0]) * distance
    (areas,) = spectra.areas(0.0, 0.0, Sight(depth, float(facing), height_m / distance))
    per_bq = PER_MM2 / REFERENCE_BQ * np.exp(-depth) / distance**2 * areas
    activity_bq = EVENTS_PS / per_bq.sum()
    view = camera.SourceView(tuple(map(float, towards)), distance, activity_bq, camera_m=height_m)
    seen = camera.Camera(OVER_SOIL, nuclide, np.random.default_rng(3), 0, truth.GroundTruth())
    chain, counted = DetectorChain(DetectionConfig(), nuclide, Calibration.nominal()), np.zeros(BINS)
    for k in range(round(100 * LIVE_S)):
        for one in chain.process(seen.expose(k * 10**7, (k + 1) * 10**7, [view], height_m)).spectrum:
            counted[one.place] += one.singles + one.coincidences
    return pooled(counted), LIVE_S * (activity_bq * per_bq + spectra.background_ps(0.0))


@pytest.mark.slow
@pytest.mark.parametrize("nuclide", ["Cs-137", "Co-60", "Ir-192", "Am-241"])
@pytest.mark.parametrize(("height_m", "horizontal_m", "heading_deg"), [(3.0, 6.0, 0.0), (3.0, 6.0, 45.0), (5.0, 12.0, 20.0)])
def test_the_spectrum_over_soil_is_that_of_a_simulated_camera(nuclide, height_m, horizontal_m, heading_deg):
    counted, expected = compared(nuclide, height_m, horizontal_m, heading_deg)
    allowed = 0.2 * expected + 0.002 * expected.sum() + 4.0 * np.sqrt(expected)
    assert (np.abs(counted - expected) < allowed).all()
    assert counted.sum() == pytest.approx(expected.sum(), rel=0.1)


def test_every_nuclide_is_known_over_soil_and_counts_more_there():
    bare, over = Spectra.of(KNOWN), Spectra.of(KNOWN, "soil")
    ratio = over.areas(0.0, 0.0, Sight()).sum(axis=1) / bare.areas(0.0, 0.0, Sight()).sum(axis=1)
    assert (ratio > 1.0).all()
    assert (ratio[[KNOWN.index(name) for name in ("Cs-137", "Co-60", "Na-22", "I-131")]] > 1.8).all()
    assert (over.areas(0.0, 0.0, Sight(0.1, -MEAN_FACING, 1.0)) >= 0.0).all()
    assert over.background_ps(0.0).sum() == pytest.approx(4.4, abs=0.2)  # 1.2 without soil, in these bins


def test_over_nothing_there_is_no_soil():
    spectra = Spectra.of(("Cs-137",))
    assert spectra.soil is None
    assert len(Solution.nothing(2).soil) == 0
    assert spectra.templates(0.0, 0.0).shape == (1, 3, BINS)


def test_ground_of_lighter_elements_scatters_more_soft_photons_by_the_inverse_cube_of_the_energy():
    spectra = Spectra.of(("Cs-137",), "soil")
    soil, water = (spectra.areas(0.0, 0.0, Sight(), np.array((0.0, c)))[0] for c in (0.0, SOFTER))
    direct = spectra.templates(0.0, 0.0)[0, 0]
    by_soil = soil - direct
    assert water - direct == pytest.approx(by_soil * np.exp(SOFTER * SOFT), rel=1e-6)
    assert SOFT[6] == pytest.approx((60.0 / 163.0) ** 3, rel=0.02)  # 151 to 176 keV
    background = [spectra.background_ps(0.0, np.array((0.5, c))) for c in (0.0, SOFTER)]
    assert background[0] == pytest.approx(spectra.background_ps(0.0))  # scatters more, sends out no more
    assert (background[1] > background[0]).all()


def test_a_track_over_soil_expects_the_counts_of_the_fit():
    spectra, bins = Spectra.of(("Cs-137",), "soil"), _bins(Windows(("Cs-137",), DetectionConfig()))
    response = _response(spectra, 0, bins, Channel(1.0, 1.0, 0.0, 1.0, 0.0))
    distance, steepness = 8.0, 0.4
    expected = spectra.areas(0.0, 0.0, Sight(spectra.air_per_m[0] * distance, 0.0, steepness))[0] @ bins
    assert response.signal(np.array(1.0), np.array(distance), steepness) == pytest.approx(expected)
    assert response.background_ps == pytest.approx(spectra.background_ps(0.0) @ bins)


@pytest.fixture(scope="module")
def problem(among):
    """Two drones over soil that scatters more than the tables say."""
    mission = among.mission_of(ground="soil")
    return among.problem_of(mission, among.entries_of(mission, np.random.default_rng(1), 30.0, SOURCES, soil=GROUND))


def somewhere():
    bias = np.array([(0.05, -0.1, 0.02), (-0.1, 0.1, -0.03)])
    places = np.array([(12.5, 19.6), (29.5, 15.3)])
    return Solution((0, 2), places, np.array([1.0, -0.6]), 0.1, bias, 0.004, 0.05, soil=np.array((0.1, 0.15)))


@pytest.mark.parametrize("number", range(15))
def test_the_gradient_over_soil_is_that_of_the_value(problem, number):
    solution, step = somewhere(), np.zeros(15)
    step[number] = 1e-5
    after, before = (problem.value(solution.moved(solution.vector + sign * step)) for sign in (1, -1))
    gradient, _ = problem._scored(solution)[1]()
    assert gradient[number] == pytest.approx((after - before) / 2e-5, rel=1e-4, abs=1e-2)


def test_the_scatter_of_the_ground_is_fitted_and_does_not_change_the_activity(problem):
    """The stated error of the activity includes it, too: with strength and composition known it is smaller."""
    fitted = problem.fitted(replace(somewhere(), scale=0.0, scatter=0.0, soil=AS_TABULATED), 20)
    numbers = fitted.solution.of_sources + np.array((1, 2))
    sigma = np.sqrt(fitted.covariance[numbers, numbers])
    assert np.all(np.abs(fitted.solution.soil - GROUND) < 4.0 * sigma)
    assert np.all(sigma < 0.5 * np.array(problem.prior.soil))
    for k, (_, x, y, becquerel) in enumerate(SOURCES):
        error = [*(fitted.solution.place[k] - (x, y)), fitted.solution.log_activity[k] - np.log(becquerel / 1e9)]
        assert np.all(np.abs(error) < 4.0 * fitted.sigma_of(k))
    information = np.linalg.inv(fitted.covariance)
    known = np.linalg.inv(np.delete(np.delete(information, numbers, 0), numbers, 1))
    assert known[2, 2] < fitted.covariance[2, 2]


@pytest.mark.slow
def test_two_sources_over_water_are_found_and_no_soft_source_beside(among, estimated):
    mission = among.mission_of(ground="soil", moved_s=10.0, nuclides=(*among.NUCLIDES, "Am-241"))
    entries = among.entries_of(mission, np.random.default_rng(4), 40.0, SOURCES, soil=GROUND)
    hypothesis = estimated(mission, entries, 42.0)
    told = sorted((hypothesis, *hypothesis.others), key=lambda one: one.nuclide)
    assert [one.nuclide for one in told] == ["Cs-137", "Ir-192"]
    for one, (_, x, y, becquerel) in zip(told, SOURCES, strict=True):
        assert np.hypot(*(one.position[:2] - (x, y))) < 0.3
        assert one.activity_bq == pytest.approx(becquerel, rel=0.1)
