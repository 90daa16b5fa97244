"""Progress display of a live flight: messages, and a table of the agents if there is a terminal."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from radron.protocol.messages import Stage
from radron.sim.commands.console import Every, err, say
from radron.sim.live.monitor import LINK_LOST_S, ObservedAgent
from radron.sim.live.worldlink import Truth

_REDRAW_S = 0.25
_PLAIN_S = 10.0
_LATE_S = 0.1  # delay of the world that is reported


class View:
    """Interface for the progress messages of a live flight; this implementation shows nothing."""

    def say(self, text: str) -> None:
        """Report an event as a line of text."""

    def show(self, time_s: float, truth: Truth, agents: Sequence[ObservedAgent]) -> None:
        """Report the present state of world and agents, ``time_s`` seconds after the start; called often."""


class ConsoleView(View):
    """Shows the progress of a live flight on standard error."""

    def __init__(self, name: str, live: Live | None) -> None:
        """``name``: name of the flight. ``live``: display of the table; None: a line from time to time."""
        self._name = name
        self._live = live
        self._due = Every(_PLAIN_S if live is None else _REDRAW_S)
        self._late_due = Every(_PLAIN_S)

    def say(self, text: str) -> None:
        """Print a line above the table of agents."""
        say(f"{self._name}: {text}")

    def show(self, time_s: float, truth: Truth, agents: Sequence[ObservedAgent]) -> None:
        """Redraw the table of agents, or print a line, if enough time has passed."""
        if truth.late_s > _LATE_S and self._late_due():
            self.say(f"the world is {truth.late_s:.1f} s behind the clock: this machine is too busy")
        if not self._due():
            return
        if self._live is not None:
            self._live.update(_table(f"{self._name}, {time_s:.0f} s", truth, agents), refresh=True)
        elif time_s > 0.0:
            self.say(_line(time_s, truth, agents))


@contextmanager
def console_view(name: str) -> Iterator[ConsoleView]:
    """Open the progress display of one flight, for the duration of the block."""
    if not err.is_terminal:
        yield ConsoleView(name, None)
        return
    with Live(console=err, auto_refresh=False, transient=True) as live:
        yield ConsoleView(name, live)


def _line(time_s: float, truth: Truth, agents: Sequence[ObservedAgent]) -> str:
    """Return all agents in one line."""
    parts = [f"{agent.drone} {agent.stage}{_with_error(agent, truth)}{_with_trouble(agent)}" for agent in agents]
    return f"{time_s:.0f} s, {sum(agent.cones for agent in agents)} cones; {', '.join(parts)}"


def _with_error(agent: ObservedAgent, truth: Truth) -> str:
    error_m = _error_m(agent, truth)
    return "" if error_m is None else f" error {error_m:.1f} m"


def _with_trouble(agent: ObservedAgent) -> str:
    """Return the first problem; empty after landing, when a vehicle that is not ready to arm is normal."""
    if not agent.alive:
        return " (gone)"
    if agent.stage is Stage.LANDED:
        return ""
    return f" ({agent.problems[0]})" if agent.problems else ""


def _table(title: str, truth: Truth, agents: Sequence[ObservedAgent]) -> Table:
    table = Table(title=escape(title), title_justify="left")
    for column in ("drone", "stage", "position, m", "vehicle", "cones", "hypothesis, m", "error, m", "link", "problems"):
        table.add_column(column)
    now_s = time.monotonic()
    for agent, position, vehicle in zip(agents, truth.position_m, truth.vehicles, strict=True):
        belief, error_m = agent.hypothesis, _error_m(agent, truth)
        table.add_row(
            agent.drone,
            str(agent.stage),
            "{:.1f} {:.1f} {:.1f}".format(*position),
            f"{vehicle.mode}{', failsafe' if vehicle.failsafe else ''}",
            str(agent.cones),
            "-" if belief is None else f"{belief.position[0]:.1f} {belief.position[1]:.1f}",
            "-" if error_m is None else f"{error_m:.1f}",
            _link(agent, now_s),
            escape("; ".join(agent.problems) if agent.stage is not Stage.LANDED else ""),
        )
    return table


def _link(agent: ObservedAgent, now_s: float) -> str:
    if not agent.alive:
        return "gone" if np.isfinite(agent.heard_s) else "-"
    silent_s = now_s - agent.heard_s
    return "up" if silent_s < LINK_LOST_S else f"silent for {silent_s:.0f} s"


def _error_m(agent: ObservedAgent, truth: Truth) -> float | None:
    """Return the horizontal distance of its hypothesis from the nearest source, m."""
    if agent.hypothesis is None:
        return None
    x, y = agent.hypothesis.position[:2]
    return min((float(np.hypot(x - source.place_m[0], y - source.place_m[1])) for source in truth.sources), default=None)
