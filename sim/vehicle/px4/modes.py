"""PX4's flight modes and how its heartbeat shows them."""

from __future__ import annotations

from enum import Enum

_CUSTOM, _AUTO, _GUIDED, _STABILIZE, _MANUAL, _ARMED = 1, 4, 8, 16, 64, 128


class Mode(Enum):
    """Main mode, sub mode, and the base_mode flags of a disarmed vehicle."""

    MANUAL = (1, 0, _CUSTOM | _MANUAL)
    ALTITUDE = (2, 0, _CUSTOM | _MANUAL | _STABILIZE)
    POSITION = (3, 0, _CUSTOM | _MANUAL | _STABILIZE)
    TAKEOFF = (4, 2, _CUSTOM | _AUTO | _GUIDED | _STABILIZE)
    HOLD = (4, 3, _CUSTOM | _AUTO | _GUIDED | _STABILIZE)
    RETURN = (4, 5, _CUSTOM | _AUTO | _GUIDED | _STABILIZE)
    LAND = (4, 6, _CUSTOM | _AUTO | _GUIDED | _STABILIZE)
    OFFBOARD = (6, 0, _CUSTOM | _STABILIZE)
    STABILIZED = (7, 0, _CUSTOM | _MANUAL | _STABILIZE)

    @property
    def custom_mode(self) -> int:
        """As the heartbeat carries it."""
        main, sub, _ = self.value
        return main << 16 | sub << 24

    def base_mode(self, armed: bool) -> int:
        """Flags of the heartbeat: 0x1d disarmed and 0x9d armed in the modes of its own, 0x91 armed in offboard."""
        return self.value[2] | (_ARMED if armed else 0)

    @property
    def by_hand(self) -> bool:
        """A mode that needs somebody at the sticks."""
        return bool(self.value[2] & _MANUAL)

    @property
    def prevents_arming(self) -> bool:
        """PX4 arms in no mode whose end is the ground."""
        return self in (Mode.RETURN, Mode.LAND)

    @classmethod
    def of(cls, main: int, sub: int) -> Mode | None:
        """The mode of these numbers; none where this vehicle does not have it."""
        return next((mode for mode in cls if mode.value[:2] == (main, sub)), None)
