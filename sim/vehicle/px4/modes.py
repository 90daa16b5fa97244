"""PX4's flight modes and their encoding in heartbeat and CURRENT_MODE."""

from __future__ import annotations

from enum import Enum

_CUSTOM, _AUTO, _GUIDED, _STABILIZE, _MANUAL, _ARMED = 1, 4, 8, 16, 64, 128


class Mode(Enum):
    """A flight mode of PX4, with its numbers in MAVLink messages.

    The values are main mode, sub mode, the base_mode flags of a disarmed vehicle, and MAVLink's number of the standard mode.
    DESCEND is flown without a position: the heartbeat shows it as LAND, and it cannot be chosen.
    """

    MANUAL = (1, 0, _CUSTOM | _MANUAL, 0)
    ALTITUDE = (2, 0, _CUSTOM | _MANUAL | _STABILIZE, 4)
    POSITION = (3, 0, _CUSTOM | _MANUAL | _STABILIZE, 1)
    TAKEOFF = (4, 2, _CUSTOM | _AUTO | _GUIDED | _STABILIZE, 8)
    HOLD = (4, 3, _CUSTOM | _AUTO | _GUIDED | _STABILIZE, 0)
    RETURN = (4, 5, _CUSTOM | _AUTO | _GUIDED | _STABILIZE, 5)
    LAND = (4, 6, _CUSTOM | _AUTO | _GUIDED | _STABILIZE, 7)
    OFFBOARD = (6, 0, _CUSTOM | _STABILIZE, 0)
    STABILIZED = (7, 0, _CUSTOM | _MANUAL | _STABILIZE, 0)
    DESCEND = (4, 6, _CUSTOM | _AUTO | _GUIDED | _STABILIZE, 0)

    @property
    def custom_mode(self) -> int:
        """Number of this mode in the field custom_mode of a heartbeat."""
        main, sub, _, _ = self.value
        return main << 16 | sub << 24

    @property
    def standard_mode(self) -> int:
        """Number of this mode in MAVLink's MAV_STANDARD_MODE; 0: none of them."""
        return self.value[3]

    def base_mode(self, armed: bool) -> int:
        """Return the base_mode flags of a heartbeat: 0x1d disarmed and 0x9d armed in autonomous modes, 0x91 armed in offboard."""
        return self.value[2] | (_ARMED if armed else 0)

    @property
    def by_hand(self) -> bool:
        """Whether this mode needs a pilot at the sticks."""
        return bool(self.value[2] & _MANUAL)

    @property
    def prevents_arming(self) -> bool:
        """Whether PX4 denies arming in this mode, as in all modes that end on the ground."""
        return self in (Mode.RETURN, Mode.LAND, Mode.DESCEND)

    @classmethod
    def of(cls, main: int, sub: int) -> Mode | None:
        """Return the mode with these numbers; None if this vehicle does not have it."""
        return next((mode for mode in cls if mode.value[:2] == (main, sub)), None)
