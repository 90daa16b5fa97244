"""``radron-agent identify``: progress, the result as a section of the drone file, and a plot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from radron.agent.config.drone import ResponseConfig
from radron.agent.errors import FlightRecordError
from radron.agent.flight.identify import Identified, identify
from radron.agent.flight.progress import progress_bar
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.response_records import Piece, read
from radron.agent.outputs import check_output, replacing

_READING = 0.5  # share of the work


def run_identify(path: Path, picture: Path | None) -> None:
    """Identify the vehicle's response from a recorded flight, and print it on stdout as a section of the drone file.

    A progress bar is on stderr; ``picture``: file for a plot, or None. Raises RadronError.
    """
    figure = None
    if picture is not None:
        check_output(picture, (path,))
        figure = _figure()
    flight = RecordedFlight(path)
    terminal = Console(stderr=True)
    with progress_bar(terminal, f"fitting {path.name}") as show:
        records = read(flight, lambda done: show(_READING * done))
        found = identify(records, flight.header.drone.vehicle.response, lambda done: show(_READING + (1.0 - _READING) * done))
    print(section(found, flight.header.drone.id), end="")
    for flaw in flight.incomplete:
        terminal.print(f"only a part of the flight could be read: {flaw}", markup=False, soft_wrap=True)
    if picture is not None and figure is not None:
        _draw(figure, records.pieces(), picture)


def section(found: Identified, drone: str) -> str:
    """Return the vehicle's response as a section of the drone file, with comments on its accuracy."""
    response, default = found.response, ResponseConfig()
    lines = [
        f"# {drone}, {found.flown_s:.0f} s flown by setpoints;"
        f" a cascade with these lags tilts as it did to {found.fit_mps2:.2f} m/s2 (RMS)"
    ]
    if found.late_s is not None and found.gain is not None:
        lines.append(f"# it followed its plans {found.late_s:.2f} s late, with {100.0 * found.gain:.0f} % of their motion")
    told = f"+- {found.drag_sigma_ps:.2f}" if found.drag_found else "not determined by this flight: as assumed"
    derivative = "as assumed" if response.derivative_gain != default.derivative_gain else "PX4's own"
    lines += [
        "[vehicle.response]",
        f"drag_ps = {response.drag_ps:g} # {told}",
        f"lag_s = {response.lag_s:g}",
        f"attitude_lag_s = {response.attitude_lag_s:g}",
        f"derivative_gain = {response.derivative_gain:g} # {derivative}",
        f"tracking_error_m = {response.tracking_error_m:g}",
    ]
    return "\n".join(lines) + "\n"


def _figure() -> object:
    """An empty matplotlib figure; matplotlib is not a dependency of the agent."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    return Figure(figsize=(10.0, 8.0), layout="constrained")


def _draw(figure: object, pieces: list[Piece], path: Path) -> None:
    """Plot setpoint and position: from above, along both axes, and the distance from the plan."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    assert isinstance(figure, Figure)
    panels = figure.subplot_mosaic([["above", "east"], ["above", "north"], ["apart", "apart"]], height_ratios=[1.0, 1.0, 0.8])
    first_ns = pieces[0].began_ns
    for number, piece in enumerate(pieces):
        began_s = 1e-9 * (piece.began_ns - first_ns)
        told, seen = piece.told[:, 0], piece.seen[:, 0]
        names = ("setpoint", "position") if number == 0 else (None, None)
        panels["above"].plot(told[:, 0], told[:, 1], color="#D55E00", linewidth=0.8, label=names[0])
        panels["above"].plot(seen[:, 0], seen[:, 1], color="#0072B2", linewidth=0.8, label=names[1])
        for axis, name in enumerate(("east", "north")):
            panels[name].plot(began_s + piece.told_s, told[:, axis], color="#D55E00", linewidth=0.8)
            panels[name].plot(began_s + piece.seen_s, seen[:, axis], color="#0072B2", linewidth=0.8)
            panels[name].set_ylabel(f"{name} (m)")
        apart = seen - piece.planned[:, 0]
        panels["apart"].plot(began_s + piece.seen_s, np.hypot(apart[:, 0], apart[:, 1]), color="#000000", linewidth=0.8)
    panels["above"].set(aspect="equal", adjustable="datalim", xlabel="east (m)", ylabel="north (m)")
    panels["above"].legend()
    panels["apart"].set(xlabel="time (s)", ylabel="distance from plan (m)", ylim=(0.0, None))
    try:
        with replacing(path) as temporary:
            figure.savefig(temporary)
    except ValueError as error:  # a suffix that is no image format
        raise FlightRecordError(f"{path}: the plot cannot be written: {error}") from None
