"""Which commands of an operator a drone refuses, by its stage, and to which stages the others lead."""

from __future__ import annotations

from agent.mission.situation import Situation
from protocol.messages import Action, Stage
from protocol.stages import FLYING, ON_GROUND, STEERED

STAGE_AFTER = {
    Action.START: Stage.TAKEOFF,
    Action.RETURN: Stage.RETURN,
    Action.LAND: Stage.LANDING,
    Action.ABORT: Stage.ABORT,
}


def refusal(
    action: Action, stage: Stage, situation: Situation, lands: str | None, *, aborted: bool, released: bool
) -> str | None:
    """Why a command is refused at that stage; None where it is obeyed. ``lands``: why it has to land; None where it has not.
    ``aborted``: an operator has ended the flight; ``released``: somebody else flies the vehicle.
    """
    if action is Action.START:
        if stage not in ON_GROUND:
            return "start: already started"
        return f"start refused: {situation.problems[0]}" if situation.problems else None
    if stage not in FLYING:
        return f"{action}: not flying"
    if aborted and not (released and action in (Action.LAND, Action.ABORT)):
        return f"{action}: aborted"
    if action is Action.RESUME and stage is not Stage.HOLD:
        return "resume: not holding"
    if lands is not None and action in (Action.HOLD, Action.RESUME, Action.RETURN):
        return f"{action}: it lands: {lands}"
    if action is Action.HOLD and stage not in (Stage.TAKEOFF, *STEERED):
        return f"hold: not possible in {stage}"
    return None
