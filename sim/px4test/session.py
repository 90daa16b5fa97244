"""Sessions of flight tests, one after another: vehicles, world and agents are started for each, and end with it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from radron.agent.errors import RadronError
from radron.sim.live.places import Places
from radron.sim.live.runfolder import live_mission
from radron.sim.live.swarm import Swarm, live_swarm
from radron.sim.live.view import View, console_view
from radron.sim.px4test.autopilots import autopilots
from radron.sim.px4test.flights import gnss_lost, killed, missions
from radron.sim.px4test.px4 import Px4
from radron.sim.px4test.rows import Report, Row
from radron.sim.scenario import Scenario, load_scenario, override

MAX_SESSION_S = 420.0  # limit of a session; two missions take four minutes
PX4_READY_S = 180.0  # PX4 boots, and its filter settles; minutes where the machine is starved
Flights = Callable[[Swarm, int, float, Path], Awaitable[list[Row]]]


class Session(NamedTuple):
    """The flight tests that are flown with one start of the swarm. settings: changes of the demo scenario."""

    name: str
    fly: Flights
    settings: dict[str, str | float]


SESSIONS = {
    "missions": Session("two missions", missions, {}),
    "killed": Session("an agent killed", killed, {"mission.track.duration_s": 15.0}),
    "gnss": Session("GNSS lost", gnss_lost, {"mission.track.duration_s": 30.0}),  # longer than the outage
}


async def fly_all(px4: Px4 | None, seed: int, chosen: Collection[str], folder: Path, attempts: int = 1) -> Report:
    """Fly the chosen sessions of flight tests, and return the report.

    A session that breaks down counts as failed; the other sessions are flown nevertheless.

    Args:
        px4: flies the vehicles; None: they are emulated.
        seed: seed of the world's random numbers.
        chosen: names of sessions.
        folder: for all files; with a folder for each session and each further attempt.
        attempts: most attempts at a failing session; the report contains earlier failures.
    """
    began_s = time.monotonic()
    rows: list[Row] = []
    truths: set[str] = set()
    repeated: list[Row] = []
    for key in chosen:
        for attempt in range(1, attempts + 1):
            flown = await _fly(SESSIONS[key], px4, seed, folder / (key if attempt == 1 else f"{key}-{attempt}"), truths)
            failed = [row for row in flown if not row.passed]
            if not failed or attempt == attempts:
                break
            repeated += failed
        rows += flown
    vehicles = "emulated vehicles" if px4 is None else f"PX4, {px4.describe()}"
    return Report(
        vehicles=vehicles,
        truth=", ".join(sorted(truths)),
        wall_s=time.monotonic() - began_s,
        rows=tuple(rows),
        repeated=tuple(repeated),
    )


async def _fly(session: Session, px4: Px4 | None, seed: int, folder: Path, truths: set[str]) -> list[Row]:
    """Fly one session; ``truths`` receives the source of the vehicles' positions."""
    scenario = override(load_scenario("demo"), session.settings)
    with console_view(session.name) as view:
        try:
            async with asyncio.timeout(MAX_SESSION_S), _swarm(px4, scenario, seed, folder, view) as swarm:
                try:
                    return await session.fly(swarm, seed, PX4_READY_S, folder)
                finally:
                    truths |= {report.truth for report in swarm.operator.world.truth.vehicles}
        except TimeoutError:
            return [Row(session.name, (f"not over within {MAX_SESSION_S:g} s",))]
        except RadronError as error:
            return [Row(session.name, (str(error),))]


@asynccontextmanager
async def _swarm(px4: Px4 | None, scenario: Scenario, seed: int, folder: Path, view: View) -> AsyncIterator[Swarm]:
    if px4 is None:
        async with live_swarm(scenario, seed, folder, Places.here(len(scenario.mission.drones)), view) as swarm:
            yield swarm
        return
    launched = replace(scenario, mission=live_mission(scenario, seed)).mission
    view.say(f"starting {len(launched.drones)} instances of PX4, {px4.describe()}")
    async with autopilots(px4, launched, folder) as places, live_swarm(scenario, seed, folder, places, view) as swarm:
        yield swarm
