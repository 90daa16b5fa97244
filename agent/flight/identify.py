"""Identification of a vehicle's response to setpoints from a recorded flight.

Drag comes from the tilt (``radron.agent.navigation.drag``), under agent or pilot alike. Dead time and attitude lag are fitted: a
cascade with PX4's default gains, given the vehicle's setpoints and localisation, is to tilt like the vehicle. The fit is least
squares of the thrust acceleration, on a grid that is refined once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.drone import ResponseConfig
from radron.agent.errors import FlightRecordError
from radron.agent.flight.response_records import SHORTEST_S, Piece, ResponseRecords
from radron.agent.geometry import Array
from radron.agent.navigation.drag import DragFilter

_DOUBT_PS = 1.0  # prior 1 sigma of the drag: uninformative
_KNOWN_PS = 0.15  # 1 sigma of the drag above which it counts as not found
_POSITION_PS, _VELOCITY_PS, _INTEGRATOR_PS2 = 0.95, 1.8, 0.4  # PX4's default MPC_XY_P, MPC_XY_VEL_P_ACC, MPC_XY_VEL_I_ACC
_DERIVATIVE_PS = 31.4  # low-pass of the derivative: 5 Hz
_STEP_S = 0.02
_MOST_MPS2 = 9.81  # 45 degrees of tilt
_DEAD_S = np.linspace(0.0, 0.4, 9)
_LAGS_S = np.linspace(0.05, 0.5, 7)
_DELAYS_S = np.arange(-0.2, 0.8, 0.01)  # range of lags behind the plan that are tried
Progress = Callable[[float], None]


class Identified(Struct, frozen=True):
    """The vehicle's response to setpoints, as identified from a flight.

    response: as for the drone file; drag_sigma_ps: 1 sigma of its drag; drag_found: False if the flight does not determine it, or
    tilt and motion are inconsistent. fit_mps2: RMS of the difference between the model's and the vehicle's tilt, as acceleration.
    late_s, gain: delay and gain of the vehicle's motion against its plan; None if no plans are recorded. flown_s: time flown by
    setpoints.
    """

    response: ResponseConfig
    drag_sigma_ps: float
    drag_found: bool
    fit_mps2: float
    late_s: float | None
    gain: float | None
    flown_s: float


def identify(records: ResponseRecords, assumed: ResponseConfig, progress: Progress) -> Identified:
    """Identify the vehicle's drag and lag from the records of a flight.

    ``assumed``: the response in the drone file; ``progress``: called with the share done, 0 to 1.

    Raises:
        FlightRecordError: too little was flown by setpoints.
    """
    pieces = records.pieces()
    if not pieces:
        raise FlightRecordError(f"the vehicle never flew by setpoints for {SHORTEST_S:g} s: there is nothing to fit")
    drag = DragFilter(assumed.drag_ps, _DOUBT_PS, walk_ps=0.0)
    for state in records.telemetry:
        if state.armed and state.in_air:
            drag.follow(state)
        else:
            drag.interrupt()
    found = drag.fits and drag.sigma_ps < _KNOWN_PS
    drag_ps = min(max(drag.drag_ps, 0.0), 3.0) if found else assumed.drag_ps
    dead_s, lag_s, fit_mps2 = _fitted(pieces, assumed.derivative_gain, progress)
    period_s = float(np.median(np.concatenate([np.diff(piece.told_s) for piece in pieces])))
    late_s, gain = _plan_delay(pieces)
    error_m = _tracking_error_m(pieces)
    response = replace(
        assumed,
        drag_ps=round(drag_ps, 2),
        lag_s=round(min(dead_s + 0.5 * period_s, 0.6), 3),
        attitude_lag_s=round(lag_s, 2),
        tracking_error_m=assumed.tracking_error_m if error_m is None else round(min(error_m, 10.0), 2),
    )
    flown_s = float(sum(piece.seen_s[-1] for piece in pieces))
    return Identified(response, drag.sigma_ps, found, fit_mps2, late_s, gain, flown_s)


def _fitted(pieces: Sequence[Piece], derivative: float, progress: Progress) -> tuple[float, float, float]:
    """Dead time (s), attitude lag (s) and RMS deviation (m/s2) of the cascade that tilts most like the vehicle."""
    dead_s, lags_s = _DEAD_S, _LAGS_S
    place = (0.0, 0.0)
    rms = np.inf
    for turn in (0, 1):
        dead, lag = (grid.ravel() for grid in np.meshgrid(dead_s, lags_s))
        squares, count = np.zeros(len(dead)), 0
        for number, piece in enumerate(pieces):
            modelled, seen = _thrust_responses(piece, dead, lag, derivative)
            apart = modelled - seen[:, None]
            squares += np.einsum("tkx,tkx->k", apart, apart)
            count += len(apart)
            progress((turn + (number + 1) / len(pieces)) / 2.0)
        best = int(np.argmin(squares))
        place, rms = (float(dead[best]), float(lag[best])), float(np.sqrt(squares[best] / count))
        dead_s = np.unique(np.maximum(0.0, place[0] + np.linspace(-0.05, 0.05, 11)))
        lags_s = np.unique(np.maximum(0.02, place[1] + np.linspace(-0.075, 0.075, 7)))
    return *place, rms


def _thrust_responses(piece: Piece, dead: Array, lag: Array, derivative: float) -> tuple[Array, Array]:
    """Thrust accelerations (T, K, 2) of K cascades given the vehicle's inputs, and the vehicle's own (T, 2).

    Both without their mean: the initial integrator and the attitude offset are unknown.
    """
    times = np.arange(0.0, piece.seen_s[-1], _STEP_S)
    seen = np.stack(
        [np.column_stack([np.interp(times, piece.seen_s, piece.seen[:, kind, axis]) for axis in (0, 1)]) for kind in (0, 1, 2)],
        axis=1,
    )
    thrust = np.repeat(seen[0, None, 2], len(dead), axis=0)
    integral, damped = np.zeros_like(thrust), np.zeros(2)
    decay = (1.0 - np.exp(-_STEP_S / lag))[:, None]
    smoothing = 1.0 - np.exp(-_STEP_S * _DERIVATIVE_PS)
    found = np.empty((len(times), *thrust.shape))
    held = np.maximum(np.searchsorted(piece.told_s, times[:, None] - dead, side="right") - 1, 0)
    rates = np.gradient(seen[:, 1], _STEP_S, axis=0)
    for step, index in enumerate(held):
        found[step] = thrust
        told, turn = piece.told[index], _STEP_S * piece.told_yaw_rps[index]
        lacking = told[:, 1] + _POSITION_PS * (told[:, 0] - seen[step, 0]) - seen[step, 1]
        damped = damped + smoothing * (rates[step] - damped)
        asked = told[:, 2] + _VELOCITY_PS * lacking + integral - derivative * damped
        limited = asked * np.minimum(1.0, _MOST_MPS2 / np.maximum(np.hypot(asked[:, 0], asked[:, 1]), 1e-9))[:, None]
        integral = integral + _STEP_S * _INTEGRATOR_PS2 * (lacking - 2.0 / _VELOCITY_PS * (asked - limited))
        turned = np.column_stack((-turn * thrust[:, 1], turn * thrust[:, 0]))  # by the yaw rate that is fed forward
        thrust = thrust + decay * (limited - thrust) + turned
    return found - found.mean(axis=0), seen[:, 2] - seen[:, 2].mean(axis=0)


def _plan_delay(pieces: Sequence[Piece]) -> tuple[float | None, float | None]:
    """Delay (s) and gain of the vehicle's motion against its plan, by least squares of velocities."""
    best: tuple[float, float | None, float | None] = (np.inf, None, None)
    for delay_s in _DELAYS_S:
        product = square = rest = 0.0
        for piece in pieces:
            known = np.isfinite(piece.planned[:, 0, 0])
            if known.sum() < 2:
                continue
            late = piece.seen_s - delay_s
            inside = known & (late >= piece.seen_s[known][0]) & (late <= piece.seen_s[known][-1])
            for axis in (0, 1):
                planned = np.interp(late[inside], piece.seen_s[known], piece.planned[known, 1, axis])
                seen = piece.seen[inside, 1, axis]
                product, square, rest = product + planned @ seen, square + planned @ planned, rest + seen @ seen
        if square > 0.0 and (misfit := 1.0 - product**2 / (square * rest)) < best[0]:
            best = misfit, float(delay_s), product / square
    return best[1:]


def _tracking_error_m(pieces: Sequence[Piece]) -> float | None:
    apart = np.concatenate([piece.seen[:, 0] - piece.planned[:, 0] for piece in pieces])
    squares = np.einsum("tx,tx->t", apart, apart)
    squares = squares[np.isfinite(squares)]
    return float(np.sqrt(squares.mean())) if len(squares) else None
