"""The ``radron-station`` command."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.agent import version
from radron.agent.extras import lacking
from radron.agent.terminal import run_command
from radron.station.survey.command import survey

if TYPE_CHECKING:
    from starlette.routing import WebSocketRoute

    from radron.agent.config.mission import MissionConfig
    from radron.protocol.signing import Verifier
    from radron.station.hub import Hub
    from radron.station.viewers.tak import Tak
    from radron.station.web.guard import Guard
    from radron.station.web.serving import Doors, Place

# Unless set: the log is folded in one thread with small matrices, as on board, and other threads of BLAS would only wait busily.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_HELP = "The operator's side: the swarm in a browser, live and from its records."
app = typer.Typer(no_args_is_help=True, add_completion=False)
app.callback(help=_HELP)(version.options)

Host = Annotated[str, typer.Option(help="Address to serve the page at; others than this computer need TLS.")]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Its port; 0: any free one.")]
Certificate = Annotated[
    Path | None, typer.Option("--tls-certificate", metavar="PEM", help="The page's certificate, for other computers.")
]
Key = Annotated[Path | None, typer.Option("--tls-key", metavar="PEM", help="Its key.")]
TokenFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="For scripts: the file with the page's token (made if missing, mode 600), which is not printed then."
    ),
]

Layers = Annotated[
    list[Path],
    typer.Option(metavar="FILE.geojson", help="What to draw under the map (GeoJSON, WGS84); may be given several times."),
]
TilesAt = Annotated[
    Path | None, typer.Option(metavar="FILE.mbtiles", help="Images to draw under the map: MBTiles, or a folder with Z/X/Y.png.")
]
Signer = Annotated[
    Path | None,
    typer.Option(envvar="RADRON_IDENTITY", metavar="FOLDER", help="Certificate and key with which the report is signed."),
]
Flights = Annotated[
    list[Path],
    typer.Argument(metavar="FLIGHT.mcap...", help="Any file of a recorded flight, or its folder; those of several drones."),
]


@app.command()
def serve(
    mission: Annotated[Path, typer.Argument(metavar="MISSION.toml", help="The mission file that the drones have.")],
    connect: Annotated[list[str], typer.Option(metavar="tls/HOST:PORT", help="A drone's endpoint; may be given several times.")],
    identity: Annotated[
        Path | None,
        typer.Option(envvar="RADRON_IDENTITY", metavar="FOLDER", help="The observer's or operator's certificate and key."),
    ] = None,
    insecure: Annotated[bool, typer.Option("--insecure", help="The swarm's links are not encrypted (tcp/HOST:PORT).")] = False,
    host: Host = "127.0.0.1",
    port: Port = 8087,
    layer: Layers = [],  # noqa: B006
    tiles: TilesAt = None,
    tls_certificate: Certificate = None,
    tls_key: Key = None,
    token_file: TokenFile = None,
    foxglove: Annotated[
        Path | None,
        typer.Option(metavar="LAYOUT.json", help="Serve Foxglove too, and write its layout for this mission here."),
    ] = None,
    tak: Annotated[
        str | None,
        typer.Option(metavar="udp://239.2.3.1:6969", help="Send drones, source and cordon to TAK too (udp, tcp or tls)."),
    ] = None,
) -> None:
    """Show a swarm in a browser, live, until SIGINT."""
    from radron.agent.config.loading import load_mission  # noqa: PLC0415  imports of a second belong to the command that needs them
    from radron.protocol.identity import load_identity  # noqa: PLC0415
    from radron.protocol.mesh.session import MeshConfig  # noqa: PLC0415
    from radron.protocol.signing import Verifier  # noqa: PLC0415
    from radron.station.background import background  # noqa: PLC0415
    from radron.station.findings.ondemand import reports  # noqa: PLC0415
    from radron.station.live import follow  # noqa: PLC0415
    from radron.station.web.serving import Place, StationError  # noqa: PLC0415

    if insecure == (identity is not None):
        raise StationError(
            "--identity or --insecure: give one of them; for a certificate, run `radron-deploy pki issue NAME --role observer`"
        )
    given = load_mission(mission)
    own = load_identity(identity) if identity is not None else None
    verifier = Verifier(own.authority, own.revoked.serials) if own is not None else None
    hub = _hub(given, verifier, replay=False)
    hub.findings = reports(hub, own)
    hub.background = background(given, layer, tiles)
    drones = tuple(drone.id for drone in given.drones)
    config = MeshConfig(connect=tuple(connect), identity=own, drones=drones)
    place = Place(host=host, port=port, certificate=tls_certificate, key=tls_key, token_file=token_file)
    doors = _foxglove_doors(hub, foxglove) if foxglove is not None else None
    sending = [_tak(hub, tak).run] if tak is not None else []

    async def work() -> None:
        await asyncio.gather(follow(hub, config), *(send() for send in sending))

    asyncio.run(_serve(hub, place, work, doors))


@app.command("open")
def open_records(
    flights: Flights,
    host: Host = "127.0.0.1",
    port: Port = 8087,
    layer: Layers = [],  # noqa: B006
    tiles: TilesAt = None,
    tls_certificate: Certificate = None,
    tls_key: Key = None,
    token_file: TokenFile = None,
    identity: Signer = None,
) -> None:
    """Show recorded flights of one mission in a browser, with a time slider, until SIGINT."""
    from radron.protocol.identity import load_identity  # noqa: PLC0415
    from radron.station.background import background  # noqa: PLC0415
    from radron.station.findings.ondemand import reports  # noqa: PLC0415
    from radron.station.replay import Records, play  # noqa: PLC0415
    from radron.station.web.serving import Place  # noqa: PLC0415

    records = Records(flights)
    hub = _hub(records.mission, records.verifier, replay=True, judges_exposures=records.judges_exposures)
    own = load_identity(identity) if identity is not None else None
    hub.background = background(records.mission, layer, tiles)
    hub.findings = reports(hub, own, flights, records)
    place = Place(host=host, port=port, certificate=tls_certificate, key=tls_key, token_file=token_file)
    asyncio.run(_serve(hub, place, lambda: play(hub, records)))


@app.command()
def report(
    flights: Flights,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write the files; made if it is not there.")],
    identity: Signer = None,
) -> None:
    """Write the findings of a mission from its flight records.

    report.html to read and print; tracks.csv and cones.csv; spectra.n42 (ANSI N42.42-2012); where the mission has a datum, also
    findings.geojson, findings.kml and dose.tif, the dose rate at 1 m. Records of all drones of a flight complete each other.
    With --identity the files are signed, and with them the log's digest: `radron-station verify`.
    """
    from rich.console import Console  # noqa: PLC0415

    from radron.agent.flight.progress import progress_bar  # noqa: PLC0415
    from radron.protocol.identity import load_identity  # noqa: PLC0415
    from radron.station.findings.command import write_report  # noqa: PLC0415
    from radron.station.findings.facts import gather  # noqa: PLC0415

    own = load_identity(identity) if identity is not None else None
    with progress_bar(Console(stderr=True), "reading the records") as progress:
        findings = gather(flights, progress)
    written, flaws = write_report(findings, out, own)
    for flaw in flaws:
        print(f"radron-station: incomplete: {flaw}", file=sys.stderr)
    print(f"written to {out}: {', '.join(path.name for path in written)}")
    print(f"signed by {own.own.name} ({own.own.role})" if own is not None else "not signed: --identity FOLDER signs it")


app.command()(survey)


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A report that was written with --identity.")],
    authority: Annotated[Path, typer.Option(metavar="ca.pem", help="The certificate of the swarm's authority.")],
) -> None:
    """See that the findings of a mission are as a member of the swarm has signed them; exit code 2 if not."""
    from radron.station.findings.seal import others  # noqa: PLC0415
    from radron.station.findings.seal import verify as verified  # noqa: PLC0415

    seal = verified(folder, authority)
    print(seal.digest, end="")
    print(
        f"signed by {seal.signer.name} ({seal.signer.role}), certificate {seal.signer.serial}: {len(seal.files)} files unchanged"
    )
    for name in others(folder, seal):
        print(f"not part of the report: {name}")


@app.command()
def export(
    flights: Flights,
    foxglove: Annotated[Path, typer.Option(metavar="OUT.mcap", help="The MCAP file to write.")],
) -> None:
    """Write recorded flights of one mission as an MCAP file that Foxglove opens, and the layout for it (OUT.layout.json)."""
    from rich.console import Console  # noqa: PLC0415

    from radron.agent.flight.progress import progress_bar  # noqa: PLC0415

    _require("foxglove", "foxglove")
    from radron.station.viewers.record import export as write  # noqa: PLC0415

    with progress_bar(Console(stderr=True), "reading the records") as progress:
        written, flaws = write(flights, foxglove, progress)
    for flaw in flaws:
        print(f"radron-station: incomplete: {flaw}", file=sys.stderr)
    print(f"written: {', '.join(map(str, written))}")


def _require(option: str, library: str) -> None:
    from radron.station.web.serving import StationError  # noqa: PLC0415

    if missing := lacking(library):
        raise StationError(f"--{option}: {missing}")


def _foxglove_doors(hub: Hub, layout_file: Path) -> Doors:
    """Return the doors with Foxglove's socket; the layout is written when the socket is served."""
    _require("foxglove", "foxglove")
    from radron.agent.outputs import replacing  # noqa: PLC0415
    from radron.station.viewers.layout import layout  # noqa: PLC0415
    from radron.station.viewers.live import LiveFoxglove  # noqa: PLC0415
    from radron.station.web.foxglove import door  # noqa: PLC0415

    about = hub.picture.about(replay=False)
    outlet = LiveFoxglove(hub)
    hub.outlets.append(outlet)

    def doors(guard: Guard) -> list[WebSocketRoute]:
        with replacing(layout_file) as path:
            path.write_text(layout(about), encoding="utf-8")
        return [door(outlet, guard)]

    return doors


