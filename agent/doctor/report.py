"""Findings of the doctor: on board as JSON, on the laptop as one page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from msgspec import Struct

if TYPE_CHECKING:
    from rich.console import RenderableType

Verdict = Literal["ok", "not yet", "check", "failed"]
AREAS = ("computer", "clock", "camera", "autopilot", "swarm")
# Sign and word show the verdict as well as the colour. Red findings need action, yellow findings a look.
_SHOWN = {
    "ok": ("green", "+ ok"),
    "not yet": ("yellow", "~ not yet"),
    "check": ("yellow", "! check"),
    "failed": ("red", "X FAILED"),
}


class Check(Struct, frozen=True):
    """One line of the report on a drone's examination.

    ``not yet``: may resolve by itself; ``check``: works, with a flaw; ``failed``: needs action.
    """

    area: str
    name: str
    verdict: Verdict
    text: str


class Setting(Struct, frozen=True):
    """An autopilot parameter that was set during the examination. ``after``: last reported value; None: not reported."""

    name: str
    before: float
    after: float | None
    taken: bool


class Report(Struct, frozen=True, kw_only=True):
    """The report on the examination of one drone on the bench. ``version``: of the radron software on board."""

    drone: str
    version: str
    mission: str
    stamp_ns: int
    checks: tuple[Check, ...]
    written: tuple[Setting, ...] = ()

    @property
    def code(self) -> int:
        """The exit code of the command: 0 all green; 1 something failed; 3 nothing failed, but not all is green. (2: not
        examined.)
        """
        verdicts = {check.verdict for check in self.checks}
        return 1 if "failed" in verdicts else 3 if verdicts - {"ok"} else 0


def page(report: Report, where: str) -> RenderableType:
    """Return the report as a page for a terminal. where: address of the drone."""
    from rich.console import Group  # noqa: PLC0415  not needed where only JSON is made
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(title=f"{report.drone} at {where}: radron {report.version}, mission {report.mission}", show_header=False)
    for area in AREAS:
        table.add_section()
        for index, check in enumerate(check for check in report.checks if check.area == area):
            colour, verdict = _SHOWN[check.verdict]
            table.add_row(area if index == 0 else "", escape(check.name), f"[{colour}]{verdict}[/]", escape(check.text))
    parts: list[RenderableType] = [table]
    parts += [f"  {escape(_told(setting))}" for setting in report.written]
    colour, verdict = {0: ("green", "+ ready"), 1: ("red", "X NOT READY"), 3: ("yellow", "~ not all is ready")}[report.code]
    bad = [check.name for check in report.checks if check.verdict != "ok"]
    parts.append(f"[{colour}]{verdict}[/]" + (f": {escape(', '.join(bad))}" if bad else ""))
    return Group(*parts)


def _told(setting: Setting) -> str:
    after = "no answer" if setting.after is None else f"{setting.after:g}"
    return f"parameter {setting.name}: {setting.before:g} before, {after} now" + ("" if setting.taken else ": NOT TAKEN")
