"""The commands that fly: ``run``, ``campaign``, ``table``."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.agent.errors import ConfigError
from radron.agent.outputs import check_output
from radron.sim.campaign.workers import Executor, Job, Outcome, cores, in_processes, on_dask
from radron.sim.runfile import make_folder, write_text
from radron.sim.sweep import Case, Value, cases, parse_settings, parse_sweep, without_effect

if TYPE_CHECKING:
    from radron.sim.result import RunResult

Estimator = Annotated[str | None, typer.Option(help="paper, paper-geometric, ...; default: the scenario's own.")]
Law = Annotated[str | None, typer.Option(help="Flocking law, paper or smooth; default: the scenario's own.")]
Settings = Annotated[list[str] | None, typer.Option("--set", help="Change a value: radius_m=10, mission.survey.height_m=4.")]
Drones = Annotated[int | None, typer.Option(min=1, max=64, help="Number of drones; default: the scenario's.")]
Workers = Annotated[int | None, typer.Option(help="Number of processes; default: one for each core.")]
Dask = Annotated[str | None, typer.Option(help="Address of a running Dask cluster to fly on, such as tcp://host:8786.")]


def scenarios() -> None:
    """List the shipped scenarios, each with a description."""
    from radron.sim.scenario import load_scenario, shipped  # noqa: PLC0415  (heavy imports wait until they are needed)

    names = shipped()
    width = max(map(len, names))
    for name in names:
        typer.echo(f"{name:{width}}  {load_scenario(name, with_grid=False).description}")


def run(
    *,
    scenario: Annotated[str, typer.Argument(help="Name of a shipped scenario, or a file.")] = "demo",
    seed: Annotated[int, typer.Option(help="Seed of all randomness of the flight.")] = 1,
    estimator: Estimator = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(help="Another estimator that reads the same cones without any say in the flight; repeatable."),
    ] = None,
    law: Law = None,
    drones: Drones = None,
    settings: Settings = None,
    json: Annotated[
        str | None, typer.Option(metavar="OUT", help="Write the result as one flat JSON object; '-': to standard output.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write result.json and pictures: map, error, posterior, spacing, sources.")
    ] = None,
) -> None:
    """Fly one mission, and print the source estimate, its 1-sigma radius, and its distance from the truth."""
    from radron.sim.commands.console import err, flight_progress, say  # noqa: PLC0415  (heavy imports wait until they are needed)
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    if seed < 0:
        raise ConfigError(f"--seed {seed}: give 0 or more")
    wanted = with_drones(settings, drones)
    case = checked([scenario], {}, wanted, [*([estimator] if estimator else []), *(listen or [])], law)[0]
    check_json(json)
    for note in without_effect([case], parse_settings(wanted), estimator, law):
        say(note)
    if out is not None:
        make_folder(out)

    from radron.sim.campaign.report import error_of, faults_of, sentence, write_flight  # noqa: PLC0415
    from radron.sim.lockstep.flight import fly  # noqa: PLC0415

    with flight_progress(case.name) as progress:
        flight = fly(case.scenario, seed, estimator=estimator, listen=listen or (), law=law, progress=progress)
    say(sentence(flight.result, flight.trace), err if json == "-" else stdout)
    told = faults_of(flight.trace)
    if told:
        say(told, err if json == "-" else stdout)
    for name, heard in flight.listened.items():
        own = f"{flight.result.estimator}, flown by the swarm: {error_of(flight.result)}"
        say(f"{name}, listening only: {error_of(heard)}; {own}.")
    write_json(json, flight.result, *flight.listened.values())
    if out is not None:
        written = write_flight(out, flight)
        say(f"written to {out}: {', '.join(path.name for path in written)}")


def campaign(
    *,
    scenario: Annotated[list[str], typer.Argument(help="Names of shipped scenarios, or files.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for runs, summary and figures; rerun to resume.")],
    runs: Annotated[int, typer.Option(help="Flights of each scenario at each point of the sweep.")] = 50,
    estimator: Estimator = None,
    listen: Annotated[
        str | None, typer.Option(help="Report on this estimator, which reads the same cones without any say in the flight.")
    ] = None,
    law: Law = None,
    seed_base: Annotated[int, typer.Option(help="The first seed.")] = 0,
    sweep: Annotated[list[str] | None, typer.Option(help="Values of a parameter: radius_m=8,10,12; repeat for a grid.")] = None,
    settings: Settings = None,
    workers: Workers = None,
    dask: Dask = None,
) -> None:
    """Fly scenarios many times, on all cores or on a Dask cluster. After an interruption, rerun the same command to resume."""
    from radron.sim.campaign.flights import Campaign, fly_campaign  # noqa: PLC0415
    from radron.sim.campaign.report import case_sentence, write_campaign  # noqa: PLC0415
    from radron.sim.commands.console import campaign_progress, say  # noqa: PLC0415
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    execute = executor(workers, dask)
    chosen = checked(scenario, parse_sweep(sweep or []), settings, [name for name in (estimator, listen) if name], law)
    plan = Campaign(chosen, runs, estimator, law, seed_base, listen)
    for note in without_effect(chosen, parse_settings(settings or []), estimator, law):
        say(note)
    with campaign_progress("campaign") as watch:
        flown = fly_campaign(plan, out, execute, watch=watch)
    written = write_campaign(out, flown)
    for case in plan.in_order():
        say(case_sentence(case.label, flown.of(case)), stdout)
    say(f"written to {out}: {', '.join(['runs.jsonl', *(path.name for path in written)])}")
    exit_on(flown.failures, out)


def table(
    *,
    runs: Annotated[int, typer.Option(help="Flights of each scenario.")] = 50,
    estimators: Annotated[str, typer.Option(help="Names, separated by commas; a column for each.")] = "paper,bayes",
    listen: Annotated[
        str | None,
        typer.Option(help="One more column: this estimator on the same cones as the first one, without any say in the flight."),
    ] = None,
    field: Annotated[bool, typer.Option("--field", help="Also make the table of the field experiments.")] = False,
    workers: Workers = None,
    dask: Dask = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Keep the runs; write text, CSV and Markdown.")] = None,
) -> None:
    """Compare with the paper's table: four scenarios, solo and swarm, static and moving source, with the error over the bound."""
    from radron.sim.campaign.table import FIELD, NOTE, SIMULATIONS, Pilot, as_rich, as_text, blocks, fly_study  # noqa: PLC0415
    from radron.sim.commands.console import campaign_progress, say  # noqa: PLC0415
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415

    execute = executor(workers, dask)
    names = [name.strip() for name in estimators.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"--estimators {estimators}: name each once, separated by commas, such as paper,paper-geometric")
    pilots = [*map(Pilot, names), *([Pilot(names[0], listen)] if listen else [])]
    studies = [SIMULATIONS, FIELD] if field else [SIMULATIONS]
    chosen = [checked(list(study.heads), {}, None, [*names, *([listen] if listen else [])], None) for study in studies]
    failures: list[Outcome[Job, RunResult]] = []
    with tempfile.TemporaryDirectory() if out is None else nullcontext(str(out)) as folder:
        for study, scenarios in zip(studies, chosen, strict=True):
            with campaign_progress(study.name) as watch:
                finished, flown = fly_study(study, scenarios, pilots, runs, Path(folder), execute=execute, watch=watch)
            if stdout.is_terminal:
                stdout.print(finished.title, *map(as_rich, blocks(finished, stdout.width)), sep="\n")
            else:
                typer.echo(as_text(finished), nl=False)
            failures += [outcome for campaign_ in flown for outcome in campaign_.failures]
    stdout.print(NOTE)
    if out is not None:
        say(f"written to {out}")
    exit_on(failures, out)


