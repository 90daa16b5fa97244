"""Emulated PX4s as a process of their own, in real time; a JSON line of reports 20 times a second on the standard output.

The argument is JSON: ``ports`` (of the agents, one for each vehicle), ``places`` (x, y of the launches) and, if wanted,
``unhealthy`` (by index, the text of an arming check that never passes) and ``parameters``. The process ends with its standard
input.
"""

import asyncio
import json
import sys
import time
from contextlib import suppress

import msgspec
import numpy as np

from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Faults, Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.world.localization import Localization, LocalizationTruth

STEP_S = 0.01
REPORT_STEPS = 5
# Parameters that the preflight check asks for, different from PX4's own defaults.
PARAMETERS = {"COM_OBL_RC_ACT": 3.0, "NAV_RCL_ACT": 2.0, "GF_MAX_HOR_DIST": 500.0, "RTL_RETURN_ALT": 20.0}
PARAMETERS |= {"EKF2_NOAID_TOUT": 2_000_000.0}


async def fly(
    ports: list[int], places: list[tuple[float, float]], unhealthy: dict[str, str], parameters: dict[str, float]
) -> None:
    rng = np.random.default_rng(1)
    position = np.array([(x, y, 0.0) for x, y in places])
    motion = Multirotors(MultirotorTruth(), position, np.zeros(len(ports)), STEP_S, rng)
    configs = [
        Px4Config(
            onboard=("127.0.0.1", port), parameters=PARAMETERS | parameters, faults=Faults(unhealthy=unhealthy.get(str(index)))
        )
        for index, port in enumerate(ports)
    ]
    fleet = Px4Fleet(configs, motion, Localization(LocalizationTruth(), len(ports), STEP_S, rng), STEP_S, rng)
    await fleet.start()
    due_s = time.monotonic()
    step = 0
    while True:
        fleet.step()
        step += 1
        if step % REPORT_STEPS == 0:
            reports = zip(fleet.reports(), motion.position_m.tolist(), strict=True)
            print(json.dumps([msgspec.to_builtins(report) | {"position_m": place} for report, place in reports]), flush=True)
        due_s += STEP_S
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))


async def main() -> None:
    loop = asyncio.get_running_loop()
    flying = asyncio.ensure_future(fly(**json.loads(sys.argv[1])))
    loop.add_reader(sys.stdin, flying.cancel)
    await flying


if __name__ == "__main__":
    with suppress(asyncio.CancelledError):
        asyncio.run(main())
