"""The web server's application: the operator's web page and its WebSocket (ASGI)."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from radron.protocol.messages import Action
from radron.protocol.units import DroneId
from radron.station.draft import Draft, drafted, told
from radron.station.hub import Hub, encode
from radron.station.outbox import LET_GO, Page
from radron.station.web.beat import MAX_COMMAND_AGE_S, age_s, stamp
from radron.station.web.content import content
from radron.station.web.flood import Credit
from radron.station.web.guard import HEADERS, Guard
from radron.station.web.talk import talk

PAGE = Path(__file__).parent.parent / "page"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json", ".svg": "image/svg+xml"}
MAX_PAGES = 32
MAX_REQUEST_CHARACTERS = 16_384  # in a page's message: a mission's area may have 256 corners
TOO_OLD = f"refused, it was given more than {MAX_COMMAND_AGE_S:g} s ago: give it again"
_DRAFT_COST = 10.0  # of a mission's check, in messages: tens of milliseconds


class Wish(Struct, frozen=True, forbid_unknown_fields=True):
    """A request of a web page to the station.

    Depending on the fields, the page asks to follow the present (``live``), to show the past time ``at_ms``, to send a
    ``command`` to ``drones`` (none: all), to check a changed mission (``draft``), or to ``upload`` it. ``drawn``: the page has
    drawn the newest state of the swarm. ``beat``: the page's time, sent regularly and repeated in the answer. ``number``: number
    of an order (command or upload), repeated in the answer. ``stamp``: the newest time stamp of the station that the page has
    received, which limits the order's age (``radron.station.web.beat``).
    """

    live: bool = False
    drawn: bool = False
    beat: Annotated[int, Meta(ge=0, le=2**53)] | None = None
    number: Annotated[int, Meta(ge=0, le=2**53)] = 0
    stamp: Annotated[int, Meta(ge=0, le=2**53)] | None = None
    at_ms: Annotated[int, Meta(ge=0, le=2**53)] | None = None
    command: Action | None = None
    drones: Annotated[tuple[DroneId, ...], Meta(max_length=64)] = ()
    draft: Draft | None = None
    upload: bool = False

    @property
    def is_operators(self) -> bool:
        """Whether the operator has caused the request, and not the page by itself."""
        return self.live or self.at_ms is not None or self.command is not None or self.draft is not None


def application(hub: Hub, guard: Guard, doors: Sequence[WebSocketRoute] = ()) -> Starlette:
    """Return the web server's application (ASGI) for the pages of one hub.

    ``guard``: checks the requests' token and origin. ``doors``: WebSocket routes of other programs.
    """
    files = {f"/{path.relative_to(PAGE).as_posix()}": path for path in sorted(PAGE.rglob("*")) if path.suffix in TYPES}
    files["/"] = PAGE / "index.html"

    async def serve_file(request: Request) -> Response:
        """Return a file of the page, from a fixed list: no path comes from the request. The files hold nothing of the mission."""
        path, misled = files.get(request.url.path), guard.misled(request.headers)
        if misled is not None:
            return PlainTextResponse(misled, 403, HEADERS)
        if path is None:
            return PlainTextResponse("no such file", 404, HEADERS)
        return FileResponse(path, media_type=TYPES[path.suffix], headers=HEADERS)

    async def serve_page(socket: WebSocket) -> None:
        if guard.refusal(socket.headers, socket.query_params) is not None:
            await socket.close(LET_GO)
            return
        await socket.accept()
        with hub.joined(MAX_PAGES) as page:
            await talk(socket, _send(socket, page), _listen(socket, page, hub), page.left.wait(), code=lambda: page.code)

    own = [WebSocketRoute("/socket", serve_page), *doors, *content(hub, guard), Route("/{path:path}", serve_file)]
    return Starlette(routes=own)


async def _send(socket: WebSocket, page: Page) -> None:
    while True:
        await socket.send_text((await page.next()).decode())


async def _listen(socket: WebSocket, page: Page, hub: Hub) -> None:
    """Carry out a page's requests until it closes, floods, or sends an invalid message."""
    credit = Credit()
    with contextlib.suppress(WebSocketDisconnect, msgspec.MsgspecError, KeyError):
        while True:
            text = await socket.receive_text()
            if not credit.spend() or len(text) > MAX_REQUEST_CHARACTERS:
                return
            wish = msgspec.json.decode(text, type=Wish)
            if wish.drawn:
                page.drawn()
            if wish.beat is not None:
                page.send(encode({"kind": "beat", "beat": wish.beat, "stamp": stamp()}))
            if wish.live:
                hub.follow(page)
            if wish.at_ms is not None:
                hub.look_back(page, wish.at_ms)
            if wish.command is not None:
                _answer(hub, page, wish, _command(hub, wish, wish.command))
            if wish.draft is not None:
                credit.spend(_DRAFT_COST)
                _edit(hub, page, wish, wish.draft)
            if wish.is_operators:
                page.use()


def _answer(hub: Hub, page: Page, wish: Wish, refused: str) -> None:
    """Answer an order; all pages see a refusal."""
    if refused:
        hub.tell(refused, True, "upload" if wish.command is None else "command")
    page.send(encode({"kind": "answer", "number": wish.number, "refused": refused}))


def _edit(hub: Hub, page: Page, wish: Wish, draft: Draft) -> None:
    """Check a mission, and upload it if requested and without flaws."""
    if hub.upload is None:
        _answer(hub, page, wish, "refused, this station may not upload a mission")
        return
    age = _age_s(wish)
    result = drafted(hub.picture.mission, draft)
    page.send(encode(told(result, draft.number)))
    if not wish.upload:
        return
    if isinstance(result, tuple):
        _answer(hub, page, wish, "refused, the mission has flaws")
    else:
        _answer(hub, page, wish, TOO_OLD if age is None else hub.upload(result, age))


def _command(hub: Hub, wish: Wish, action: Action) -> str:
    """Carry out a command. Returns why it is refused; empty: it is not."""
    if hub.command is None:
        refused = "refused, this station may not command"
    elif not set(wish.drones) <= set(hub.picture.members):
        refused = "refused, there is no such drone"
    else:
        age = _age_s(wish)
        refused = TOO_OLD if age is None else hub.command(action, wish.drones, age)
    return refused and f"{action}: {refused}"


def _age_s(wish: Wish) -> float | None:
    return None if wish.stamp is None else age_s(wish.stamp)
