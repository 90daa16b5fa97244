"""The command ``faults``: random missions with faults, judged by invariants."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.agent.errors import ConfigError
from radron.sim.commands.flights import Dask, Workers, executor

if TYPE_CHECKING:
    from radron.sim.campaign.faults.campaign import FaultCampaign, Fly
    from radron.sim.campaign.faults.mission import Mission
    from radron.sim.campaign.workers import Executor


def faults(
    *,
    runs: Annotated[int, typer.Option(help="Number of missions, with consecutive seeds.")] = 100,
    seed: Annotated[int, typer.Option(help="The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for missions and summary; rerun to resume.")] = None,
    dealt: Annotated[bool, typer.Option("--dealt", help="Ten successive seeds have every kind of fault, and none.")] = False,
    attacks: Annotated[
        bool, typer.Option("--attacks", help="Each mission has one attack, or one reset of an autopilot.")
    ] = False,
    short: Annotated[bool, typer.Option("--short", help="Short missions, as in the fast tests.")] = False,
    first: Annotated[bool, typer.Option("--first", help="End each mission at its first violation.")] = False,
    show: Annotated[int | None, typer.Option(metavar="SEED", help="Print this seed's mission as a scenario file.")] = None,
    minimise: Annotated[
        int | None, typer.Option(metavar="SEED", help="Print the smallest scenario that violates what this seed violates.")
    ] = None,
    workers: Workers = None,
    dask: Dask = None,
) -> None:
    """Fly random missions with faults, and tell what must hold and did not: exit code 1. Rerun with the same --out to resume."""
    from radron.sim.campaign.faults.course import ATTACKED, DEALT, FULL, SHORT  # noqa: PLC0415  (heavy imports wait until they are needed)

    courses = [course for course, given in ((SHORT, short), (DEALT, dealt), (ATTACKED, attacks)) if given]
    if len(courses) > 1:
        raise ConfigError("--short, --dealt and --attacks: give one of them")
    course = courses[0] if courses else FULL
    for option, given in (("--show", show), ("--minimise", minimise)):
        if given is not None and given < 0:
            raise ConfigError(f"{option} {given}: give 0 or more")
    if show is not None:
        from radron.sim.campaign.faults.draw import as_toml  # noqa: PLC0415
        from radron.sim.campaign.faults.mission import Mission  # noqa: PLC0415

        typer.echo(as_toml(Mission(show, course).drawn), nl=False)
    elif minimise is not None:
        from radron.sim.campaign.faults.mission import Mission  # noqa: PLC0415

        _minimise(Mission(minimise, course))
    else:
        from radron.sim.campaign.faults.campaign import FaultCampaign  # noqa: PLC0415
        from radron.sim.campaign.faults.mission import fly_mission  # noqa: PLC0415

        fly_and_tell(FaultCampaign(runs, seed, course, first), fly_mission, out, executor(workers, dask))


def fly_and_tell(campaign: FaultCampaign, fly: Fly, out: Path | None, execute: Executor) -> None:
    """Fly the random missions of a campaign, print and write the results; exit code 1 after a violation of a condition."""
    from radron.sim.campaign.faults.campaign import fly_faults  # noqa: PLC0415
    from radron.sim.campaign.faults.summary import sentences, summarise, table, told, write_summary  # noqa: PLC0415
    from radron.sim.commands.console import campaign_progress, say  # noqa: PLC0415
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    with campaign_progress("faults") as watch:
        flown = fly_faults(campaign, out, execute, fly, watch)
    summary = summarise(flown.verdicts)
    typer.echo(table(summary), nl=False)
    for line in (line for verdict in flown.verdicts for line in told(verdict, campaign.course)):
        say(line, stdout)
    for line in sentences(summary):
        say(line, stdout)
    if out is not None:
        say(f"written to {out}: missions.jsonl, {', '.join(path.name for path in write_summary(out, summary))}")
    for outcome in flown.failures:
        say(f"{outcome.job.label} could not be judged: {outcome.error}")
    if summary.violations or flown.failures:
        raise typer.Exit(1)


def _minimise(mission: Mission) -> None:
    from radron.sim.campaign.faults.draw import as_toml  # noqa: PLC0415
    from radron.sim.campaign.faults.minimise import minimise  # noqa: PLC0415
    from radron.sim.commands.console import say  # noqa: PLC0415

    found = minimise(mission, tell=say)
    if found is None:
        say(f"seed {mission.seed} violates nothing")
        return
    document, violation = found
    who = " ".join(violation.drones) or "all"
    typer.echo(f"# Seed {mission.seed} violates {violation.invariant} at {violation.time_s:.2f} s, {who}: {violation.text}")
    typer.echo(as_toml(document), nl=False)
    raise typer.Exit(1)
