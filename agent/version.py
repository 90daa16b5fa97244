"""The option ``--version`` of both commands."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated

import typer


def _tell(wanted: bool) -> None:
    if wanted:
        typer.echo(f"radron {version('radron')}")
        raise typer.Exit


def options(
    _: Annotated[bool, typer.Option("--version", callback=_tell, is_eager=True, help="Print the version and exit.")] = False,
) -> None:
    """Options of the command itself, before the options of its subcommands."""
