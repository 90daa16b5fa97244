"""The ``radron-agent`` command."""

from __future__ import annotations

import sys

import typer

from agent.errors import RadronError

app = typer.Typer(no_args_is_help=True, add_completion=False, help="One drone of the swarm, on board.")


@app.callback()
def _root() -> None:
    """Keep sub-commands even while there is only one."""


def main() -> None:
    """Run the command; what the user can mend ends in one line and exit code 2."""
    try:
        app()
    except RadronError as error:
        print(f"radron-agent: {error}", file=sys.stderr)
        sys.exit(2)
