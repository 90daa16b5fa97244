"""The page and its WebSocket, as an ASGI application."""

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

from protocol.messages import Action
from protocol.units import DroneId
from station.draft import Draft, drafted, told
from station.hub import Hub, encode
from station.outbox import Page
from station.web.content import content, guarded
from station.web.flood import Credit
from station.web.guard import COOKIE, HEADERS, Guard
from station.web.talk import talk

PAGE = Path(__file__).parent.parent / "page"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json", ".svg": "image/svg+xml"}
MOST_PAGES = 32
LONGEST_REQUEST = 16_384  # bytes of a message from a page: a mission's area may have 256 corners
_DRAFT_COST = 10.0  # of a mission that is to be checked, in messages: tens of milliseconds


class Wish(Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for: to follow the present (``live``), to see a time, to command the drones (none: all), to have a mission
    checked, or to ``upload`` it.

    ``drawn``: the newest frame that it got has been drawn.
    """

    live: bool = False
    drawn: bool = False
    at_ms: Annotated[int, Meta(ge=0, le=2**53)] | None = None
    command: Action | None = None
    drones: Annotated[tuple[DroneId, ...], Meta(max_length=64)] = ()
    draft: Draft | None = None
    upload: bool = False


def application(hub: Hub, guard: Guard, doors: Sequence[WebSocketRoute] = ()) -> Starlette:
    """The application of one hub; ``doors``: sockets of other programs."""
    files = {f"/{path.relative_to(PAGE).as_posix()}": path for path in sorted(PAGE.rglob("*")) if path.suffix in TYPES}
    files["/"] = PAGE / "index.html"

    async def serve_file(request: Request) -> Response:
        """A file of the page, of a fixed list: no path comes from the request."""
        path = files.get(request.url.path)
        if path is None:
            return PlainTextResponse("no such file", 404, HEADERS)
        response = FileResponse(path, media_type=TYPES[path.suffix], headers=HEADERS)
        if guard.token and request.query_params.get("token"):
            response.set_cookie(COOKIE, guard.token, secure=True, httponly=True, samesite="strict")
        return response

    async def serve_page(socket: WebSocket) -> None:
        if guard.refusal(socket.headers, socket.query_params, socket.cookies) is not None or hub.pages >= MOST_PAGES:
            await socket.close(1008)
            return
        await socket.accept()
        with hub.joined() as page:
            await talk(socket, _send(socket, page), _listen(socket, page, hub))

    own = [WebSocketRoute("/socket", serve_page), *doors, *content(hub, guard), Route("/{path:path}", guarded(guard, serve_file))]
    return Starlette(routes=own)


async def _send(socket: WebSocket, page: Page) -> None:
    while not page.gone:
        await socket.send_text((await page.next()).decode())


async def _listen(socket: WebSocket, page: Page, hub: Hub) -> None:
    """Obey a page, until it closes, floods, or says what no page says."""
    credit = Credit()
    with contextlib.suppress(WebSocketDisconnect, msgspec.MsgspecError, KeyError):
        while True:
            text = await socket.receive_text()
            if not credit.spend() or len(text) > LONGEST_REQUEST:
                return
            wish = msgspec.json.decode(text, type=Wish)
            if wish.drawn:
                page.drawn()
            if wish.live:
                hub.follow(page)
            if wish.at_ms is not None:
                hub.look_back(page, wish.at_ms)
            if wish.command is not None:
                _command(hub, wish.command, wish.drones)
            if wish.draft is not None:
                credit.spend(_DRAFT_COST)
                _edit(hub, page, wish.draft, wish.upload)


def _edit(hub: Hub, page: Page, draft: Draft, upload: bool) -> None:
    """Check a mission, and upload one without flaws."""
    if hub.upload is None:
        hub.tell("refused, this station may not upload a mission", True, "upload")
        return
    result = drafted(hub.picture.mission, draft)
    page.send(encode(told(result, draft.number)))
    if upload and not isinstance(result, tuple):
        hub.upload(result)


def _command(hub: Hub, action: Action, drones: tuple[str, ...]) -> None:
    if hub.command is None:
        hub.tell(f"{action}: refused, this station may not command", True)
    elif not set(drones) <= set(hub.picture.members):
        hub.tell(f"{action}: refused, there is no such drone", True)
    else:
        hub.command(action, drones)
