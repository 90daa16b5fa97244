"""The energy scale of a camera in flight, by the lines of the nuclides that it sees."""

from itertools import pairwise

import numpy as np
import pytest

from radron.agent.detector.lines import CANDIDATES
from radron.agent.detector.spectroscopy.energyscale import EnergyScale
from radron.agent.detector.spectroscopy.nuclidewatch import RECOGNITION_PERIOD_NS, NuclideWatch
from support.sensors.event_energies import pool

# Relative: the places of the lines are read up to 0.7 % high, the filtered readings have a sigma of 0.2 %, and a drift of 1 % a
# minute moves on by 0.2 % before it is read.
RIGHT = 0.015
TOLD = "camera: gain {} % {}, by the lines of its nuclide; corrected"


def watch_of(nuclide):
    """A watch of a mission after this nuclide, which begins at 0 s."""
    watch = NuclideWatch(nuclide)
    watch.look(0)
    return watch


def looked_at(watch, second, gain, *nuclides):
    """Ten seconds of a camera that reads that fraction of all energies, then a check by the watch. Returns the watch's report."""
    rng = np.random.default_rng(second)
    measured = [rng.choice(pool(nuclide), 600) for nuclide in nuclides or ("Cs-137",)]
    watch.add(watch.scale * gain * np.concatenate((*measured, rng.choice(pool("background"), 30))))
    watch.look(second * RECOGNITION_PERIOD_NS)
    return watch.problems


@pytest.mark.parametrize("gain", [0.975, 1.0, 1.02])
def test_a_small_error_of_the_calibration_is_corrected_and_not_told(gain):
    watch = watch_of("Cs-137")
    for second in range(1, 7):
        assert looked_at(watch, second, gain) == ()
        assert watch.scale * gain == pytest.approx(1.0, abs=RIGHT)


@pytest.mark.parametrize("nuclide", CANDIDATES)
def test_the_scale_of_a_right_camera_stays_with_all_nuclides(nuclide):
    """Am-241, too, with its line at the end of the spectrum read 1.4 % low."""
    rng = np.random.default_rng(6)
    scale = EnergyScale(nuclide)
    scale.look(0)
    for second in range(1, 9):
        scale.add(scale.factor * np.concatenate((rng.choice(pool(nuclide), 900), rng.choice(pool("background"), 45))))
        assert not scale.look(second * RECOGNITION_PERIOD_NS)
        assert scale.factor == pytest.approx(1.0, abs=RIGHT)
    assert scale.factor != 1.0
    assert scale.problems == ()


@pytest.mark.parametrize("gain", [0.7, 0.762, 0.93, 1.2])
def test_a_jump_is_corrected_by_the_lines_of_the_nuclide_and_back_again(gain):
    watch = watch_of("Cs-137")
    assert looked_at(watch, 1, 1.0) == ()
    for second, now in ((2, gain), (3, gain), (4, 1.0)):
        told = looked_at(watch, second, now)
        assert len(told) == (now != 1.0)
        assert watch.scale * now == pytest.approx(1.0, abs=RIGHT)


@pytest.mark.parametrize(("drift_per_s", "word"), [(-0.01 / 60.0, "low"), (0.01 / 60.0, "high")])
def test_a_slow_drift_is_corrected_from_its_beginning_and_told_within_a_minute_of_passing_4_percent(drift_per_s, word):
    """1 % a minute at 40 events a second: passes 4 % after 240 s."""
    rng = np.random.default_rng(3)
    watch, told = watch_of("Cs-137"), {}
    for second in range(0, 480, 2):
        gain = 1.0 + drift_per_s * second
        watch.add(watch.scale * gain * np.concatenate((rng.choice(pool("Cs-137"), 76), rng.choice(pool("background"), 4))))
        watch.look(second * 1_000_000_000)
        for text in watch.problems:
            told.setdefault(text, second)
        assert watch.scale * gain == pytest.approx(1.0, abs=RIGHT)
    assert next(iter(told)) == TOLD.format(4, word)
    assert 180 < told[TOLD.format(4, word)] <= 300
    assert TOLD.format(7, word) in told


def test_a_gain_at_the_limit_is_told_without_flicker():
    watch = watch_of("Cs-137")
    gains = (1.0, *[0.95] * 3, *[0.97, 0.965] * 4, *[1.0] * 4)
    told = [len(looked_at(watch, second, gain)) for second, gain in enumerate(gains, 1)]
    assert [after - before for before, after in pairwise(told) if after != before] == [1, -1]


@pytest.mark.parametrize("nuclides", [("I-131",), ("Cs-137", "Ir-192"), ("Cs-137", "Co-60", "I-131")])
@pytest.mark.parametrize("mission", ["auto", "named"])
def test_the_scale_follows_the_lines_of_all_that_is_there(mission, nuclides):
    watch = watch_of("auto" if mission == "auto" else (*nuclides, "F-18"))
    for second in range(1, 41):
        gain = 1.0 - 0.0025 * max(0, second - 4)  # 9 % in 6 minutes, once the nuclides are recognised
        looked_at(watch, second, gain, *nuclides)
    assert watch.scale * gain == pytest.approx(1.0, abs=RIGHT)
    (told,) = watch.problems
    assert told in (TOLD.format(8, "low"), TOLD.format(9, "low"), TOLD.format(10, "low"))


def test_the_scale_follows_a_nuclide_that_is_not_the_mission_s():
    watch = watch_of("Cs-137")
    for second in range(1, 41):
        gain = 1.0 - 0.0025 * max(0, second - 4)
        told = looked_at(watch, second, gain, "Ir-192")
    assert watch.scale * gain == pytest.approx(1.0, abs=RIGHT)
    assert "% low" in told[0]
    assert told[1].startswith("the camera's spectrum is that of Ir-192")


@pytest.mark.parametrize("nuclide", ["Ir-192", "I-131", "Co-60"])
def test_another_nuclide_is_no_jump(nuclide):
    """Only Na-22 looks like Cs-137 in a camera that reads 0.77 of it: 511 of 662 keV."""
    watch = watch_of("Cs-137")
    looked_at(watch, 1, 1.0)
    for second in range(2, 6):
        looked_at(watch, second, 1.0, nuclide)
    assert watch.scale == pytest.approx(1.0, abs=RIGHT)


@pytest.mark.parametrize(("mission", "nuclide"), [("I-131", "Ba-133"), ("Ba-133", "I-131"), ("Ba-133", "Eu-152")])
@pytest.mark.parametrize("gain", [0.95, 1.0])
def test_another_nuclide_with_a_line_nearby_is_no_drift(mission, nuclide, gain):
    """364 and 356 keV, 356 and 344 keV: the first readings' assumed mission line is forgotten with the recognition."""
    watch = watch_of(mission)
    for second in range(1, 9):
        looked_at(watch, second, 1.0, nuclide)
    assert watch.scale == pytest.approx(1.0, abs=RIGHT)
    for second in range(9, 13):
        looked_at(watch, second, gain, nuclide)
    assert watch.scale * gain == pytest.approx(1.0, abs=RIGHT)


def test_a_camera_that_has_never_seen_the_nuclide_as_it_is_is_believed():
    watch = watch_of("Cs-137")
    looked_at(watch, 1, 0.762)
    looked_at(watch, 2, 0.762)
    assert watch.scale == pytest.approx(1.0, abs=RIGHT)
