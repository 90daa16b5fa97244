"""The command ``response``: the table of response of an ordinary detector, by transport."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from radron.agent.outputs import check_output, replacing


def response(
    name: Annotated[str, typer.Argument(help="Detector: nai-2x2, csi-1cm3, czt-1cm3 or gm-sbm20.")],
    out: Annotated[Path, typer.Option(help="The table's file (JSON).")],
    histories: Annotated[int, typer.Option(min=1000, help="Photons for each energy and angle.")] = 40_000,
    seed: Annotated[int, typer.Option(min=0)] = 1,
) -> None:
    """Compute the table of response of an ordinary detector: effective areas by energy, direction and channel."""
    from radron.sim.radiation.crystal.table import response_table  # noqa: PLC0415  (heavy imports wait)

    check_output(out)
    table = response_table(name, histories, seed)
    with replacing(out) as part:
        part.write_text(table, encoding="utf-8")
    typer.echo(f"{out}: table of response of {name}")
