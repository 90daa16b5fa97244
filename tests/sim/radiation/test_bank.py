"""The bank yields the same results as the full transport."""

import math

import numpy as np
import pytest
from scipy import stats

from radron.sim.radiation import emission
from radron.sim.radiation.bank import BACKGROUND_BIN, DIRECTION_BINS, SCATTERED_BIN, bin_centres, bin_of, near_bin
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.electronics import FLIP_COLUMN, FLIP_ROW, SWAP
from radron.sim.radiation.events import COMPLETE, SCATTERED, SINGLE, Events, simulate
from radron.sim.radiation.timepix3 import response
from support.sensors.event_quality import Clusters, clusters
from support.sensors.partial_bank import ALONE, POLAR_DEG, direction, partial_bank, regroup

LINE = 661.657
SECOND = 1_000_000_000
pytestmark = pytest.mark.slow  # thousands of photons through the full transport


@pytest.fixture(scope="module")
def drawn() -> Events:
    """20,000 events that a Camera drew from the bank, from sources all around at one polar angle."""
    patch = pytest.MonkeyPatch()
    patch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name))
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(5), 0)
    patch.undo()
    turns = np.random.default_rng(6).uniform(0.0, 2.0 * math.pi, 1000)
    views = [[SourceView(direction(POLAR_DEG, turn), 12.0, 3e9)] for turn in turns]
    return regroup([camera.expose(k * SECOND, (k + 1) * SECOND, view) for k, view in enumerate(views)])


@pytest.fixture(scope="module")
def full() -> Events:
    """As many by full transport, directions evenly over the azimuth."""
    cosine = math.cos(math.radians(POLAR_DEG))
    return _without_empty(simulate([(LINE, 1.0)], 20_500, response(ALONE), np.random.default_rng(7), cosine=(cosine, cosine)))


@pytest.fixture(scope="module")
def found(drawn: Events, full: Events) -> tuple[Clusters, Clusters]:
    return clusters(drawn), clusters(full)


def test_cluster_counts(found: tuple[Clusters, Clusters]) -> None:
    table = np.array([np.bincount(np.minimum(one.number, 4), minlength=5) for one in found])
    assert stats.chi2_contingency(table[:, table.sum(axis=0) > 10]).pvalue > 1e-3


def test_probability_of_a_coincidence(found: tuple[Clusters, Clusters]) -> None:
    table = [[(one.number == 2).sum(), (one.number != 2).sum()] for one in found]
    assert stats.chi2_contingency(table).pvalue > 1e-3
    assert np.mean(found[0].number == 2) == pytest.approx(1.38 / 11.7, rel=0.1)


def test_probability_of_a_complete_coincidence(found: tuple[Clusters, Clusters]) -> None:
    complete = [(one.number == 2) & (np.abs(one.energy_kev.sum(axis=1) - LINE) < 45.0) for one in found]
    assert stats.chi2_contingency([[one.sum(), (~one).sum()] for one in complete]).pvalue > 1e-3


@pytest.mark.parametrize("pick", ["single", "double"])
def test_energy_spectra(found: tuple[Clusters, Clusters], pick: str) -> None:
    if pick == "single":
        sums = [one.energy_kev[one.number == 1, 0] for one in found]
    else:
        sums = [one.energy_kev[one.number == 2].sum(axis=1) for one in found]
    assert stats.ks_2samp(*sums).pvalue > 1e-3


def test_pixels_per_event(drawn: Events, full: Events) -> None:
    pixels = [np.diff(one.first) for one in (drawn, full)]
    assert stats.ks_2samp(*pixels).pvalue > 1e-3


def test_camera_turned_to_a_source_above_its_circle_sees_the_true_spectrum() -> None:
    """A camera that circles a source far below or above sees it at one place for minutes: not a few events again and again."""
    polar_deg = 51.0
    patch = pytest.MonkeyPatch()
    patch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name, polar_deg))
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(13), 0)
    patch.undo()
    view = [SourceView(direction(polar_deg, -0.5 * math.pi + 0.02), 12.0, 3e9)]
    drawn = clusters(regroup([camera.expose(k * SECOND, (k + 1) * SECOND, view) for k in range(2000)]))
    true = clusters(_seen(direction(polar_deg, -0.5 * math.pi + 0.02), 40_000))
    energies = [one.energy_kev[one.number == 1, 0] for one in (drawn, true)]
    assert len(energies[0]) > 20_000
    assert stats.ks_2samp(*energies).pvalue > 1e-3


def test_separations_of_coincidences(found: tuple[Clusters, Clusters]) -> None:
    """Across the sensor and in depth."""
    for axis in ("x_mm", "y_mm", "tick"):
        apart = []
        for one in found:
            values = getattr(one, axis)[one.number == 2]
            apart.append(values[:, 0] - values[:, 1])
        assert stats.ks_2samp(*apart).pvalue > 1e-3, axis


