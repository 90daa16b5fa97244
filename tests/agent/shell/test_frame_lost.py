"""The agent's restart by itself after a change of its vehicle's local frame."""

from types import SimpleNamespace

import pytest

from radron.agent.shell.node import Node
from radron.agent.vehicle.interface import LaunchPlace
from radron.protocol.messages import Stage


@pytest.mark.parametrize(
    ("rebooted", "stage", "flown", "begins"),
    [
        (True, Stage.LANDED, True, True),
        (True, Stage.PREFLIGHT, True, True),
        (True, Stage.HOLD, True, False),  # in flight it never does
        (True, Stage.PREFLIGHT, False, False),  # without a flight the place is measured anew at any time
        (True, Stage.PREFLIGHT, None, False),
        (False, Stage.LANDED, True, False),
    ],
)
def test_it_begins_anew_after_a_flight_once_the_autopilot_is_booted_again(rebooted, stage, flown, begins) -> None:
    launch = None if flown is None else LaunchPlace(north_m=0.0, east_m=0.0, down_m=0.0, flown=flown)
    vehicle = SimpleNamespace(has_rebooted=rebooted, launch_to_keep=launch)
    assert Node._lost_its_frame.fget(SimpleNamespace(_vehicle=vehicle, _pilot=SimpleNamespace(stage=stage))) is begins
