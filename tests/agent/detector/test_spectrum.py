"""The coarse spectrum: every event in the bin of its energy, and none beyond the ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.detector.spectrum import CoarseSpectrum
from radron.protocol.spectrum import BINS, EDGES_KEV, HIGHEST_KEV, LOWEST_KEV, SpectrumBin

ENERGIES = st.lists(st.floats(1.0, 2000.0), max_size=50)


def test_the_bins_go_from_40_to_1450_kev():
    assert (len(EDGES_KEV), EDGES_KEV[0], EDGES_KEV[-1]) == (BINS + 1, pytest.approx(LOWEST_KEV), HIGHEST_KEV)
    widths = np.diff(EDGES_KEV)
    assert widths[0] == pytest.approx(13.5, abs=0.1)
    assert widths[-1] == pytest.approx(74.6, abs=0.1)


@given(energies=ENERGIES)
def test_one_by_one_and_all_at_once_give_the_same(energies):
    single, together = CoarseSpectrum(), CoarseSpectrum()
    for energy in energies:
        single.add(energy, coincidence=False)
    together.add_singles(np.array(energies, dtype=float))
    assert single.bins() == together.bins()
    assert sum(one.singles for one in single.bins()) == sum(LOWEST_KEV <= energy < HIGHEST_KEV for energy in energies)


def test_singles_and_coincidences_are_told_apart_and_empty_bins_left_out():
    spectrum = CoarseSpectrum()
    spectrum.add(661.7, coincidence=True)
    spectrum.add(661.7, coincidence=False)
    spectrum.add(661.7, coincidence=False)
    (one,) = spectrum.bins()
    assert EDGES_KEV[one.place] <= 661.7 < EDGES_KEV[one.place + 1]
    assert (one.singles, one.coincidences) == (2, 1)
    spectrum.add_bins((SpectrumBin(0, 3, 0),))
    assert spectrum.bins() == (SpectrumBin(0, 3, 0), one)
