"""Refusal of an operator's command, by the drone's stage and its flight so far."""

from __future__ import annotations

from radron.agent.mission.flight import Flight
from radron.agent.mission.situation import Situation
from radron.agent.mission.transitions import TABLE
from radron.protocol.messages import Action, Stage
from radron.protocol.stages import FLYING, ON_GROUND


def refusal(action: Action, flight: Flight, situation: Situation, *, released: bool) -> str | None:
    """Return why a command is refused; None if obeyed. ``released``: to a pilot, a ground station or a failsafe."""
    stage, lands = flight.stage, flight.position_loss.lands
    if action is Action.START:
        if stage not in ON_GROUND:
            return "start: already started"
        return f"start refused: {situation.problems[0]}" if situation.problems else None
    if stage not in FLYING:
        return f"{action}: not flying"
    if flight.aborted and not (released and action in (Action.LAND, Action.ABORT)):
        return f"{action}: aborted"
    if action is Action.RESUME and stage is not Stage.HOLD:
        return "resume: not holding"
    if lands is not None and action in (Action.HOLD, Action.RESUME, Action.RETURN):
        return f"{action}: it lands: {lands}"
    return None if (stage, action) in TABLE else f"{action}: not possible in {stage}"
