#!/usr/bin/env python3
"""Stands in for PX4's binary with an emulated vehicle that flies: takes the arguments, environment and ports that PX4 does."""

import asyncio
import os
import sys
import time

import numpy as np

from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Datum, Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.world.localization import Localization, LocalizationTruth

STEP_S = 0.01


async def fly(instance: int) -> None:
    home = Datum(
        latitude_deg=float(os.environ["PX4_HOME_LAT"]),
        longitude_deg=float(os.environ["PX4_HOME_LON"]),
        altitude_m=float(os.environ["PX4_HOME_ALT"]),
    )
    told = {name.removeprefix("PX4_PARAM_"): float(value) for name, value in os.environ.items() if name.startswith("PX4_PARAM_")}
    # Vehicle i of a fleet is system i + 1: earlier vehicles have no links.
    configs = [Px4Config(onboard=None, ground_station=None) for _ in range(instance)]
    configs.append(
        Px4Config(onboard=("127.0.0.1", 14540 + instance), ground_station=("127.0.0.1", 14550), parameters=told),
    )
    count, rng = len(configs), np.random.default_rng(instance)
    motion = Multirotors(MultirotorTruth(), np.zeros((count, 3)), np.zeros(count), STEP_S, rng)
    error = Localization(LocalizationTruth(), count, STEP_S, rng)
    fleet = Px4Fleet(configs, motion, error, STEP_S, rng, datum=home)
    await fleet.start()
    due_s = time.monotonic()
    while True:
        fleet.step()
        due_s += STEP_S
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    asyncio.run(fly(int(sys.argv[sys.argv.index("-i") + 1])))
