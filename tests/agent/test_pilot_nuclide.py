"""Reports on the nuclide that a drone's camera sees."""

import numpy as np
import pytest

from radron.protocol.messages import Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, messages, pilot, state

beam = pytest.importorskip("radron.sim.radiation.beam")
camera = pytest.importorskip("radron.sim.radiation.camera")
truth = pytest.importorskip("radron.sim.radiation.truth")


def last_status(nuclide, activity_bq):
    """After 25 s on the ground, 5 m from a source of that nuclide."""
    view = camera.SourceView((0.0, 0.0, 1.0), 5.0, activity_bq)
    seen = beam.BeamCamera(truth.CameraTruth(), nuclide, view, np.random.default_rng(1), START_NS)
    one = pilot()
    status = None
    for second in range(25):
        now_ns = START_NS + (second + 1) * SECOND
        one.observe_vehicle(state(now_ns - TICK_NS))
        one.observe_detector(seen.expose(now_ns - SECOND, now_ns))
        status = (messages(one.step(now_ns), Status) or [status])[-1]
    return status


@pytest.mark.slow
def test_a_source_of_another_nuclide_is_reported():
    status = last_status("Ir-192", 5e8)
    assert status.recognised is not None
    assert status.recognised.nuclide == "Ir-192"
    assert status.recognised.evidence > 10.0
    assert any("Ir-192" in problem and MISSION.nuclide in problem for problem in status.problems)


@pytest.mark.slow
def test_the_missions_own_nuclide_is_no_problem():
    status = last_status("Cs-137", 1e9)
    assert status.recognised is not None
    assert status.recognised.nuclide == "Cs-137"
    assert not any("spectrum" in problem for problem in status.problems)


def test_background_is_no_nuclide():
    status = last_status("Cs-137", 1.0)
    assert status.recognised is None
