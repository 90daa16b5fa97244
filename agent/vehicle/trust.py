"""Trust in the position of an autopilot that flies by satellites, and a bound of the error without trust.

A PX4 that loses its satellites flies on for EKF2_NOAID_TOUT by its inertial sensors alone, and its stated uncertainty is far too
small. Seven seconds after the loss the error of a real PX4 was 14.5 m, and 8 m while the stated sigma was 1.5 m. When the
satellites return, its estimate is pulled or jumps to their position, by up to 99 m.

Measured drift (three losses, up to 20 s): 0.75 m after 1 s, 1.9 m after 2 s, 7.8 m after 5 s, 31 m after 11 s, 101 m after 21 s,
all below ``drift_m``.
"""

from __future__ import annotations

from radron.agent.vehicle.mavlink.messages import EstimatorStatus
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

SILENCE_S = 2.0  # without a message of the receiver, which sends five a second, satellites count as lost
CONFIRM_S = 3.0  # everything must have been well again for this long; PX4 leaves its failsafe after 2 s
RATIO_MOST = 0.8  # of innovations to their gates: up to 0.5 in recorded flights; beyond 1 the filter rejects them
_DRIFT_MPS, _DRIFT_MPS2 = 0.6, 0.25
_POSITION_KNOWN = 0x10  # ESTIMATOR_POS_HORIZ_ABS
_GLITCH = 0x400  # ESTIMATOR_GPS_GLITCH


def drift_m(blind_s: float) -> float:
    """Return a bound of the position's drift (m) after this time without satellites (s): above all measured drifts."""
    return _DRIFT_MPS * blind_s + _DRIFT_MPS2 * blind_s**2


class PositionTrust:
    """Judges whether the position of an autopilot that flies by satellites can be trusted, and bounds its error if not.

    All times are arrivals, by a clock that never goes back.
    """

    def __init__(self, by_satellites: bool) -> None:
        """Start with a trusted position. ``by_satellites``: the autopilot has no other position source; otherwise it is always
        trusted.
        """
        self._by_satellites = by_satellites
        self._fix_s: float | None = None  # arrival of the receiver's last message
        self._has_fix = self._estimates = True
        self._blind_s: float | None = None  # since when satellites have been missing, until the position is confirmed
        self._well_s: float | None = float("-inf")  # since when all has been well; None: it is not

    def take_fix(self, found: bool, now_s: float) -> None:
        """Take from a message of the satellite receiver whether the receiver has a position."""
        self._fix_s, self._has_fix = now_s, found
        self._judge(now_s)

    def take_estimator(self, status: EstimatorStatus, now_s: float) -> None:
        """Take the status of the autopilot's position filter: whether it agrees with the satellites."""
        ratios = (status.pos_horiz_ratio, status.vel_ratio)
        agrees = all(ratio is not None and ratio < RATIO_MOST for ratio in ratios)
        self._estimates = agrees and bool(status.flags & _POSITION_KNOWN) and not status.flags & _GLITCH
        self._judge(now_s)

    def jumped(self, now_s: float, *, moved: bool) -> None:
        """Note a jump of the autopilot's frame: the position has to be confirmed again.

        moved: the jump has moved the position, and not only the heading or the position source. With satellites the drift then
        ends.
        """
        if not self._by_satellites:
            return
        if moved and self.hears_satellites(now_s):
            self._blind_s = None
        if self._well_s is not None:
            self._well_s = now_s

    def hears_satellites(self, now_s: float) -> bool:
        """Whether the satellite receiver has a position; true if the autopilot has another position source."""
        return not self._by_satellites or (self._has_fix and (self._fix_s is None or now_s - self._fix_s < SILENCE_S))

    def at(self, now_s: float) -> bool:
        """Return whether the autopilot's position can be trusted at this time."""
        self._judge(now_s)
        if self._well_s is None or now_s - self._well_s < CONFIRM_S:
            return False
        self._blind_s = None
        return True

    def drift_m(self, now_s: float) -> float:
        """Return a bound of the position error (m) beyond the sigma of the autopilot's filter; 0 while the position can be
        trusted.
        """
        if self._blind_s is None or self.at(now_s):
            return 0.0
        return drift_m((now_s if self._well_s is None else self._well_s) - self._blind_s)

    def problem(self, now_s: float) -> CodedText | None:
        """Return the reason in words why the autopilot's position cannot be trusted; None if it can."""
        if self.at(now_s):
            return None
        if not self.hears_satellites(now_s):
            return CodedText(Code.SATELLITES_LOST, "no satellites: the position is drifting")
        if not self._estimates:
            text = "satellites and the autopilot's estimate disagree: the position is unknown"
            return CodedText(Code.POSITION_DISPUTED, text)
        text = "satellites or the position were lost a moment ago: the position is being confirmed"
        return CodedText(Code.POSITION_CONFIRMING, text)

    def _judge(self, now_s: float) -> None:
        if not self._by_satellites:
            return
        if self.hears_satellites(now_s) and self._estimates:
            if self._well_s is None:
                self._well_s = now_s
            return
        self._well_s = None
        if self._blind_s is None:
            self._blind_s = now_s
