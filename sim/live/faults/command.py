"""The command ``live-faults``: missions with faults, flown by real agents in real time and judged by invariants."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from radron.agent.errors import ConfigError
from radron.sim.commands.faults import fly_and_tell


def live_faults(
    *,
    runs: Annotated[int, typer.Option(help="Number of missions, with consecutive seeds; three play all kinds of faults.")] = 3,
    seed: Annotated[int, typer.Option(help="The first seed.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for missions, summary, and files of flights with violations; rerun to resume."),
    ] = None,
    show: Annotated[int | None, typer.Option(metavar="SEED", help="Print this seed's mission as a scenario file.")] = None,
) -> None:
    """Fly random missions with faults live, two minutes each. Exit code 1 where anything was violated."""
    from radron.sim.campaign.faults.campaign import FaultCampaign  # noqa: PLC0415  (heavy imports wait until they are needed)
    from radron.sim.campaign.faults.course import LIVE  # noqa: PLC0415
    from radron.sim.campaign.faults.dealt import deal  # noqa: PLC0415
    from radron.sim.campaign.faults.draw import as_toml  # noqa: PLC0415
    from radron.sim.campaign.workers import in_processes  # noqa: PLC0415
    from radron.sim.live.faults.mission import fly_live_mission  # noqa: PLC0415

    if show is not None:
        if show < 0:
            raise ConfigError(f"--show {show}: give 0 or more")
        typer.echo(as_toml(deal(show, LIVE)), nl=False)
        return
    fly_and_tell(FaultCampaign(runs, seed, LIVE), partial(fly_live_mission, keep=out), out, in_processes(1))
