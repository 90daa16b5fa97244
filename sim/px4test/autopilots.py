"""Real PX4 autopilots with their built-in vehicle simulation (SIH) for a flight test: one instance per drone, on loopback.

Instance i is MAVLink system i + 1; its onboard link goes to UDP port 14540 + i, its ground-station link to 14550. The environment
variables set here are read by PX4's own start script (init.d-posix/rcS and px4-rc.sihsim).
"""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import pymap3d
from msgspec import convert, to_builtins

from radron.agent.config.mission import MissionConfig
from radron.sim.live.crew import crew_parameters
from radron.sim.live.places import Places
from radron.sim.live.processes import Child
from radron.sim.live.runfolder import LOCAL
from radron.sim.live.worldprocess import LiveError
from radron.sim.px4test.px4 import Px4, container
from radron.sim.vehicle.px4.config import Datum

ONBOARD_PORT, GROUND_STATION_PORT = 14540, 14550
MAX_INSTANCES = 10  # further instances would share a port
PX4_STOP_S = 5.0
_MODEL, _AIRFRAME = "sihsim_quadx", "10040"
_EARLY_S = 1.0  # an instance that cannot start has ended by then
_FENCE_RETURN = 3  # GF_ACTION


def variables_of(mission: MissionConfig, place: Sequence[float]) -> dict[str, str]:
    """Return the environment variables of a PX4 instance whose vehicle starts at ``place`` (east, north, up; mission frame)."""
    datum = Datum() if mission.datum is None else convert(to_builtins(mission.datum), Datum)
    origin = (datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    latitude_deg, longitude_deg, altitude_m = pymap3d.enu2geodetic(*place, *origin)
    parameters = crew_parameters(mission, place) | {"GF_ACTION": _FENCE_RETURN}
    return {
        "PX4_SIM_MODEL": _MODEL,
        "PX4_SYS_AUTOSTART": _AIRFRAME,
        "PX4_HOME_LAT": f"{latitude_deg:.9f}",
        "PX4_HOME_LON": f"{longitude_deg:.9f}",
        "PX4_HOME_ALT": f"{altitude_m:.3f}",
        **{f"PX4_PARAM_{name}": f"{value:g}" if value < 1e6 else f"{value:.0f}" for name, value in parameters.items()},
    }


@asynccontextmanager
async def autopilots(px4: Px4, mission: MissionConfig, folder: Path) -> AsyncIterator[Places]:
    """Start a PX4 instance for each drone of a mission; they end with the block, whatever happens.

    Args:
        px4: binary or image.
        mission: with the actual launch places.
        folder: for the instances' working folders, which are created anew: parameters of an earlier flight are removed.

    Raises:
        LiveError: an instance ends at once; the error contains its last output.
    """
    if len(mission.drones) > MAX_INSTANCES:
        raise LiveError(
            f"{len(mission.drones)} drones: PX4's instances have onboard links of their own for {MAX_INSTANCES} at most"
        )
    started: list[Child] = []
    try:
        for instance, drone in enumerate(mission.drones):
            started.append(await _start(px4, instance, variables_of(mission, drone.origin_m), folder / f"px4-{instance}"))
        await asyncio.sleep(_EARLY_S)
        for child in started:
            if child.exit_code is not None:
                raise LiveError(f"{child.name} ended with code {child.exit_code}: {child.last_line()}")
        ports = [ONBOARD_PORT + instance for instance in range(len(started))]
        yield Places.with_vehicles(ports, (LOCAL, GROUND_STATION_PORT))
    finally:
        await asyncio.gather(*(child.stop(PX4_STOP_S) for child in started))
        if px4.image is not None:
            await _remove(len(started))


async def _start(px4: Px4, instance: int, variables: Mapping[str, str], folder: Path) -> Child:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    command = px4.command(instance, variables)
    return await Child.start(f"PX4 {instance}", command, log=folder / "px4.log", folder=folder, extra=variables)


async def _remove(count: int) -> None:
    """Remove containers that outlived the command that ran them."""
    names = [container(instance) for instance in range(count)]
    quiet = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec("docker", "rm", "--force", *names, stdout=quiet, stderr=quiet)
    await process.wait()
