"""Identification of a vehicle's response to setpoints in flight: drag by the tilt, lag and tracking error by the plans."""

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
_RAMP_PS2 = 0.5  # rate limit of the drag in use: the autopilot's integrator has to follow its changes
_REMEMBERED_SIGMA_PS = 0.1  # 1 sigma of a drag identified before a restart
_SURE_PS = 0.12  # the lag is identified once the 1 sigma of the drag is below this
_LAG_S = 15.0  # averaging time of the lag
_LAG_MPS = 2.0  # below this speed, position errors exceed the effect of a lag, and it is weighted less
_ODDEST_LAG_S = 0.5  # a single measurement of the lag is limited to this
_LEAST_LAG_S, _MOST_LAG_S = 0.0, 0.6


class FoundResponse(Struct, frozen=True):
    """Identified response of a vehicle, stored for a restarted agent: drag (1/s), lag (s), RMS deviation from plans (m), as in
    ``ResponseConfig``. None: the state file has null, for a number that was not finite.
    """

    drag_ps: float | None
    lag_s: float | None
    tracking_error_m: float | None

    def of(self, config: ResponseConfig) -> ResponseConfig | None:
        """Return the response of the drone file with the identified values in it; None if these are out of range."""
        try:
            return msgspec.convert(msgspec.structs.asdict(config) | msgspec.structs.asdict(self), ResponseConfig)
        except msgspec.ValidationError:
            return None


class ResponseEstimator:
    """Identification of the response of one vehicle. ``response``: the one in use at present."""

    def __init__(self, config: ResponseConfig) -> None:
        """``config``: the response by the drone file, with which it begins."""
        self._config = config
        self.response = config
        self._drag = DragFilter(config.drag_ps)
        self._deviation = Deviation(config.tracking_error_m)
        self._stamp_ns: int | None = None

    def remember(self, found: FoundResponse) -> None:
        """Continue with the response identified before a restart of the agent; ignore it if its values are out of range."""
        response = found.of(self._config)
        if response is None:
            return
        self.response = response
        self._drag = DragFilter(response.drag_ps, _REMEMBERED_SIGMA_PS)
        self._deviation = Deviation(response.tracking_error_m)

    @property
    def found(self) -> FoundResponse | None:
        """The present response to be stored for a restarted agent, rounded; None if its values are out of range."""
        now = self.response
        found = FoundResponse(round(now.drag_ps, 2), round(now.lag_s, 3), round(now.tracking_error_m, 2))
        return None if found.of(self._config) is None else found

    @property
    def problem(self) -> CodedText | None:
        """Problem for the operator that the vehicle does not follow its plans; None without it."""
        rms_m = self._deviation.rms_m
        if rms_m <= BAD_M:
            return None
        text = f"the vehicle does not follow its plans: RMS deviation {rms_m:.1f} m over {DEVIATION_S:.0f} s"
        return CodedText(Code.PLAN_NOT_FOLLOWED, text)

    def follow(self, vehicle: VehicleState) -> None:
        """Update the drag with telemetry, also while the agent does not fly the vehicle."""
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
        """Update lag and tracking error with the vehicle's state, and its ``planned`` state at the same time, both in the local
        frame. To be called only while the vehicle flies by setpoints.
        """
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
