"""Access checks of the web page: token, host name, and origin of scripts."""

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
_DEFAULT_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True, slots=True)
class Guard:
    """Checks that a request comes from the station's own web page, opened with the secret token.

    ``hosts``: the page's own host names; any other name may belong to a foreign site that was made to point here (DNS rebinding).
    ``scheme``, ``port`` and ``hosts`` form the origins of the page's own scripts. ``token``: secret word of every request for the
    station's data and of every socket, which other programs and users of this computer do not know.
    """

    token: str
    scheme: str
    port: int
    hosts: tuple[str, ...] = LOCAL

    def misled(self, headers: Headers, welcome: Callable[[str], bool] = lambda origin: False) -> str | None:
        """Return why a request must be refused, by its host name and origin; None if it is allowed.

        ``welcome``: accepts further origins.
        """
        if _name(headers.get("host", "")) not in self.hosts:
            return f"this page is served as {' or '.join(self.hosts)} only"
        origin = headers.get("origin")
        if origin is not None and not self._is_own(origin) and not welcome(origin):
            return "requests of other sites are refused"
        return None

    def refusal(self, headers: Headers, query: QueryParams, welcome: Callable[[str], bool] = lambda origin: False) -> str | None:
        """Return why a request for the station's data must be refused, by its host name, origin and token; None if it is allowed.

        ``welcome``: accepts further origins.
        """
        if misled := self.misled(headers, welcome):
            return misled
        if not hmac.compare_digest(query.get("token", "").encode(), self.token.encode()):
            return "open the address that the station has printed, with its token"
        return None

    def _is_own(self, origin: str) -> bool:
        """Return whether scheme, host name and port of an origin are the page's own."""
        try:
            parts = urlsplit(origin)
            port = parts.port or _DEFAULT_PORTS.get(parts.scheme)
        except ValueError:
            return False
        return parts.scheme == self.scheme and parts.hostname in self.hosts and port == self.port


def _name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
