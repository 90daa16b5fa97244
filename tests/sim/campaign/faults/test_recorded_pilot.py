"""A recorded pilot gives the invariants the same data as a pilot."""

import pytest

from radron.sim.campaign.faults.recording import _Recorded


@pytest.mark.parametrize(
    "name", ["stage", "hypothesis", "digest", "pending", "whereabouts", "reckoning", "problems", "counters", "finding", "frames"]
)
def test_what_the_invariants_read_is_there(name):
    assert isinstance(getattr(_Recorded, name), property)
