"""Detection of two programs that publish under one name: a copied key, or an agent that was started twice.

A restart also makes a new session under an old name, but the earlier session ends with its process, and its messages arrive
within Zenoh's lease. Two sessions that both publish for longer than that hold the same key. The session id in a message
identifies its session; a holder of the key may forge another session's id, but cannot stop that session's messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

LEASE_S = 1.5  # in which messages of an ended session may still arrive: one and a half times Zenoh's lease
SHOWN_S = 10.0  # a copied key is reported for this time
MAX_SESSIONS = 8  # remembered for a name
MAX_PUBLISHER_NAMES = 128
MAX_OF_RESTART = 2  # sessions within the lease


@dataclass(slots=True)
class _Span:
    first_s: float
    last_s: float


class Publishers:
    """Records when each network session has published under each name, to detect two programs under one name.

    The class has no lock; its owner's lock protects it.
    """

    def __init__(self) -> None:
        self._spans: dict[str, dict[str, _Span]] = {}  # by name and session
        self._shown_s: dict[str, float] = {}

    def note(self, name: str, session: str, now_s: float) -> None:
        """Record that a network ``session`` has published a message under a ``name`` at the time ``now_s``."""
        spans = self._spans.get(name)
        if spans is None:
            if len(self._spans) >= MAX_PUBLISHER_NAMES:
                return
            spans = self._spans[name] = {}
        span = spans.get(session)
        if span is not None and now_s - span.last_s < LEASE_S:
            span.last_s = now_s
        else:
            spans[session] = _Span(now_s, now_s)
        if len(spans) == 1:
            return
        for ended in [one for one, heard in spans.items() if now_s - heard.last_s >= LEASE_S]:
            del spans[ended]
        if len(spans) > MAX_SESSIONS:
            del spans[min(spans, key=lambda one: spans[one].last_s - spans[one].first_s)]
        if len(spans) < 2:
            return
        pairs = combinations(spans.values(), 2)
        together_s = max(min(one.last_s, other.last_s) - max(one.first_s, other.first_s) for one, other in pairs)
        if together_s >= LEASE_S or len(spans) > MAX_OF_RESTART:
            self._shown_s[name] = now_s

    def problems(self, now_s: float) -> tuple[CodedText, ...]:
        """Return one line of text for each name under which two sessions publish."""
        shown = sorted(name for name, shown_s in self._shown_s.items() if now_s - shown_s < SHOWN_S)
        text = "two sessions publish under its name (a copied key, or an agent started twice)"
        return tuple(CodedText(Code.TWO_SESSIONS, f"{name}: {text}", name) for name in shown)