def test_places_of_hits_keep_the_direction_of_each_source() -> None:
    """Photons from the side are absorbed nearer to that side: every symmetry must bring them there."""
    bank = partial_bank("Cs-137", 90.0)
    patch = pytest.MonkeyPatch()
    patch.setattr(emission, "load_bank", lambda name, truth: bank)
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(8), 0)
    patch.undo()
    rng = np.random.default_rng(12)
    step = SECOND // 20
    for octant in range(8):
        along, across = [], []
        for k in range(octant * 150, octant * 150 + 150):
            turn = (octant + rng.random()) * math.pi / 4.0
            view = [SourceView(direction(90.0, turn), 2.0, 3e9)]
            hits = camera.expose(k * step, (k + 1) * step, view).hits
            x, y = hits.index % 256 - 127.5, hits.index // 256 - 127.5
            along.append(x * math.cos(turn) + y * math.sin(turn))
            across.append(y * math.cos(turn) - x * math.sin(turn))
        # attenuation times the variance of a uniform place: 0.044/mm x 14.08^2/12 mm2 / 0.055 mm = 13 pixels, less re-absorption
        assert 6.0 < np.concatenate(along).mean() < 15.0
        assert abs(np.concatenate(across).mean()) < 4.0


def test_drawn_directions_are_unbiased() -> None:
    """The mean direction of drawn bins is the source's, wherever it stands in its bin."""
    rng = np.random.default_rng(9)
    for polar_deg, turn in ((60.3, 0.37), (59.1, 2.0), (60.9, -0.02), (61.9, 3.93)):
        true = np.array(direction(polar_deg, turn))
        total = np.zeros(3)
        for _ in range(20_000):
            place, symmetry = near_bin(tuple(true), rng.random(), rng.random())
            total += _turned(_centre(place), symmetry)
        mean = total / np.linalg.norm(total)
        assert math.degrees(math.acos(min(1.0, mean @ true))) < 0.05


def test_every_direction_has_a_bin_near_it() -> None:
    rng = np.random.default_rng(10)
    for _ in range(3000):
        v = rng.normal(size=3)
        v /= np.linalg.norm(v)
        place, symmetry = bin_of(math.acos(v[2]), math.atan2(v[1], v[0]))
        assert 0 <= place < DIRECTION_BINS
        assert math.degrees(math.acos(min(1.0, _turned(_centre(place), symmetry) @ v))) < 1.6
    for v in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
        assert 0 <= near_bin(v, 0.999, 0.0)[0] < DIRECTION_BINS


def test_effective_area_of_each_kind() -> None:
    bank = partial_bank("Cs-137")
    cosine = math.cos(math.radians(POLAR_DEG))
    exact = simulate(
        [(LINE, 0.851)], 200_000, response(ALONE), np.random.default_rng(11), cosine=(cosine, cosine), quota=(0, 0, 0)
    )
    near = [bin_of(math.radians(POLAR_DEG + shift), turn)[0] for shift in (-0.5, 0.5) for turn in np.arange(0.01, 0.78, 0.03)]
    mean = bank.area_mm2[near].mean(axis=0)
    for kind in (SINGLE, SCATTERED, COMPLETE):
        assert mean[kind] == pytest.approx(exact.area_mm2[kind], rel=0.03)


def test_surroundings_have_bins_of_their_own() -> None:
    bank = partial_bank("Cs-137")
    assert len(bank.start) == DIRECTION_BINS + 2
    assert (bank.count[[SCATTERED_BIN, BACKGROUND_BIN]].sum(axis=1) > 3000).all()


_CENTRES = bin_centres()


def _centre(place: int) -> np.ndarray:
    return np.asarray(_CENTRES[place])


def _turned(v: np.ndarray, symmetry: int) -> np.ndarray:
    x, y, z = v
    if symmetry & SWAP:
        x, y = y, x
    return np.array([-x if symmetry & FLIP_COLUMN else x, -y if symmetry & FLIP_ROW else y, z])


def _seen(towards: tuple[float, float, float], interactions: int) -> Events:
    return _without_empty(simulate([(LINE, 1.0)], interactions, response(ALONE), np.random.default_rng(14), direction=towards))


def _without_empty(events: Events) -> Events:
    """Without events that left no pixel."""
    seen = np.flatnonzero(np.diff(events.first))
    begin, end = events.first[seen], events.first[seen + 1]
    assert (begin[1:] == end[:-1]).all()
    return Events(
        events.pixels,
        np.append(begin, end[-1]),
        events.line[seen],
        events.kind[seen],
        events.source[seen],
        events.sites[seen],
        events.area_mm2,
    )
