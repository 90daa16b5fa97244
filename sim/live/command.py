"""The command ``live``: one flight of the swarm as real processes."""

from __future__ import annotations

import asyncio
import shutil
import signal
import sys
import tempfile
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import msgspec
import typer

from radron.agent.errors import ConfigError
from radron.agent.extras import LIBRARIES, lacking
from radron.sim.commands.flights import Drones, Estimator, Law, Settings, check_json, checked, with_drones, write_json
from radron.sim.runfile import make_folder, write_text

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from radron.sim.live.places import Places

T = TypeVar("T")


def live(
    *,
    scenario: Annotated[str, typer.Argument(help="Name of a shipped scenario, or a file.")] = "demo",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the world's randomness.")] = 1,
    drones: Drones = None,
    estimator: Estimator = None,
    law: Law = None,
    settings: Settings = None,
    json: Annotated[
        str | None, typer.Option(metavar="OUT", help="Write the result as one flat JSON object; '-': to standard output.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write result.json, agents.json, pictures, and the agents' logs and records."),
    ] = None,
    external: Annotated[bool, typer.Option("--external", help="The agents run elsewhere; give the next two options.")] = False,
    agent_hosts: Annotated[
        str | None,
        typer.Option(
            envvar="RADRON_SIM_AGENT_HOSTS", help="Hosts to which vehicle 1, 2, ... sends MAVLink, port 14540; comma-separated."
        ),
    ] = None,
    mesh: Annotated[
        str | None, typer.Option(envvar="RADRON_SIM_MESH", help="The agents' endpoints, as tls/10.7.1.11:7447; comma-separated.")
    ] = None,
    identity: Annotated[
        Path | None,
        typer.Option(
            envvar="RADRON_SIM_IDENTITY",
            metavar="FOLDER",
            help="With --external: the operator's certificate; without, certificates are made for this flight, in OUT/agents.",
        ),
    ] = None,
    page: Annotated[bool, typer.Option("--page", help="Serve the operator's page meanwhile; its address is printed.")] = False,
    ground_station: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="A ground station of the emulated vehicles, such as QGroundControl at 127.0.0.1:14550."
        ),
    ] = None,
    bind: Annotated[
        str,
        typer.Option(
            envvar="RADRON_SIM_BIND",
            help="With --external: address at which the cameras' feeds 1, 2, ... listen, ports 5600, ...",
        ),
    ] = "0.0.0.0",
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Links are not encrypted and nothing is signed: to compare.")
    ] = False,
    vehicles: Annotated[
        Literal["emulated", "mavlink"],
        typer.Option(
            help="mavlink (with --external): flown elsewhere, such as by PX4's own simulation, and observed at UDP port 14550."
        ),
    ] = "emulated",
) -> None:
    """Fly one mission with real agents: a process for each drone, Zenoh between them, and MAVLink to emulated vehicles."""
    from radron.sim.commands.console import err, say  # noqa: PLC0415  (heavy imports wait until they are needed)
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    case = checked([scenario], {}, with_drones(settings, drones), [estimator] if estimator else [], law)[0]
    check_json(json)
    if missing := lacking(*LIBRARIES["sim"]):  # some are first imported by child processes
        raise ConfigError(missing)
    if page and any(find_spec(name) is None for name in ("radron.station", "uvicorn", "starlette")):
        raise ConfigError("--page: the station is not installed: pip install 'radron[sim,station]'")
    places = _places(external, agent_hosts, mesh, bind, vehicles, len(case.scenario.mission.drones), identity, insecure)
    station = _address(ground_station, vehicles)
    if out is not None:
        make_folder(out)

    from radron.sim.campaign.report import sentence, write_flight  # noqa: PLC0415
    from radron.sim.live.report import agreement, judged_by  # noqa: PLC0415
    from radron.sim.live.swarm import fly_live  # noqa: PLC0415
    from radron.sim.live.view import console_view  # noqa: PLC0415
    from radron.sim.scenario import chosen  # noqa: PLC0415

    flown = chosen(case.scenario, estimator, law)
    with tempfile.TemporaryDirectory(prefix="radron-") if out is None else nullcontext(str(out)) as folder:
        with console_view(case.name) as view:
            flight, report = run_live(fly_live(flown, seed, Path(folder), places, view, page, station))
        to = err if json == "-" else stdout
        say(sentence(flight.result, flight.trace), to)
        say(agreement(report), to)
        if judge := judged_by(report):
            say(judge, to)
        write_json(json, flight.result)
        if out is not None:
            written = [*write_flight(out, flight), out / "agents.json"]
            write_text(written[-1], msgspec.json.format(msgspec.json.encode(report).decode(), indent=2) + "\n")
            say(f"written to {out}: {', '.join(path.name for path in written)}; recordings in {out}/agents")
            if not external:
                say(f"to look at the flight in a browser: {_beside('radron-station')} open {out}/agents/*/flight/*.mcap")


def _beside(program: str) -> str:
    """Return the call of another radron program: with this one's folder, unless the path finds it."""
    own = Path(sys.argv[0]).with_name(program)
    return str(own) if shutil.which(program) is None and own.is_file() else program


def _places(
    external: bool,
    agent_hosts: str | None,
    mesh: str | None,
    bind: str,
    vehicles: str,
    drones: int,
    identity: Path | None = None,
    insecure: bool = False,
) -> Places | None:
    """Return hosts and endpoints of the agents; None: on this machine, with encrypted links."""
    from radron.sim.live.places import Places  # noqa: PLC0415

    if not external:
        if vehicles != "emulated":
            raise ConfigError("--vehicles mavlink: needs --external")
        return Places.here(drones, encrypted=False) if insecure else None
    if insecure:
        raise ConfigError(
            "--insecure: not with --external; give --mesh the endpoints of agents with mesh.insecure = true, tcp/..."
        )
    hosts, endpoints = _listed(agent_hosts), _listed(mesh)
    if len(hosts) != drones:
        raise ConfigError(f"--agent-hosts: {len(hosts)} given for {drones} drones; give one for each, separated by commas")
    if not endpoints:
        raise ConfigError("--external needs --mesh with the endpoints of the agents, such as tls/10.7.1.11:7447")
    return Places.elsewhere(hosts, endpoints, bind, emulated=vehicles == "emulated", operator=identity)


def _address(given: str | None, vehicles: str) -> tuple[str, int] | None:
    """Return host and port of a ground station."""
    if given is None:
        return None
    if vehicles != "emulated":
        raise ConfigError("--ground-station: vehicles flown elsewhere have a link of their own to it; give it to emulated ones")
    host, _, port = given.rpartition(":")
    if not host or not port.isascii() or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise ConfigError(f"--ground-station {given}: give host and UDP port, such as 127.0.0.1:14550")
    return host, int(port)


def _listed(text: str | None) -> tuple[str, ...]:
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())


def run_live(flight: Coroutine[None, None, T]) -> T:
    """Run a live flight; a signal stops the flight cleanly and ends the command with the signal's exit code."""
    received: list[int] = []

    async def fly() -> T:
        task = asyncio.ensure_future(flight)
        loop = asyncio.get_running_loop()

        def stop(number: int) -> None:
            received.append(number)
            if len(received) == 1:  # a second signal must not interrupt the cleanup
                task.cancel()

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, stop, number)
        return await task

    try:
        return asyncio.run(fly())
    except asyncio.CancelledError:
        from radron.sim.commands.console import say  # noqa: PLC0415

        say("stopped on request before the end; all processes have ended")
        raise typer.Exit(128 + received[0]) from None
