"""Nuclide recognition on events that the simulation transported through the sensor."""

import numpy as np
import pytest

from radron.agent.detector.lines import GAMMAS, LINES_KEV
from radron.agent.detector.spectroscopy import recognition, residuals
from radron.agent.detector.spectroscopy.nuclidewatch import RECOGNITION_PERIOD_NS, NuclideWatch
from radron.agent.detector.spectroscopy.recognition import CANDIDATES, Recogniser
from support.sensors.event_energies import pool

FOUR = ("Cs-137", "Co-60", "I-131", "Ir-192")


def recogniser(seed, without=None, **counts):
    """Fed with that many events of each pool, drawn at random: ``recogniser(1, **{"Cs-137": 300, "background": 50})``.

    ``without``: a nuclide that it does not know.
    """
    rng = np.random.default_rng(seed)
    result = Recogniser([name for name in CANDIDATES if name != without])
    for what, count in counts.items():
        result.add(rng.choice(pool(what), count))
    return result


@pytest.mark.slow
@pytest.mark.parametrize(("nuclide", "count"), [("Cs-137", 300), ("Co-60", 1500), ("I-131", 300), ("Ir-192", 300)])
def test_some_hundred_events_near_a_source_tell_its_nuclide(nuclide, count):
    """Co-60 needs more: few of its photons leave all their energy in 2 mm."""
    for seed in range(5):
        found = recogniser(seed, **{nuclide: count, "background": count // 5}).best()
        assert found is not None
        assert found.nuclide == nuclide


@pytest.mark.parametrize("nuclide", [name for name in CANDIDATES if name not in FOUR])
def test_the_other_nuclides_are_known_too(nuclide):
    found = recogniser(1, **{nuclide: 2000, "background": 200}).best()
    assert found is not None
    assert found.nuclide == nuclide


@pytest.mark.parametrize("nuclide", FOUR)
def test_a_detector_gain_that_is_off_by_three_percent_does_not_mislead(nuclide):
    for gain in (0.97, 1.03):
        skewed = Recogniser()
        skewed.add(gain * np.concatenate((pool(nuclide)[:3000], pool("background")[:500])))
        found = skewed.best()
        assert found is not None
        assert found.nuclide == nuclide


def test_background_alone_is_no_nuclide():
    for seed in range(15):
        assert recogniser(seed, background=(60, 400, 3000)[seed % 3]).best() is None
    everything = Recogniser()
    everything.add(pool("background"))
    assert everything.best() is None


@pytest.mark.parametrize("nuclide", FOUR)
def test_a_weak_source_on_strong_background_is_never_taken_for_another(nuclide):
    named = [recogniser(seed, **{nuclide: 40 * seed, "background": 2000}).best() for seed in range(1, 11)]
    assert {found.nuclide for found in named if found is not None} <= {nuclide}


# Energies (keV) of peaks that must be among the reported lines, with the number of events from which on they are.
UNKNOWN = {
    "Am-241": (1000, (59,)),
    "Ba-133": (5000, (80, 356)),
    "Co-57": (1000, (122,)),
    "Cs-137": (300, (662,)),
    "Eu-152": (20_000, (122,)),
    "F-18": (5000, (511,)),
    "I-131": (1000, (364,)),
    "Ir-192": (1000, (316, 468)),
    "Se-75": (1000, (136, 265)),
}


@pytest.mark.parametrize("nuclide", UNKNOWN)
def test_a_nuclide_that_is_not_in_the_library_is_unknown_with_its_lines_and_not_another(nuclide):
    count, lines_kev = UNKNOWN[nuclide]
    fed = recogniser(1, without=nuclide, **{nuclide: count, "background": count // 5})
    assert fed.best() is None
    told = fed.unknown_lines_kev(fed.look())
    for line in lines_kev:
        assert min(abs(line - energy) for energy in told) < 0.04 * line
    assert len(told) <= len(lines_kev) + 2


def test_co57_is_not_eu152_nor_se75_nor_f18_na22_even_from_few_events():
    for nuclide in ("Co-57", "Se-75", "F-18"):
        for count in (150, 400, 1000):
            found = recogniser(count, **{nuclide: count, "background": count // 5}).best()
            assert found is None or found.nuclide == nuclide
        assert found is not None


@pytest.mark.parametrize("read_kev", [52.0, 54.0, 57.0])
def test_am241_is_found_wherever_its_charge_loss_puts_the_peak(read_kev):
    """The simulated sensor reads 57 keV; other models, 52 to 54."""
    found = Recogniser()
    found.add(pool("Am-241")[:2000] - (57.0 - read_kev))
    found.add(pool("background")[:400])
    best = found.best()
    assert best is not None
    assert best.nuclide == "Am-241"


def test_two_sources_at_once_are_not_taken_for_one():
    both = recogniser(1, **{"Cs-137": 3000, "I-131": 3000, "background": 500})
    assert both.best() is None
    assert {364, 662} <= {min((364, 662), key=lambda line: abs(line - kev)) for kev in both.unknown_lines_kev(both.look())}


def test_few_events_say_nothing():
    assert recogniser(1, **{"Cs-137": 20}).look() is None
    assert Recogniser().best() is None


def test_looks_that_follow_each_other_find_what_one_look_finds():
    """Also where the source comes into view late: a part that was not needed before must be able to grow."""
    once = recogniser(3, background=1000, **{"I-131": 1000}).best()
    often = recogniser(3, background=1000)
    for _ in range(20):
        assert often.best() is None
    events_ = np.random.default_rng(3).choice(pool("I-131"), 1000)
    for part in np.split(events_, 20):
        often.add(part)
        last = often.best()
    assert once is not None
    assert last is not None
    assert last.nuclide == once.nuclide == "I-131"
    assert last.evidence == pytest.approx(once.evidence, rel=0.2)


def test_the_watch_tells_where_the_spectrum_contradicts_the_mission():
    watch = NuclideWatch("Cs-137")
    watch.look(0)
    watch.add(pool("Ir-192")[:1000])
    watch.look(RECOGNITION_PERIOD_NS - 1)
    assert watch.recognised is None
    watch.look(RECOGNITION_PERIOD_NS)
    assert watch.recognised is not None
    (problem,) = watch.problems
    assert "Ir-192" in problem
    assert "Cs-137" in problem
    agreed = NuclideWatch("Ir-192")
    agreed.look(0)
    agreed.add(pool("Ir-192")[:1000])
    agreed.look(RECOGNITION_PERIOD_NS)
    assert agreed.recognised == watch.recognised
    assert agreed.problems == ()


def test_the_watch_tells_lines_that_no_known_nuclide_has():
    watch = NuclideWatch("Cs-137")
    watch.look(0)
    watch.add(np.concatenate((pool("Cs-137")[:3000], pool("Ir-192")[:3000])))
    watch.look(RECOGNITION_PERIOD_NS)
    assert watch.recognised is None
    (problem,) = watch.problems
    assert "lines at" in problem
    assert "the mission is after Cs-137" in problem


def test_the_lines_in_use_are_among_the_gammas():
    for name, used in LINES_KEV.items():
        assert set(used) <= {energy for energy, _ in GAMMAS[name]}


@pytest.mark.parametrize("gain", [0.98, 1.0, 1.02])
def test_several_known_sources_at_once_have_no_unknown_lines(gain):
    several = Recogniser()
    for name in ("Cs-137", "Ir-192", "Co-60"):
        several.add(gain * pool(name)[:3000])
    assert several.foreign_lines_kev(CANDIDATES) == ()


@pytest.mark.parametrize("nuclide", ["Co-57", "Se-75", "I-131"])
def test_lines_that_no_mixture_of_the_candidates_has_are_told(nuclide):
    count, lines_kev = UNKNOWN[nuclide]
    fed = recogniser(1, **{nuclide: 3 * count, "Cs-137": count, "background": count // 5})
    foreign = fed.foreign_lines_kev(("Cs-137", "Co-60", "Na-22"))
    for line in lines_kev:
        assert min(abs(line - energy) for energy in foreign) < 0.04 * line


def test_a_watch_with_candidates_takes_any_of_them_and_tells_of_all_else():
    several, other, unknown = NuclideWatch("auto"), NuclideWatch(("Cs-137", "Co-60")), NuclideWatch(("Cs-137", "Co-60"))
    several.add(np.concatenate((pool("Cs-137")[:3000], pool("Ir-192")[:3000])))
    other.add(pool("Ir-192")[:1000])
    unknown.add(np.concatenate((pool("Cs-137")[:1000], pool("Co-57")[:3000])))
    for watch in (several, other, unknown):
        watch.look(0)
        watch.look(RECOGNITION_PERIOD_NS)
    assert several.problems == ()
    (problem,) = other.problems
    assert "Ir-192" in problem
    assert "the mission is after Cs-137, Co-60" in problem
    (problem,) = unknown.problems
    assert problem.startswith("unknown nuclide: the camera's spectrum has lines at 12")


@pytest.mark.parametrize("expected", ["Cs-137", ("Cs-137", "Co-60")])
def test_what_all_looks_need_is_computed_before_the_flight(monkeypatch, expected) -> None:
    """All agents of a swarm analyse at the same time: on a shared computer the costs of the first analysis add up."""
    for each in (residuals.single_lines, recognition._parts, recognition.mixtures, recognition._read, recognition._common):
        each.cache_clear()
    watch = NuclideWatch(expected)

    def late(*_):
        raise AssertionError("a shape is computed in flight")

    for module, name in ((residuals, "peaks"), (recognition, "of_nuclide"), (recognition, "surroundings")):
        monkeypatch.setattr(module, name, late)
    watch.add(pool("Cs-137")[:300])
    watch.look(0)
    watch.look(RECOGNITION_PERIOD_NS)
    assert watch.recognised is not None
