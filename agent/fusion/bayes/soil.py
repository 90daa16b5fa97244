"""What a camera counts of photons that soil and air scatter beside a source on the ground, and of the soil's own.

Per photon from the source, as of ``response``, with f the facing, s the sine of the source's depression below the horizon, and
``turn``, ``near``, ``steep`` and ``air`` the table's: a channel counts of scattered photons

    phi(D) [(near + steep s) (1 + turn (f - 0.565)) + air mu D]  and of photons that vehicle and mount scatter, ``BODY_SHARE``.

The table is that of ``python -m benchmarks.ground_response --events 400 --photons 60000``: a transport code of its own, which is
not the simulation's, folded with the simulated sensor's response. Unknown on board are kind, moisture and roughness of the
ground, and how deep the source lies: a factor of the table of 0.5 to 1.5, which moves the activity by ``SIGMA``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agent.geometry import Array

BODY_SHARE = 0.25  # vehicle and mount scatter a quarter of what the empty surroundings do in ``response``
SIGMA = 0.12  # of the log activity
_MEAN_FACING = 0.565  # mean of f over all headings, the source 5 to 45 degrees below the horizon
_OTHER_PS = 0.2  # background of another origin than soil, as a share of that of ``response``


@dataclass(frozen=True, slots=True)
class SoilChannel:
    """One kind of event. near_mm2, steep_mm2, air_mm2: effective areas. turn: see above. background_ps: per second."""

    near_mm2: float
    steep_mm2: float
    air_mm2: float
    turn: float
    background_ps: float


def scattered_by_soil(
    channels: tuple[SoilChannel, ...],
    body_mm2: Array,
    fluence: Array,
    depth: Array,
    steepness: Array | float,
    facing: Array | float = _MEAN_FACING,
) -> Array:
    """Expected counts (..., C) of scattered photons. body_mm2: (C,). depth: (...) mu D. The others as of ``Response.parts``."""
    near, steep, air, turn = np.array([(c.near_mm2, c.steep_mm2, c.air_mm2, c.turn) for c in channels]).T
    s, f, depth = (np.asarray(each)[..., None] for each in (steepness, facing, depth))
    mm2 = np.maximum(near + steep * s, 0.0) * (1.0 + turn * (f - _MEAN_FACING)) + air * depth + body_mm2
    result: Array = mm2 * fluence[..., None]
    return result


def background_over(channels: tuple[SoilChannel, ...], alone_ps: Array) -> Array:
    """(C,) background per second over soil. alone_ps: (C,) without it."""
    result: Array = np.array([channel.background_ps for channel in channels]) + _OTHER_PS * alone_ps
    return result


def _soil(*rows: tuple[float, ...]) -> tuple[SoilChannel, SoilChannel]:
    """Partial- and full-energy events, of the rows of hits, full-energy events and coincidences: see ``Response.apart``."""
    hits, full, pairs = (np.array([*row[:3], row[3] * (row[0] + 0.5 * row[1]), row[4]]) for row in rows)
    partial = hits - full - pairs
    return _channel(partial), _channel(full)


def _channel(row: Array) -> SoilChannel:
    near, steep, air, turned, background_ps = row.tolist()
    return SoilChannel(near, steep, air, turned / (near + 0.5 * steep), background_ps)


SOIL: dict[str, tuple[SoilChannel, SoilChannel]] = {
    "Cs-137": _soil(
        (-0.471, 54.6, 244.0, 0.52, 4.5),
        (0.0604, -0.0665, 1.12, 0.20, 0.0446),
        (0.42, 2.88, 10.1, 0.09, 0.228),
    ),
}
