"""Kinds of faults of cameras, clocks and vehicles in a simulated flight."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from radron.sim.faults.base import Delay, Family, Fault, Metres, Probability, Share

EMPTY_MPS = 3.0  # sink rate of a vehicle whose battery is empty


class CameraDead(Fault, frozen=True, kw_only=True, tag="camera-dead"):
    """The camera of a drone delivers no readout at all; with ``blind``: readouts without any hit."""

    family: ClassVar[Family] = "camera"
    blind: bool = False


class CameraNoisy(Fault, frozen=True, kw_only=True, tag="camera-noisy"):
    """Some pixels of a camera are noisy, each with ``rate_hz`` hits of ``energy_kev`` a second.

    ``pixels``: their number, at random places; ``column``: instead, the 128 pixels of half a column.
    """

    family: ClassVar[Family] = "camera"
    pixels: Annotated[int, Meta(ge=1, le=4096)] = 20
    rate_hz: Annotated[float, Meta(gt=0.0, le=1e5)] = 100.0
    energy_kev: Annotated[float, Meta(gt=0.0, le=1e4)] = 30.0
    column: bool = False


class CameraStuck(Fault, frozen=True, kw_only=True, tag="camera-stuck"):
    """The camera of a drone delivers one readout again and again, under new times."""

    family: ClassVar[Family] = "camera"


class CameraGain(Fault, frozen=True, kw_only=True, tag="camera-gain"):
    """The camera of a drone has a wrong calibration: each pixel collects ``factor`` times the charge that the files state.

    With ``over_s`` the gain drifts there linearly in that time, as with temperature.
    """

    family: ClassVar[Family] = "camera"
    factor: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.2
    over_s: Annotated[float, Meta(ge=0.0, le=36_000.0)] = 0.0

    def factor_at(self, time_s: float) -> float:
        """Return the factor of the collected charge at a time (s) of the flight."""
        share = 1.0 if self.over_s == 0.0 else min(1.0, max(0.0, (time_s - self.at_s) / self.over_s))
        return 1.0 + share * (self.factor - 1.0)


class Clock(Fault, frozen=True, kw_only=True, tag="clock"):
    """The clock of the drone's computer jumps ahead by ``jump_s``, and drifts by ``drift_ppm``.

    At the end it steps back to the right time. All stamps made on board have this wrong time; nothing else changes.
    """

    family: ClassVar[Family] = "clock"
    jump_s: Annotated[float, Meta(ge=-600.0, le=600.0)] = 0.0
    drift_ppm: Annotated[float, Meta(ge=-100_000.0, le=100_000.0)] = 0.0

    def check(self) -> str | None:
        """Check that ``jump_s`` or ``drift_ppm`` is given; return an error text, or None."""
        return "jump_s, drift_ppm: give at least one that is not 0" if self.jump_s == 0.0 and self.drift_ppm == 0.0 else None


class SatellitesLost(Fault, frozen=True, kw_only=True, tag="satellites-lost"):
    """A vehicle that flies by satellites receives none, and its filter continues by inertia.

    The error of its velocity begins with 0.1 to 0.8 m/s and grows by ``drift_mps2`` (a real PX4 and live flights: 0.08 to 0.35,
    whatever is given). After 2.2 s the position is unknown, and the autopilot lands. When satellites return, the position is
    right after some seconds, and the vehicle flies the last chosen mode.
    """

    family: ClassVar[Family] = "pose"
    drift_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.05


class PositionJump(Fault, frozen=True, kw_only=True, tag="position-jump"):
    """The vehicle's own position estimate jumps by ``jump_m`` in a direction drawn from the seed.

    Its heading jumps by ``turn_deg`` to either side. ``announced``: as by a reset of PX4's filter, with a new epoch; else as by
    spoofed satellites, with equally wrong fixes and without a report (a filter that follows its receiver slides there within
    seconds). At the end it jumps back.
    """

    family: ClassVar[Family] = "pose"
    jump_m: Metres = 20.0
    turn_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    announced: bool = False


class HeadingReset(Fault, frozen=True, kw_only=True, tag="heading-reset"):
    """The filter of a vehicle that flies by satellites resets its heading by ``turn_deg`` to either side.

    PX4 v1.16.1 does so in every takeoff. Position and local frame stay as they are. Within seconds the heading is right again.
    """

    family: ClassVar[Family] = "vehicle"  # its position stays right: no violation is excused
    turn_deg: Annotated[float, Meta(gt=0.0, le=180.0)] = 6.0

    def check(self) -> str | None:
        """Reject ``for_s``, as a reset is instantaneous."""
        return "for_s: a reset happens once; remove it" if self.for_s is not None else None


class Drag(Fault, frozen=True, kw_only=True, tag="spoofed"):
    """Spoofed satellites slowly drag the vehicle's own position, and its fixes, away from the truth.

    The speed is ``speed_mps``, up to a distance of ``most_m``, in a direction drawn from the seed. The vehicle's velocity stays
    as the inertial sensors measure it. At the end the position jumps back.
    """

    family: ClassVar[Family] = "pose"
    speed_mps: Annotated[float, Meta(gt=0.0, le=20.0)] = 0.5
    most_m: Metres = 50.0


class Gust(Fault, frozen=True, kw_only=True, tag="gust"):
    """A gust of wind accelerates the vehicle by ``acceleration_mps2`` in a direction drawn from the seed."""

    family: ClassVar[Family] = "thrust"
    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=20.0)] = 2.0


class MotorFailure(Fault, frozen=True, kw_only=True, tag="motor"):
    """A motor fails: the vehicle descends at ``descent_mps``, spinning, and lies where it lands, disarmed. Permanent."""

    family: ClassVar[Family] = "thrust"
    descent_mps: Annotated[float, Meta(gt=0.0, le=20.0)] = 3.0

    def check(self) -> str | None:
        """Reject ``for_s``, as the failure is permanent."""
        return "for_s: a failed motor stays; remove it" if self.for_s is not None else None


class Battery(Fault, frozen=True, kw_only=True, tag="battery"):
    """The battery of a vehicle is low: its level is ``level`` (of 1), and in flight falls faster by ``drain_ps`` a second.

    This holds until the end of the fault. At level 0 the vehicle descends. ``lies``: only the reported level is wrong. ``acts``:
    the autopilot returns at 7 % and lands at 5 %, after 5 s in hold (PX4's COM_LOW_BAT_ACT = 3); else it only warns.
    """

    family: ClassVar[Family] = "vehicle"
    level: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.2
    drain_ps: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.001
    lies: bool = False
    acts: bool = True


class MavlinkLoss(Fault, frozen=True, kw_only=True, tag="mavlink-loss"):
    """Messages between an agent and its autopilot are lost, each independently: telemetry, setpoints, mode requests."""

    family: ClassVar[Family] = "vehicle"
    probability: Probability


class MavlinkImpaired(Fault, frozen=True, kw_only=True, tag="mavlink-impaired"):
    """The link between an agent and its autopilot is impaired packet by packet; live flights only.

    ``cut``: no packets. Packets take ``delay_s`` longer, plus up to ``jitter_s``; ``reorder``, ``duplicate``, ``corrupt``:
    probabilities to be held back for ``held_s``, to arrive twice within ``within_s``, to have wrong bytes.
    """

    family: ClassVar[Family] = "vehicle"
    direction: Literal["both", "to-agent", "to-vehicle"] = "both"
    cut: bool = False
    delay_s: Delay = 0.0
    jitter_s: Delay = 0.0
    reorder: Share = 0.0
    held_s: Delay = 0.1
    duplicate: Share = 0.0
    within_s: Delay = 0.1
    corrupt: Share = 0.0

    def check(self) -> str | None:
        """Check that at least one impairment is given; return an error text, or None."""
        wrong = self.cut or self.delay_s + self.jitter_s + self.reorder + self.duplicate + self.corrupt > 0.0
        return None if wrong else "cut, delay_s, jitter_s, reorder, duplicate, corrupt: give at least one"


class StreamLost(Fault, frozen=True, kw_only=True, tag="stream-lost"):
    """The autopilot stops sending one of its MAVLink messages; live flights only."""

    family: ClassVar[Family] = "vehicle"
    message: Literal[
        "HEARTBEAT",
        "ATTITUDE_QUATERNION",
        "LOCAL_POSITION_NED",
        "ODOMETRY",
        "GPS_RAW_INT",
        "DISTANCE_SENSOR",
        "EXTENDED_SYS_STATE",
        "SYS_STATUS",
        "BATTERY_STATUS",
        "ESTIMATOR_STATUS",
    ]


class Takeover(Fault, frozen=True, kw_only=True, tag="takeover"):
    """A safety pilot chooses a flight mode by remote control, and leaves the vehicle in hold at the end.

    In simulations in one process (lockstep) the pilot does not do so during a descent or a failsafe. In ``manual`` the pilot
    hovers; the autopilot ignores the agent, and acts on an empty battery only afterwards. After another mode it obeys new
    requests.
    """

    family: ClassVar[Family] = "vehicle"
    mode: Literal["manual", "hold", "return", "land"] = "hold"


class Disarm(Fault, frozen=True, kw_only=True, tag="disarm"):
    """A person on site disarms the vehicle by remote control as soon as it is armed, before takeoff. Live flights only."""

    family: ClassVar[Family] = "vehicle"


class Refusal(Fault, frozen=True, kw_only=True, tag="refusal"):
    """The autopilot refuses the agent's mode changes and arming; in offboard mode it still follows the setpoints."""

    family: ClassVar[Family] = "vehicle"
