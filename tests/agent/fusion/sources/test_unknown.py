"""Sources of nuclides that are not among the candidates."""

import numpy as np
import pytest

from radron.agent.fusion.facing import MEAN_FACING
from radron.agent.fusion.sources.fit import Fitted, Prior
from radron.agent.fusion.sources.moves import Moves
from radron.agent.fusion.sources.soil import Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import Spectra, UnknownSpectrum
from radron.agent.fusion.sources.unknown import Measured, _seen, explained, lines_kev, only_told

CHANCE_MM2 = 0.05  # of a spectrum's areas: that of about 2,000 events of Cs-137 a few metres away


def prior():
    zeros = np.zeros(2)
    return Prior(np.ones((1, 3)), 0.3, 0.03, 0.15, zeros, zeros, (-3.0, 8.0), 1e4, 1.5)


def measured(shape, rng):
    area = shape + rng.normal(0.0, CHANCE_MM2, len(shape))
    return Measured(np.maximum(area, 1e-9), np.full(len(shape), CHANCE_MM2), np.full(len(shape), 1e-3), 7.0, 0.3)


def shapes(candidates, scale=0.0, scatter=0.0):
    return _seen(measured(np.ones(32), np.random.default_rng(1)), Spectra.of(candidates), scale, scatter)


ALL = ("Am-241", "Ba-133", "Co-57", "Co-60", "Cs-137", "Eu-152", "F-18", "I-131", "Ir-192", "Na-22", "Se-75")


@pytest.mark.parametrize("name", ALL)
def test_each_candidate_explains_its_own_spectrum_and_no_two_others_do(name):
    """Also where the camera reads energies that are 1 % too high and more is scattered than assumed."""
    rng = np.random.default_rng(3)
    (shape,) = shapes((name,), 0.01, 0.1)
    seen, others = measured(shape, rng), tuple(other for other in ALL if other != name)
    own = explained(seen, Spectra.of(ALL), prior())
    assert own.misfit < 30.0
    assert ALL.index(name) in own.nuclides
    assert explained(seen, Spectra.of(others), prior()).misfit > 60.0


@pytest.mark.parametrize("name", ["Cs-137", "Co-60", "I-131", "Am-241", "Se-75"])
def test_a_candidate_explains_its_spectrum_over_water_without_a_second_one(name):
    """With the strength of the scatter alone, the misfit was 47 to 68, but for Am-241: above 40 a source stays unknown."""
    spectra, none = Spectra.of((name,), "soil"), measured(np.ones(32), np.random.default_rng(1))
    (shape,) = _seen(none, spectra, 0.01, 0.0, np.array((0.26, 0.35)))
    assert explained(measured(shape, np.random.default_rng(3)), spectra, prior()).misfit < 30.0


def test_a_peak_of_which_nothing_was_counted_by_chance_does_not_make_a_nuclide_unknown():
    """Of 24 events that are expected in all, 2 or 3 in the peak: of none there the error is not that of none."""
    (shape,) = shapes(("Co-60",))
    peak = int(shape[28:].argmax()) + 28
    chance = np.sqrt((shape + 1e-3) * shape.sum() / 24.0)
    area = shape.copy()
    area[peak], chance[peak] = 1e-9, np.sqrt(1e-3 * shape.sum() / 24.0)
    seen = Measured(area, chance, np.full(32, 1e-3), 7.0, 0.3)
    assert explained(seen, Spectra.of(("Co-60",)), prior()).misfit < 10.0


def test_two_nuclides_at_one_place_are_not_an_unknown_one():
    shape = np.array([1.0, 0.4]) @ shapes(("Cs-137", "Co-60"))
    found = explained(measured(shape, np.random.default_rng(4)), Spectra.of(ALL), prior())
    assert found.misfit < 30.0
    assert {ALL[n] for n in found.nuclides} == {"Cs-137", "Co-60"}
    assert sorted(found.activity) == pytest.approx([0.4, 1.0], rel=0.1)


