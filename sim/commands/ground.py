"""The command ``ground``: what ground and air scatter to a camera beside a source, and what the ground sends out by itself."""

from __future__ import annotations

from typing import Annotated, get_args

import typer

from radron.agent.errors import ConfigError
from radron.sim.radiation.truth import GroundKind

_HEIGHTS_M = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0)
_HORIZONTAL_M = (0.0, 2.0, 5.0, 10.0, 20.0, 35.0)


def ground(
    nuclide: Annotated[str, typer.Argument(help="Of the source.")] = "Cs-137",
    on: Annotated[str, typer.Option(help="Kind of ground: soil, sand, asphalt, concrete or water.")] = "soil",
    depth_m: Annotated[float, typer.Option(min=0.0, max=0.5, help="Of the source in the ground.")] = 0.0,
) -> None:
    """Tabulate hits by scattered photons as a share of the direct ones, by height and distance, and the natural background."""
    if on not in get_args(GroundKind):
        raise ConfigError(f"--on {on}: no known ground; known are {', '.join(get_args(GroundKind))}")

    from radron.sim.radiation.ground.shares import hits_per_s, kerma_per_activity, scattered_share  # noqa: PLC0415  (heavy imports wait)

    typer.echo(f"{nuclide} {f'{depth_m:g} m in' if depth_m > 0.0 else 'on'} {on}: hits by scattered photons over direct ones")
    typer.echo("height, m   horizontal distance, m" + "".join(f"{r:8g}" for r in _HORIZONTAL_M))
    for height_m in _HEIGHTS_M:
        shares = [scattered_share(nuclide, on, -depth_m, height_m, r) for r in _HORIZONTAL_M]
        typer.echo(f"{height_m:9g}   {'':22}" + "".join(f"{share:8.2f}" for share in shares))
    for height_m in (1.0, 5.0, 20.0):
        typer.echo(f"natural background {height_m:g} m above: {hits_per_s(on, height_m):.2f} hits/s")
    kerma = ", ".join(f"{value * 3.6e12:.4f}" for value in kerma_per_activity(on))
    typer.echo(f"air kerma 1 m above, nGy/h per Bq/kg of K-40, U-238 and Th-232 series: {kerma}")
