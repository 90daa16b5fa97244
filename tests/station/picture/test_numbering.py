"""Sources keep their numbers, by which page, report and viewers name them."""

import pytest
from msgspec.structs import replace

from radron.station.picture.frame import SourceFrame
from radron.station.picture.numbering import KNOWN_MS, SAME_SOURCE_M, Numbering, numbered

CS = SourceFrame(
    place=(10.0, 20.0, 0.0),
    covariance_m2=(0.02, 0.0, 0.0, 0.02, 0.0, 0.0),
    rms_m=0.2,
    region=(0.3, 0.3, 0.0),
    velocity_mps=(0.0, 0.0),
    cones=30,
    nuclide="Cs-137",
)
CO, IR = replace(CS, place=(12.0, 20.0, 0.0), nuclide="Co-60"), replace(CS, place=(50.0, 20.0, 0.0), nuclide="Ir-192")


def at(source, x):
    return replace(source, place=(x, *source.place[1:]))


@pytest.fixture
def numbers():
    """The numbers of a list of sources, a second after the one before."""
    numbering, times = Numbering(), iter(range(1_000, 1_000_000, 1_000))

    def numbers(*sources, at_ms=None):
        return [one.number for one in numbering.numbered(sources, next(times) if at_ms is None else at_ms)]

    return numbers


def test_a_source_keeps_its_number_whatever_its_place_in_the_list(numbers):
    assert numbers(CS, CO, IR) == [1, 2, 3]
    assert numbers(IR, CS, CO) == [3, 1, 2]
    assert numbers(at(CO, 11.0), at(CS, 11.2)) == [2, 1]  # close together: distinguished by the nuclide
    assert numbers(IR, CO) == [3, 2]


def test_a_nuclide_that_is_corrected_is_the_same_source(numbers):
    assert numbers(CS, IR) == [1, 2]
    assert numbers(IR, replace(CS, nuclide="Co-60")) == [2, 1]


def test_a_new_source_does_not_get_the_number_of_one_that_is_still_shown(numbers):
    assert numbers(CS, IR, at_ms=0) == [1, 2]
    assert numbers(IR, at(CO, 90.0), at_ms=1_000) == [2, 3]
    assert numbers(IR, at(CO, 90.0), at(CS, 10.0 + 0.9 * SAME_SOURCE_M), at_ms=2_000) == [2, 3, 1]  # present again
    assert numbers(IR, at_ms=3_000) == [2]
    assert numbers(IR, at(CO, 70.0), at_ms=2_000 + KNOWN_MS - 1) == [2, 4]
    assert numbers(IR, at(CS, 30.0), at_ms=3_000 + 3 * KNOWN_MS) == [1, 2]  # nothing is known any more


def test_a_single_source_stays_the_same_wherever_it_goes(numbers):
    assert numbers(CS) == [1]
    assert numbers(at(CS, 80.0)) == [1]
    assert numbers() == []
    assert numbers(IR) == [1]


def test_the_first_source_needs_no_number_in_its_name():
    assert numbered(CS) == ""
    assert numbered(replace(CS, number=3), "-") == "-3"