def _tak(hub: Hub, url: str) -> Tak:
    _require("tak", "pytak")
    from radron.station.viewers.tak import Tak  # noqa: PLC0415

    outlet = Tak(hub.picture, url, hub.tell)
    hub.outlets.append(outlet)
    return outlet


def _hub(mission: MissionConfig, verifier: Verifier | None, replay: bool, *, judges_exposures: bool = True) -> Hub:
    from radron.agent.fusion.registry import deferred_named, estimator_named  # noqa: PLC0415
    from radron.station.hub import Hub  # noqa: PLC0415
    from radron.station.picture.picture import Picture  # noqa: PLC0415

    estimators = estimator_named if replay else deferred_named
    return Hub(Picture(mission, verifier, estimators, judges_exposures=judges_exposures), replay)


async def _serve(hub: Hub, place: Place, work: Callable[[], Awaitable[None]], doors: Doors | None = None) -> None:
    from radron.station.web.serving import Serving  # noqa: PLC0415

    serving = Serving(hub, place, doors)
    print(f"radron-station: {serving.shown()}", flush=True)
    if doors is not None:
        print(f"radron-station: for Foxglove: {serving.shown('foxglove')}", flush=True)
    await serving.run(work())


def main() -> None:
    """Run the ``radron-station`` command; an error that the user can fix ends in one line of text and the exit code 2."""
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    try:
        run_command("radron-station", app)
    except KeyboardInterrupt:
        sys.exit(0)
