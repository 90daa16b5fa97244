"""The pilot of a run of the agent, recorded where records are wanted."""

from __future__ import annotations

import secrets
import time

from msgspec import Struct

from radron.agent.computing import Computing
from radron.agent.config.drone import DroneConfig
from radron.agent.errors import FlightRecordError
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.fusion.registry import deferred_named
from radron.agent.pilot import Pilot
from radron.agent.shell.folding import Folding
from radron.agent.shell.logs import Logger
from radron.agent.shell.missionstore import InForce
from radron.agent.shell.statestore import State
from radron.protocol.codes import Code
from radron.protocol.identity import Identity
from radron.protocol.texts import CodedText
from radron.protocol.trust import trust_of

NONCE_KEY_BYTES = 16


class Aboard(Struct, frozen=True):
    """The pilot program of one run of the agent, with the process of its estimator, and its flight recorder.

    ``unrecorded``: reason why a wanted recorder is missing, else None.
    """

    pilot: Pilot | RecordedPilot
    folding: Folding
    recorder: FlightRecorder | None = None
    unrecorded: CodedText | None = None


def aboard(drone: DroneConfig, force: InForce, boot: str, saved: State, identity: Identity | None, log: Logger) -> Aboard:
    """Make the pilot program for the mission in force, with its flight recorder if records are wanted.

    Records that cannot be written prevent a start, but not the rejoining of a flight.
    """
    trust, nonce_key = trust_of(identity), secrets.token_bytes(NONCE_KEY_BYTES)
    computing = Computing(estimators=deferred_named)
    flown = Pilot(force.mission, drone, boot, memory=saved.memory, trust=trust, nonce_key=nonce_key, computing=computing)
    records, recorder, unrecorded = drone.recorder, None, None
    if records.folder is not None:
        inputs = force.mission, drone, boot, time.time_ns(), saved.memory, trust, force.origin
        header = FlightHeader.of(*inputs, nonce_key=nonce_key, deferred=True)
        try:
            recorder = FlightRecorder(records.folder, records.limit_mb, header)
        except FlightRecordError as error:
            unrecorded = CodedText(Code.RECORDS_LOST, str(error))
    recorded = None if recorder is None else RecordedPilot(flown, recorder)
    answered = flown.fusion.answered if recorded is None else recorded.answered
    folding = Folding(flown.fusion.estimator, force.mission, answered, log)
    return Aboard(recorded or flown, folding, recorder, unrecorded)
