"""Who may see the page: on this computer only, unless told; never by another site's scripts."""

from __future__ import annotations

import hmac
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.datastructures import Headers, QueryParams

LOCAL = ("localhost", "127.0.0.1", "::1")
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
COOKIE = "radron-token"


@dataclass(frozen=True, slots=True)
class Guard:
    """``hosts``: the names by which the page may be called: others are those of a site whose name was made to point here (DNS
    rebinding). ``token``: that a request must carry; empty where only this computer can connect.
    """

    hosts: tuple[str, ...] = LOCAL
    token: str = ""

    def refusal(
        self, headers: Headers, query: QueryParams, cookies: dict[str, str], welcome: Callable[[str], bool] = lambda origin: False
    ) -> str | None:
        """Why a request is refused; None where it is allowed. ``welcome``: whether another origin than the page may ask too."""
        host = headers.get("host", "")
        if _name(host) not in self.hosts:
            return f"this page is served as {' or '.join(self.hosts)} only"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host and not welcome(origin):
            return "requests of other sites are refused"
        if self.token and not any(
            hmac.compare_digest(given.encode(), self.token.encode())
            for given in (query.get("token", ""), cookies.get(COOKIE, ""))
        ):
            return "open the address that the station has printed, with its token"
        return None


def _name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
