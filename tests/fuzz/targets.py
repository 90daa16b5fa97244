"""All fuzz targets, by name."""

from __future__ import annotations

from tests.fuzz.configs import Drones, Missions, Scenarios
from tests.fuzz.flights import Flights
from tests.fuzz.mavlink import AgentLink, EmulatedPx4
from tests.fuzz.messages import Messages
from tests.fuzz.recordings import Recordings
from tests.fuzz.states import States
from tests.fuzz.target import Target

TARGETS: dict[str, type[Target]] = {
    target.name: target for target in (Messages, AgentLink, EmulatedPx4, Missions, Drones, Scenarios, Recordings, States, Flights)
}
