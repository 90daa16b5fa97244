"""The command ``consistency``: whether an estimator's stated uncertainty matches its errors."""

from __future__ import annotations

import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from radron.sim.commands.flights import Dask, Law, Settings, Workers, checked, executor, exit_on


def consistency(
    *,
    scenario: Annotated[
        list[str] | None, typer.Argument(help="Names of shipped scenarios, or files; default: the ideal and the biased ones.")
    ] = None,
    runs: Annotated[int, typer.Option(help="Flights of each scenario; each gives one sample.")] = 200,
    estimator: Annotated[str, typer.Option(help="Whose stated uncertainty is checked.")] = "bayes",
    law: Law = None,
    seed_base: Annotated[int, typer.Option(help="The first seed.")] = 0,
    settings: Settings = None,
    workers: Workers = None,
    dask: Dask = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Keep the runs; write tables and a picture. Rerun to resume.")
    ] = None,
) -> None:
    """Fly many times, and compare the stated uncertainty with the errors: coverage, NEES, error over the bound, x0."""
    from radron.sim.campaign.consistency import SCENARIOS, write_consistency  # noqa: PLC0415
    from radron.sim.campaign.flights import Campaign, fly_campaign  # noqa: PLC0415  (heavy imports wait until they are needed)
    from radron.sim.campaign.table import as_rich, as_text, blocks  # noqa: PLC0415
    from radron.sim.commands.console import campaign_progress, say  # noqa: PLC0415
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    execute = executor(workers, dask)
    chosen = checked(scenario or list(SCENARIOS), {}, settings, [estimator], law)
    plan = Campaign(chosen, runs, estimator, law, seed_base)
    with tempfile.TemporaryDirectory() if out is None else nullcontext(str(out)) as folder:
        with campaign_progress("consistency") as watch:
            flown = fly_campaign(plan, Path(folder), execute, watch=watch)
        table, written = write_consistency(Path(folder), flown)
        if stdout.is_terminal:
            stdout.print(table.title, *map(as_rich, blocks(table, stdout.width)), sep="\n")
        else:
            typer.echo(as_text(table), nl=False)
        stdout.print(table.note)
        if out is not None:
            say(f"written to {out}: {', '.join(['runs.jsonl', *(path.name for path in written)])}")
    exit_on(flown.failures, out)
