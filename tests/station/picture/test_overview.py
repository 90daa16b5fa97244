from itertools import pairwise

import pytest

from radron.station.picture.frame import DroneFrame, Frame, SourceFrame
from radron.station.picture.overview import MAX_OVERVIEW_ROWS, TRAIL_MS, Overview

SOURCE = SourceFrame(
    place=(3.0, 4.0, 0.0),
    covariance_m2=(1.0, 0.0, 0.0, 1.0, 0.0, 0.0),
    rms_m=0.12345,
    region=(1.0, 1.0, 0.0),
    velocity_mps=(0.0, 0.0),
    cones=3,
    nuclide="Cs-137",
)


def overview_of(seconds):
    """Of two drones: one flies east by a metre a second, the other's position is unknown."""
    overview = Overview(2)
    for second in range(seconds):
        first = DroneFrame(id="d1", place=(float(second), 1.0, 2.0), rates_ps=(7.0, 1.0, 0.5) if second else None)
        overview.add(Frame(at_ms=1000 * second, drones=(first, DroneFrame(id="d2")), source=SOURCE if second > 1 else None))
    return overview


def test_a_row_tells_what_is_known():
    overview = overview_of(3)
    assert overview.rows() == [
        [0, None, [0.0, 1.0, None], None],
        [1000, None, [1.0, 1.0, 7.0], None],
        [2000, [3.0, 4.0, 0.123], [2.0, 1.0, 7.0], None],
    ]
    assert Overview(2).rows() == []


@pytest.mark.parametrize("seconds", [1, 2, MAX_OVERVIEW_ROWS, MAX_OVERVIEW_ROWS + 1, 3600])
def test_the_rows_of_a_long_flight_are_thinned_and_reach_from_its_beginning_to_its_end(seconds):
    times = [row[0] // 1000 for row in overview_of(seconds).rows()]
    assert (times[0], times[-1]) == (0, seconds - 1)
    assert len(times) <= MAX_OVERVIEW_ROWS + 1
    assert len({later - earlier for earlier, later in pairwise(times[:-1])}) <= 1  # even, but for the last


def test_a_trail_leads_through_the_last_minute_up_to_a_time():
    first, second = overview_of(200).trails(100_500)
    assert second == []
    assert all(place[1] == 1.0 for place in first)
    assert [place[0] for place in first] == list(range(41, 101))
    assert TRAIL_MS == 60_000
    assert overview_of(3).trails(-1) == [[], []]
