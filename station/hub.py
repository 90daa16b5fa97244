"""Distribution of the swarm's state to all open web pages, and storage for pages that look back in time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import msgspec
from msgspec import Raw
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.protocol.messages import Action
from radron.station.background import Background
from radron.station.draft import editor
from radron.station.outbox import GAVE_WAY, Page
from radron.station.picture.frame import ConeCurve, Event, Frame, Raster, Spectra
from radron.station.picture.history import CONES_MS, History
from radron.station.picture.overview import Row
from radron.station.picture.picture import Picture

encode = msgspec.json.Encoder().encode


class Outlet(Protocol):
    """Another program, such as Foxglove or TAK, that gets the same data as the operators' web pages."""

    def show(self, frame: Frame, layers: list[Raster], cones: list[ConeCurve]) -> None:
        """Show one state of the swarm (``frame``), with the map layers and Compton cones that are new in it."""

    def note(self, event: Event) -> None:
        """Show an event of the timeline, such as a command or a found source."""


class Hub:
    """Sends the state of the swarm to all open web pages, keeps its history, and passes the pages' requests on.

    ``progress``: share of a record read so far; None in a live flight. ``command``, ``upload``: send an order to the drones,
    given also its age in seconds, and return the reason of a refusal; None: this station may not. ``findings``: makes the report
    on the mission as a ZIP archive; None: no report. ``outlets``: other programs that get the pages' data.
    """

    def __init__(self, picture: Picture, replay: bool, progress: Callable[[float], None] = lambda share: None) -> None:
        """``picture``: the station's state of the swarm. ``replay``: it comes from a flight record. ``progress``: called with the
        share of the record read so far.
        """
        self.picture = picture
        self.history = History(len(picture.members))
        self.progress: float | None = 0.0 if replay else None
        self.command: Callable[[Action, tuple[str, ...], float], str] | None = None
        self.upload: Callable[[MissionConfig, float], str] | None = None
        self.findings: Callable[[], Awaitable[bytes]] | None = None
        self.outlets: list[Outlet] = []
        self.background = Background()
        self._on_progress = progress
        self._pages: list[Page] = []
        self._now_ms = 0

    @property
    def pages(self) -> int:
        """Number of open web pages."""
        return len(self._pages)

    @contextmanager
    def joined(self, most: int) -> Iterator[Page]:
        """Yield a newly opened web page: it first gets the present content, then all changes.

        If ``most`` pages are open already, the page with the longest unused time is closed.
        """
        if len(self._pages) >= most:
            idlest = min(self._pages, key=lambda page: page.used_s)
            self._pages.remove(idlest)
            idlest.leave(GAVE_WAY)
        page = Page()
        page.send(self._about())
        page.send(encode({"kind": "events", "events": self.history.events}))
        page.send(_rows(self.history.overview.rows()))
        page.send(self._progress())
        if self.history.last_ms:
            self._show_history(page, self.history.last_ms)
        self._pages.append(page)
        try:
            yield page
        finally:
            if page in self._pages:
                self._pages.remove(page)

    def adopt(self, mission: MissionConfig) -> None:
        """Show another mission, which an operator has uploaded and drones have adopted.

        All content but the timeline begins anew.
        """
        events = self.history.events
        self.picture = self.picture.of(mission)
        self.history = History(len(self.picture.members))
        self.history.events = events
        self._send(self._about())

    def follow(self, page: Page) -> None:
        """Let a web page show the present again, after it has looked back in time."""
        if not page.live:
            page.live, page.at_ms = True, None
            self._show_history(page, self.history.last_ms)

    def look_back(self, page: Page, at_ms: int) -> None:
        """Show a web page the state of the swarm at a past time, until the page follows the present again.

        ``at_ms``: milliseconds UTC.
        """
        before_ms = None if page.live else page.at_ms
        page.live, page.at_ms = False, at_ms
        self._show_history(page, at_ms, before_ms)

    def _show_history(self, page: Page, at_ms: int, before_ms: int | None = None) -> None:
        """Show a page the state at a time; ``before_ms``: the time shown so far, to send changes only; None: send everything."""
        history = self.history
        goes_on = before_ms is not None and before_ms <= at_ms <= before_ms + CONES_MS
        layers = history.layers(at_ms, before_ms)
        gone = [kind for kind, data in layers.items() if data is None]
        trails = None if goes_on else history.overview.trails(at_ms)
        page.send(encode({"kind": "at", "at_ms": at_ms, "without": gone, "trails": trails}))
        cones = history.cones(before_ms if goes_on and before_ms is not None else at_ms - CONES_MS, at_ms)
        if cones:
            page.send(_cones(cones))
        for kind, data in {"frame": history.frame(at_ms), **layers}.items():
            if data is not None:
                page.show(kind, data)

    def show(self, now_ns: int) -> None:
        """Store the present state of the swarm, and send it to all web pages that follow the present.

        ``now_ns``: nanoseconds UTC. Each message is encoded only once for all pages.
        """
        frame = self.picture.frame(now_ns)
        self._now_ms = frame.at_ms
        following = [page for page in self._pages if page.live]
        data = encode(frame)
        for page in following:
            page.show("frame", data)
        rasters: list[Raster] = []
        if self.history.wants_rasters(frame.at_ms):
            rasters = self.picture.rasters(now_ns)
            layers: list[Raster | Spectra] = [*rasters, self.picture.spectra(now_ns)]
            for layer in layers:
                self._show_layer(layer, following)
        cones = self.picture.cones()
        for cone in cones:
            self.history.add_cone(cone, frame.at_ms)
        if cones and following:
            data_of_cones = _cones(cones)
            for page in following:
                page.pass_by(data_of_cones)
        if self.history.add_frame(frame, data):
            self._send(_rows([self.history.overview.row(len(self.history.overview) - 1)]))
        for outlet in self.outlets:
            outlet.show(frame, rasters, cones)
        for event in self.picture.events(frame):
            self.note(event)

    def report(self, progress: float) -> None:
        """Send all web pages the share of a flight record that has been read so far, from 0 to 1."""
        self.progress = progress
        self._on_progress(progress)
        self._send(self._progress())

    def note(self, event: Event) -> None:
        """Add an event to the timeline, and send it to all web pages."""
        self.history.add_event(event)
        self._send(encode(event))
        for outlet in self.outlets:
            outlet.note(event)

    def tell(self, line: str, warning: bool, what: str = "command") -> None:
        """Add the result of a command (or, with ``what``, of an upload) to the timeline, as one line of text."""
        level = "warning" if warning else "info"
        self.note(Event(at_ms=self._now_ms, text=what, values={"line": line}, level=level))

    def _about(self) -> bytes:
        about = self.picture.about(replay=self.progress is not None)
        commands = tuple(Action) if self.command is not None else ()
        edited = editor(self.picture.mission) if self.upload is not None else None
        return encode(
            replace(
                about,
                commands=commands,
                editor=edited,
                report=self.findings is not None,
                layer=bool(self.background.layer),
                tiles=self.background.tiles.levels if self.background.tiles is not None else None,
            )
        )

    def _progress(self) -> bytes:
        return encode({"kind": "progress", "share": self.progress})

    def _show_layer(self, layer: Raster | Spectra, following: list[Page]) -> None:
        data = encode(layer)
        self.history.add_layer(layer.kind, layer.at_ms, data)
        for page in following:
            page.show(layer.kind, data)

    def _send(self, data: bytes) -> None:
        for page in self._pages:
            page.send(data)


def _rows(rows: list[Row]) -> bytes:
    return encode({"kind": "overview", "rows": rows})


def _cones(cones: list[ConeCurve] | list[Raw]) -> bytes:
    return encode({"kind": "cones", "cones": cones})