def test_a_spectrum_that_is_explained_well_enough_is_explained_no_further():
    (shape,) = shapes(("Cs-137",), 0.02, 0.1)
    seen = measured(shape, np.random.default_rng(5))
    best, first = (explained(seen, Spectra.of(ALL), prior(), enough) for enough in (0.0, 80.0))
    assert best.misfit < first.misfit <= 80.0


@pytest.mark.parametrize(("name", "lines"), [("Se-75", (136, 265, 401)), ("Cs-137", (662,)), ("F-18", (511,)), ("Am-241", (60,))])
def test_lines_are_told_to_half_a_bin(name, lines):
    (shape,) = shapes((name,))
    assert lines_kev(measured(shape, np.random.default_rng(5))) == pytest.approx(lines, abs=20)


def test_an_unknown_spectrum_is_seen_as_it_was_measured():
    """At the same distance and heading, but for its strength."""
    (shape,) = shapes(("Se-75",))
    seen = measured(shape, np.random.default_rng(6))
    spectra = Spectra.of(("Cs-137",)).plus([UnknownSpectrum.measured(seen.area, Sight(7.0 * 0.0093, seen.facing), ())])
    again = _seen(seen, spectra, 0.0, 0.0)[1]
    assert again / again.sum() == pytest.approx(seen.area / seen.area.sum(), abs=2e-3)
    assert (spectra.name_of(0), spectra.name_of(1), spectra.lines_of(0), spectra.lines_of(1)) == ("Cs-137", None, None, ())
    assert spectra.facing(0.0)[1].min() > -1.0 / (1.0 - MEAN_FACING)


def test_spectra_of_which_there_is_no_source_are_forgotten():
    unknown = [UnknownSpectrum(np.full(32, 0.5), (kev,)) for kev in (100, 200, 300)]
    spectra = Spectra.of(("Cs-137", "Co-60")).plus(unknown)
    solution = Solution((4, 1, 2), np.zeros((3, 2)), np.zeros(3), 0.0, np.zeros((1, 3)))
    kept, left = only_told(Fitted(solution, 0.0, np.eye(13), 0.0), spectra)
    assert [left.lines_of(n) for n in kept.solution.nuclide] == [(300,), None, (100,)]
    assert len(left.unknown) == 2


def test_a_source_that_no_candidate_explains_is_told_once_with_its_place_and_lines(among, estimated, monkeypatch):
    """Co-60 beside a source of a nuclide that is among the candidates. No step takes more than one search."""
    improved, turns = Moves.improved, []
    monkeypatch.setattr(Moves, "improved", lambda self, start, turn: (turns.append(turn), improved(self, start, turn))[1])
    mission = among.mission_of(nuclides=("Cs-137", "Ir-192"), moved_s=10.0)
    sources = [("Co-60", 14.0, 22.0, 3e9), ("Ir-192", 31.0, 12.0, 1e9)]
    hypothesis = estimated(mission, among.entries_of(mission, np.random.default_rng(7), 40.0, sources), 42.0)
    (nameless,) = [one for one in (hypothesis, *hypothesis.others) if one.lines_kev is not None]
    (known,) = [one for one in (hypothesis, *hypothesis.others) if one.lines_kev is None]
    assert (nameless.nuclide, nameless.activity_bq, nameless.activity_sigma_bq) == (None, None, None)
    assert nameless.lines_kev[-1] == pytest.approx(1332, abs=40)
    assert known.nuclide == "Ir-192"
    for one, (_, x, y, _) in zip((nameless, known), sources, strict=True):
        sigma_m = np.sqrt(np.diag(one.covariance)[:2])
        assert np.all(np.abs(one.position[:2] - (x, y)) < 4.0 * sigma_m + 0.05)
        assert one.rms_m < 0.5
    assert len(turns) == len(set(turns)) == 4
