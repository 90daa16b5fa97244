"""The ``radron-deploy`` command."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated

import typer

from radron.agent.terminal import run_command
from radron.deploy.computer import command as computer
from radron.deploy.fleet import command as fleet
from radron.deploy.image import command as image
from radron.deploy.pki import command as pki
from radron.deploy.update import command as update

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_show_locals=False)
app.add_typer(pki.app, name="pki")
app.add_typer(fleet.app, name="fleet")
app.add_typer(image.app, name="image")
app.add_typer(update.bundle_app, name="bundle")
app.command()(update.push)
app.command()(update.logs)
app.command()(update.status)
for command in computer.COMMANDS:
    app.command()(command)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"radron {version('radron')}")
        raise typer.Exit


@app.callback(help="From a checkout to a swarm: certificates, a file for the fleet, the onboard computers' disks and updates.")
def options(
    _version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")] = False,
) -> None:
    """Options of all subcommands."""


def main() -> None:
    """Run the ``radron-deploy`` command; an error that the user can fix ends in one line of text and the exit code 2."""
    run_command("radron-deploy", app)


if __name__ == "__main__":
    main()
