"""Random missions with faults: 4 short ones in ``make test``, 36 more in ``make test-slow``, so that ``.ci/run`` flies 40; 40
whole ones in ``make test-all``, 1,000 in ``make faults``.

The seeds are none that anything was tuned on, and are not chosen: they are the first ones.
"""

import pytest

from radron.sim.campaign.faults.course import FULL, SHORT, Course
from radron.sim.campaign.faults.mission import Mission, fly_mission
from radron.sim.campaign.faults.summary import told


def violations(seed: int, course: Course) -> str:
    return "\n".join(told(fly_mission(Mission(seed, course)), course))


def marks(seed: int) -> tuple[pytest.MarkDecorator, ...]:
    """Most are slow."""
    return () if seed < 4 else (pytest.mark.slow,)


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=marks(seed)) for seed in range(40)])
def test_nothing_is_violated_in_a_short_mission(seed: int) -> None:
    assert violations(seed, SHORT) == ""


@pytest.mark.long
@pytest.mark.parametrize("seed", range(40))
def test_nothing_is_violated(seed: int) -> None:
    assert violations(seed, FULL) == ""
