"""Content of the web page besides its own files: the report on the mission, and the layers below the map."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from radron.agent.errors import RadronError
from radron.station.hub import Hub
from radron.station.web.guard import HEADERS, Guard

CACHED_HEADERS = {**HEADERS, "Cache-Control": "private, max-age=3600"}  # by the browser, while the map is moved
NOTHING = '<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"/>'  # in place of a missing tile
_PLACE = re.compile(r"(\d{1,2})/(\d{1,8})/(\d{1,8})")
Answer = Callable[[Request], Awaitable[Response]]


def content(hub: Hub, guard: Guard) -> list[Route]:
    """Return the web server's routes for the report, the map's vector layer and its background tiles."""
    reporting = False

    async def report(_: Request) -> Response:
        """Return the present findings; one report at a time."""
        nonlocal reporting
        if hub.findings is None or reporting:
            return PlainTextResponse("there is no report" if hub.findings is None else "a report is being made", 503, HEADERS)
        reporting = True
        try:
            data = await hub.findings()
        except RadronError as error:
            return PlainTextResponse(str(error), 503, HEADERS)
        finally:
            reporting = False
        name = f'attachment; filename="report-{hub.picture.mission.mission_id}.zip"'
        return Response(data, 200, {**HEADERS, "Content-Disposition": name}, "application/zip")

    async def layer(_: Request) -> Response:
        return Response(hub.background.layer, 200, HEADERS, "application/json")

    async def tile(request: Request) -> Response:
        tiles, place = hub.background.tiles, _PLACE.fullmatch(request.path_params["place"])
        found = tiles.tile(*map(int, place.groups())) if tiles is not None and place is not None else None
        image, kind = found or (NOTHING, "image/svg+xml")
        return Response(image, 200, CACHED_HEADERS, kind)

    places: dict[str, Answer] = {"/report.zip": report, "/layer.json": layer, "/tiles/{place:path}": tile}
    return [Route(path, guarded(guard, answer)) for path, answer in places.items()]


def guarded(guard: Guard, answer: Answer) -> Answer:
    """Return a request handler that refuses requests without the station's token, and passes others on to ``answer``."""

    async def checked(request: Request) -> Response:
        refusal = guard.refusal(request.headers, request.query_params)
        return await answer(request) if refusal is None else PlainTextResponse(refusal, 403, HEADERS)

    return checked
