"""The drone's local frame in the autopilot's: measured on the ground, or stored over a restart of the agent."""

from __future__ import annotations

from collections import deque

from msgspec.structs import replace

from radron.agent.geometry import Vector3
from radron.agent.vehicle.interface import LaunchPlace, Origin
from radron.agent.vehicle.mavlink.messages import GlobalOrigin
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

WINDOW_S = 5.0
UNPLACED_S = 5.0  # the origin is asked for every second
ORIGIN_S = 30.0  # while it may yet show that the stored place counts
UNPLACED = 1000  # epochs from here on are of frames that begin in flight; fewer are reached by jumps
_RESETS, _BOOTS = 256, 3900  # of an autopilot, so that its next frame is of another epoch; all below the field's limit
SHORTEST_S = 1.0  # standing still before the mean is used
_SAME_DEG = 2e-7  # the origin comes in units of 1e-7 degrees
_SAME_M = 0.01
_SAME_BOOT_NS = 2_000_000_000  # clock drift in a flight is smaller, and a reboot takes longer


class LaunchSurvey:
    """Measurement of the launch place, the origin of the drone's local frame: mean of the autopilot's position on the ground.

    The mean is over the last seconds, and is frozen at arming. After the first flight it never changes, also after a landing
    elsewhere, so that later measurements belong to the same frame.

    An agent that starts with the vehicle armed has nothing to average, and after a flight meanwhile the vehicle may be elsewhere.
    In both cases the stored place is used, provided that the autopilot's frame still has the same geodetic origin. A horizontal
    shift of the origin in flight invalidates the place: setpoints and cones would be wrong by as much. (The autopilot may correct
    the origin's altitude without moving its frame: a warning.)

    An autopilot that flies without satellites (``gnss`` False) has no such origin. Its frame stays the same until a reboot. An
    origin that appears later, because a receiver has found satellites, does not move the frame.

    A frame that jumps in flight begins a new epoch (numbered period without a jump). A frame that the mission gives as exact
    (``exact``) is exact in the first epoch only; so the jump is also reported as a problem.
    """

    def __init__(self, stored: LaunchPlace | None = None, gnss: bool = True, exact: bool = False) -> None:
        self._place: LaunchPlace | None = None
        self._moved = False  # the autopilot's frame is no longer the place's
        self.problem: CodedText | None = None
        self._stored = stored
        self._gnss, self._exact = gnss, exact
        self._flown = self._frozen = False
        self._unplaced_s: float | None = None  # since when it flies from a place that is not known
        self._samples: deque[tuple[float, Vector3]] = deque()
        self._origin: Origin | None = None

    @property
    def place(self) -> LaunchPlace | None:
        """The launch place in the autopilot's present frame; None if not known."""
        return None if self._moved else self._place

    @property
    def to_keep(self) -> LaunchPlace | None:
        """The place to store for a restarted agent; None while it may still change. Before a place is known, the stored place."""
        if self._place is None:
            return self._stored
        return replace(self._place, flown=self._flown) if self._frozen else None

    def take_origin(self, origin: GlobalOrigin) -> None:
        """Take the geodetic origin of the autopilot's local frame from its message."""
        self._origin = (origin.latitude * 1e-7, origin.longitude * 1e-7, origin.altitude * 1e-3)

    def observe(
        self,
        now_s: float,
        position_m: Vector3,
        armed: bool,
        in_air: bool,
        booted_ns: int | None = None,
        resets: int | None = None,
    ) -> None:
        """Take a position of the autopilot (NED, m, its local frame), and update the launch place.

        now_s: a clock that never goes back. booted_ns: its boot, own time. resets: its present count of resets of
        the position filter.
        """
        if self._place is None and self._stored is not None and resets is not None:
            self._stored = replace(self._stored, resets=resets)
        if self._place is None and self._may_have_landed_elsewhere(booted_ns):
            self._place, self._flown = self._stored, True
        self._frozen = armed or in_air or self._flown
        self._place_anyhow(now_s, armed and in_air, booted_ns, resets)
        if self._origin is None and self._gnss:
            text = "the autopilot has not reported the origin of its local frame yet (no position fix?)"
            self.problem = CodedText(Code.ORIGIN_MISSING, text)
        elif self._frozen:
            self._hold(booted_ns, resets)
            self._flown = self._flown or (in_air and self._place is not None)
        else:
            self._average(now_s, position_m, booted_ns, resets)

    def _place_anyhow(self, now_s: float, flies: bool, booted_ns: int | None, resets: int | None) -> None:
        """Use the autopilot's origin for a vehicle in flight from an unknown place, in an epoch of its own whose frame only
        sightings and fixes determine. Otherwise the agent would have no telemetry, assume the vehicle on the ground, and refuse
        to land it.
        """
        unplaced = flies and self._place is None
        self._unplaced_s = (now_s if self._unplaced_s is None else self._unplaced_s) if unplaced else None
        waits_s = ORIGIN_S if self._gnss and self._stored is not None and self._origin is None else UNPLACED_S
        if self._unplaced_s is None or now_s - self._unplaced_s < UNPLACED_S:
            return
        if self._stored is not None and self._origin is None and _same_boot(self._stored, booted_ns):
            self._place = self._stored  # without satellites there is no origin
        if self._place is not None or now_s - self._unplaced_s < waits_s:
            return
        latitude_deg, longitude_deg, altitude_m = self._origin or (None, None, None)
        boots = (booted_ns or 0) // 10**9 % _BOOTS * _RESETS
        self._place, self._flown = (
            LaunchPlace(
                north_m=0.0,
                east_m=0.0,
                down_m=0.0,
                origin_latitude_deg=latitude_deg,
                origin_longitude_deg=longitude_deg,
                origin_altitude_m=altitude_m,
                booted_ns=booted_ns,
                resets=resets,
                epoch=UNPLACED + boots + (resets or 0) % _RESETS,
            ),
            True,
        )

    def jumped(self) -> None:
        """Note that the autopilot's frame has jumped: in flight a new epoch begins; before the flight the place is measured
        again.
        """
        if self._place is not None and self._frozen:
            self._place = replace(self._place, epoch=self._place.epoch + 1)
        elif self._place is None and self._stored is not None:  # while no agent ran
            self._stored = replace(self._stored, epoch=self._stored.epoch + 1)
        self._samples.clear()

    def _average(self, now_s: float, position_m: Vector3, booted_ns: int | None, resets: int | None) -> None:
        samples = self._samples
        if samples and now_s - samples[-1][0] > SHORTEST_S:
            samples.clear()
        samples.append((now_s, position_m))
        while samples[0][0] < now_s - WINDOW_S:
            samples.popleft()
        if now_s - samples[0][0] < SHORTEST_S:
            self.problem = CodedText(Code.LAUNCH_UNMEASURED, "measuring the launch place")
            return
        north_m, east_m, down_m = (sum(axis) / len(samples) for axis in zip(*(sample for _, sample in samples), strict=True))
        latitude_deg, longitude_deg, altitude_m = self._origin or (None, None, None)
        self._place = LaunchPlace(
            north_m=north_m,
            east_m=east_m,
            down_m=down_m,
            origin_latitude_deg=latitude_deg,
            origin_longitude_deg=longitude_deg,
            origin_altitude_m=altitude_m,
            booted_ns=booted_ns,
            resets=resets,
        )
        self.problem, self._moved = None, False

    def _hold(self, booted_ns: int | None, resets: int | None) -> None:
        self._samples.clear()
        if self._place is None and self._stored is not None and self._is_same_frame(self._stored, booted_ns):
            self._place = self._stored
        if self._place is None:
            self.problem = CodedText(
                Code.LAUNCH_UNKNOWN,
                "the vehicle is armed and this agent does not know where it was launched: land and disarm it"
                if self._stored is None
                else "the autopilot's local frame is not the one of the launch (another origin, or booted since): "
                "land and disarm the vehicle",
            )
            return
        if resets is not None and resets != self._place.resets:
            self._place = replace(self._place, resets=resets)
        origin, same = self._place.origin, True
        if origin is not None and self._origin is not None:
            self._moved = not _same_spot(origin, self._origin)
            same = not self._moved and _same_height(origin, self._origin)
        if self._place.epoch >= UNPLACED:
            self.problem = CodedText(
                Code.LAUNCH_UNKNOWN,
                "the launch place is not known; the position comes only from satellite fixes and sightings: "
                "land, then restart the agent at the launch place",
            )
        elif not same:
            self.problem = CodedText(Code.ORIGIN_MOVED, "the autopilot has moved the origin of its local frame in flight: land")
        elif self._exact and self._place.epoch > 0:
            self.problem = CodedText(
                Code.FRAME_NOT_EXACT,
                "the autopilot's position or heading has jumped in flight, but the mission defines its frame as exact: "
                "from then on it is known by the drone's motion only",
            )
        else:
            self.problem = None

    def _may_have_landed_elsewhere(self, booted_ns: int | None) -> bool:
        """Whether the vehicle has flown from the stored place, in a frame that is still the same. After a jump the frame is known
        by the motion in flight only; then the place is measured again.
        """
        stored = self._stored
        return stored is not None and stored.flown and stored.epoch == 0 and self._is_same_frame(stored, booted_ns)

    def _is_same_frame(self, stored: LaunchPlace, booted_ns: int | None) -> bool:
        origin = stored.origin
        if origin is not None and self._origin is not None:
            return _same_spot(origin, self._origin) and (_same_height(origin, self._origin) or _same_boot(stored, booted_ns))
        return not self._gnss and _same_boot(stored, booted_ns)


def _same_boot(stored: LaunchPlace, booted_ns: int | None) -> bool:
    return stored.booted_ns is not None and booted_ns is not None and abs(stored.booted_ns - booted_ns) < _SAME_BOOT_NS


def _same_spot(one: Origin, other: Origin) -> bool:
    return abs(one[0] - other[0]) < _SAME_DEG and abs(one[1] - other[1]) < _SAME_DEG


def _same_height(one: Origin, other: Origin) -> bool:
    return abs(one[2] - other[2]) < _SAME_M
