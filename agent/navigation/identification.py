"""Identification of the vehicle's response to setpoints in flight: drag by the tilt, lag and tracking error by the plans."""

from __future__ import annotations

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.drone import ResponseConfig
from radron.agent.motion.feedforward import DEVIATION_S, Deviation
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.drag import DragFilter
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

BAD_M = 1.2  # RMS deviation: twice that of a vehicle on a well flown circle
_RAMP_PS2 = 0.5  # rate limit of the applied drag: the autopilot's integrator has to follow
_REMEMBERED_SIGMA_PS = 0.1  # 1 sigma of a drag identified before a restart
_SURE_PS = 0.12  # 1 sigma of the drag below which the remaining lag is identified
_LAG_S = 15.0  # averaging time of the lag
_LAG_MPS = 2.0  # at higher speeds a lag exceeds the position errors
_ODDEST_LAG_S = 0.5  # limit of a single measurement
_LEAST_LAG_S, _MOST_LAG_S = 0.0, 0.6


class FoundResponse(Struct, frozen=True):
    """Identified response: see ``ResponseConfig``. A restarted agent continues with it.

    A state file has null for a number that is not finite.
    """

    drag_ps: float | None
    lag_s: float | None
    tracking_error_m: float | None

    def of(self, config: ResponseConfig) -> ResponseConfig | None:
        """Return the configured response with the identified values; None if a vehicle cannot have it."""
        try:
            return msgspec.convert(msgspec.structs.asdict(config) | msgspec.structs.asdict(self), ResponseConfig)
        except msgspec.ValidationError:
            return None


class ResponseEstimator:
    """Identification of the response of one vehicle. ``response``: the applied one."""

    def __init__(self, config: ResponseConfig) -> None:
        """``config``: the drone file's values."""
        self._config = config
        self.response = config
        self._drag = DragFilter(config.drag_ps)
        self._deviation = Deviation(config.tracking_error_m)
        self._stamp_ns: int | None = None

    def remember(self, found: FoundResponse) -> None:
        """Continue with the response identified before a restart; with the drone file's if a vehicle cannot have it."""
        response = found.of(self._config)
        if response is None:
            return
        self.response = response
        self._drag = DragFilter(response.drag_ps, _REMEMBERED_SIGMA_PS)
        self._deviation = Deviation(response.tracking_error_m)

    @property
    def found(self) -> FoundResponse | None:
        """The present response for a restarted agent, rounded; None if a vehicle cannot have it."""
        now = self.response
        found = FoundResponse(round(now.drag_ps, 2), round(now.lag_s, 3), round(now.tracking_error_m, 2))
        return None if found.of(self._config) is None else found

    @property
    def problem(self) -> CodedText | None:
        """Problem of the vehicle's response, or None."""
        rms_m = self._deviation.rms_m
        if rms_m <= BAD_M:
            return None
        text = f"the vehicle does not follow its plans: RMS deviation {rms_m:.1f} m over {DEVIATION_S:.0f} s"
        return CodedText(Code.PLAN_NOT_FOLLOWED, text)

    def follow(self, vehicle: VehicleState) -> None:
        """Process telemetry, under any control."""
        if not (vehicle.armed and vehicle.in_air):
            self._drag.interrupt()
            self._stamp_ns = None
            return
        self._drag.follow(vehicle)
        elapsed_s = (vehicle.stamp_ns - self._stamp_ns) * 1e-9 if self._stamp_ns is not None else 0.0
        self._stamp_ns = vehicle.stamp_ns
        wanted = min(max(self._drag.drag_ps, 0.0), 3.0) if self._drag.fits else self._config.drag_ps
        known, most = self.response.drag_ps, _RAMP_PS2 * min(elapsed_s, 1.0)
        if wanted != known:
            self.response = replace(self.response, drag_ps=known + min(max(wanted - known, -most), most))

    def compare(self, vehicle: VehicleState, planned: PeerState) -> None:
        """Compare the vehicle's state with its planned one at the same time; only while it flies by setpoints."""
        x, y = (vehicle.position_m[axis] - planned.position[axis] for axis in (0, 1))
        elapsed_s = self._deviation.add(vehicle.stamp_ns, x, y)
        u, v, _ = planned.velocity
        square = u * u + v * v
        lag_s = self.response.lag_s
        if (self._drag.sigma_ps < _SURE_PS or not self._drag.fits) and square > 0.0:
            late_s = min(max(-(x * u + y * v) / square, -_ODDEST_LAG_S), _ODDEST_LAG_S)
            share = elapsed_s / _LAG_S * square / (square + _LAG_MPS**2)
            lag_s = min(max(lag_s + share * late_s, _LEAST_LAG_S), _MOST_LAG_S)
        self.response = replace(self.response, lag_s=lag_s, tracking_error_m=self._deviation.rms_m)