def with_drones(settings: list[str] | None, drones: int | None) -> list[str]:
    """Return the settings of the options --set and --drones together."""
    return [*(settings or []), *([] if drones is None else [f"drones={drones}"])]


def executor(workers: int | None, dask: str | None) -> Executor:
    """Return the executor of a campaign's flights: processes on this machine, or a Dask cluster."""
    if dask is None:
        return in_processes(cores() if workers is None else workers)
    if workers is not None:
        raise ConfigError("--workers and --dask: give one of them; a Dask cluster has its own workers")
    return on_dask(dask)


def checked(
    names: Sequence[str],
    sweep: dict[str, tuple[Value, ...]],
    settings: list[str] | None,
    estimators: Sequence[str],
    law: str | None,
) -> tuple[Case, ...]:
    """Return the cases to fly, after a check of scenarios, keys, values, estimators and laws, before anything is written."""
    from radron.sim.scenario import override  # noqa: PLC0415

    chosen = cases(names, sweep, parse_settings(settings or []))
    for case in chosen:
        for estimator in estimators:
            override(case.scenario, {"mission.fusion.estimator": estimator})
        if law is not None:
            override(case.scenario, {"mission.encirclement.law": law})
    return chosen


def check_json(json: str | None) -> None:
    """Raise an error if the file of the option --json cannot be written, before anything is flown."""
    if json is not None and json != "-":
        check_output(Path(json))


def write_json(json: str | None, *results: RunResult) -> None:
    """Write results for the option --json: one flat object per line, into a file or to standard output."""
    if json is None:
        return
    from radron.sim.campaign.report import result_json  # noqa: PLC0415

    text = "".join(map(result_json, results))
    if json == "-":
        typer.echo(text, nl=False)
    else:
        write_text(Path(json), text)


def exit_on(failures: Sequence[Outcome[Job, RunResult]], out: Path | None) -> None:
    """End the command with code 1 if flights failed, and name them so that they can be repeated."""
    if not failures:
        return
    from radron.sim.commands.console import say  # noqa: PLC0415

    where = f"; tracebacks in {out}/.../failures.jsonl" if out is not None else ""
    named = ", ".join(outcome.job.label for outcome in failures[:10])
    more = f" and {len(failures) - 10} more" if len(failures) > 10 else ""
    say(f"{len(failures)} flights failed: {named}{more}{where}")
    raise typer.Exit(1)
