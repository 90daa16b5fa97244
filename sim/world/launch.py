"""Positions from which the simulated vehicles are launched."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from radron.agent.config.launchplaces import check_launch_places
from radron.agent.config.mission import Corner, MissionConfig
from radron.agent.errors import ConfigError
from radron.sim.geometry import Array

_DENSITY = 0.35  # density of discs that sequential random placement reaches soon; its limit is 0.55
_DRAWS = 1000  # per vehicle, before the placement starts again
_ATTEMPTS = 100


class StartTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the vehicles are launched: at the mission's launch places, or at random places in a square.

    The square is +-``scatter_m`` around ``centre_m``; the places are at least twice the mission's separation apart.
    """

    scatter_m: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.0
    centre_m: Corner = (0.0, 0.0)

    def check(self, mission: MissionConfig, where: str) -> None:
        """Raise ConfigError if two launch places are too close, or the square is too small for the swarm."""
        if self.scatter_m <= 0.0:
            check_launch_places(mission, f"{where}: mission")
            return
        count = len(mission.drones)
        # Discs of this diameter in a square that is larger by a radius on each side.
        least = 0.5 * _apart_m(mission) * ((count * np.pi / 4.0 / _DENSITY) ** 0.5 - 1.0)
        if count > 1 and self.scatter_m < least:
            raise ConfigError(
                f"{where}: start.scatter_m = {self.scatter_m:g} is too small for {count} drones {_apart_m(mission):g} m apart; "
                f"give at least {np.ceil(least * 10.0) / 10.0:g}, or 0 for the launch places"
            )


def launch_places(start: StartTruth, mission: MissionConfig, rng: np.random.Generator) -> Array:
    """Return the launch positions of N vehicles, (N, 3) in the mission frame.

    Raises:
        ConfigError: no positions with sufficient distances were found.
    """
    if start.scatter_m <= 0.0:
        return np.array([drone.origin_m for drone in mission.drones], dtype=np.float64)
    for _ in range(_ATTEMPTS):
        chosen = _scatter(start, len(mission.drones), _apart_m(mission), rng)
        if chosen is not None:
            return chosen
    raise ConfigError(f"start.scatter_m = {start.scatter_m:g}: no room for {len(mission.drones)} drones; give more")


def _scatter(start: StartTruth, count: int, apart_m: float, rng: np.random.Generator) -> Array | None:
    """Draw positions one after another; None if the first ones leave no room for the others."""
    chosen: list[Array] = []
    for _ in range(count):
        for _ in range(_DRAWS):
            place = np.append(rng.uniform(-start.scatter_m, start.scatter_m, 2) + start.centre_m, 0.0)
            if all(np.hypot(*(place - other)[:2]) > apart_m for other in chosen):
                chosen.append(place)
                break
        else:
            return None
    return np.array(chosen)


def _apart_m(mission: MissionConfig) -> float:
    return 2.0 * mission.limits.separation_m
