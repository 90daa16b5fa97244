"""The line for which an event counts: of one named nuclide, and of many possible nuclides."""

import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.lines import CANDIDATES
from radron.agent.detector.windows import Windows, candidates_of
from radron.agent.errors import ConfigError


def test_auto_is_all_that_is_known_but_for_what_is_everywhere():
    assert candidates_of("auto") == CANDIDATES
    assert "K-40" not in CANDIDATES
    assert candidates_of("Cs-137") == candidates_of(("Cs-137",)) == ("Cs-137",)
    with pytest.raises(ConfigError, match=r"nuclide 'Zz-1' is not known; known: Am-241, "):
        Windows(("Cs-137", "Zz-1"), DetectionConfig())


def test_of_a_named_nuclide_the_window_and_the_limits_are_the_missions():
    (window,) = Windows(("Cs-137",), DetectionConfig(energy_window=0.1, minimum_photon_kev=200.0)).each
    assert window.half_kev == pytest.approx(66.166)
    assert window.line.minimum_photon_kev == 200.0


def test_of_many_each_line_has_the_events_within_the_resolution_that_are_nearest():
    windows = Windows(("Cs-137", "Ir-192"), DetectionConfig(minimum_photon_kev=200.0))
    lines = {energy: windows.line_of(energy) for energy in (640.0, 630.0, 545.0, 312.0)}
    assert lines[545.0] is None  # far from 468 and 604 keV: the 20 % of a named nuclide would take it in
    assert lines[640.0].energy_kev == 661.66
    assert lines[630.0].energy_kev == 612.46
    assert lines[312.0].energy_kev == 308.46
    assert lines[312.0].minimum_photon_kev < 200.0  # the mission's limit is of one line


@pytest.mark.parametrize("nuclides", [("I-131",), CANDIDATES])
def test_what_counts_for_a_line_is_what_is_within_its_reach(nuclides):
    windows = Windows(nuclides, DetectionConfig())
    for energy in range(50, 1500, 7):
        inside = [
            window.energy_kev
            for place, window in enumerate(windows.each)
            if windows.reach_kev(place)[0] < energy < windows.reach_kev(place)[1]
        ]
        line = windows.line_of(float(energy))
        assert inside == ([] if line is None else [line.energy_kev])
