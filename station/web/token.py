"""The page's token: new at each start, or from a file, for scripts."""

from __future__ import annotations

import re
import secrets
from pathlib import Path

from radron.agent.errors import RadronError
from radron.protocol.access import shared_mode
from radron.protocol.issuing import write_file

MIN_TOKEN_CHARACTERS = 22  # 128 bits in the encoding of token_urlsafe
_TOKEN = re.compile(rf"[A-Za-z0-9_-]{{{MIN_TOKEN_CHARACTERS},256}}")


class TokenError(RadronError):
    """The file with the web page's secret token cannot be used."""


def token_from(file: Path | None) -> str:
    """Return the secret token of the web page: from a file, or a new token without a file.

    A missing file is made, readable by its owner only.

    Raises:
        TokenError: the file cannot be read or made, other users can read it, or it holds no token.
    """
    if file is None:
        return secrets.token_urlsafe(24)
    try:
        if not file.exists():
            write_file(file, f"{secrets.token_urlsafe(24)}\n".encode(), secret=True)
        mode, text = shared_mode(file), file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise TokenError(f"{file}: cannot be used as the token's file: {getattr(error, 'strerror', None) or error}") from None
    if mode is not None:
        raise TokenError(f"{file}: others can read or change it (mode {mode:03o}); run `chmod 600 {file}`")
    if not _TOKEN.fullmatch(text):
        raise TokenError(
            f"{file}: holds no token, which is at least {MIN_TOKEN_CHARACTERS} letters, digits, - or _; delete it, and it is made"
        )
    return text
