"""Texts for the operator with their codes: on board, and beside the texts in a status."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct

from radron.protocol.units import DRONE_ID, DroneId

MAX_PROBLEMS, MAX_NOTICES = 32, 8  # in a status
MAX_TEXT = 256  # characters
_DRONE = re.compile(DRONE_ID)
CodeName = Annotated[str, Meta(pattern=r"^[a-z0-9-]{0,48}\Z")]  # any release's; empty: not known


class CodedText(str):
    """A text for the operator. It compares and prints as its words; programs decide by ``code`` and ``about``.

    ``code``: one of ``codes.Code``, or of another release; empty in a message or record without codes. ``about``: the drone that
    the text names as its subject; None: the publisher, or no drone.
    """

    __slots__ = ("about", "code")
    code: str
    about: str | None

    def __new__(cls, code: str, words: str, about: str | None = None) -> CodedText:
        """Return a text with these words."""
        made = super().__new__(cls, words)
        made.code, made.about = str(code), about
        return made

    def __getnewargs__(self) -> tuple[str, str, str | None]:  # type: ignore[override]
        """Return the arguments of a copy."""
        return self.code, str(self), self.about

    @property
    def short(self) -> CodedText:
        """This text as long as a message carries it."""
        return self if len(self) <= MAX_TEXT else CodedText(self.code, self[:MAX_TEXT], self.about)


class Label(Struct, frozen=True, array_like=True):
    """The code of a text in a status, and the drone that the text is about (None: the publisher, or no drone)."""

    code: CodeName
    about: DroneId | None = None

    @classmethod
    def of(cls, text: CodedText) -> Label:
        """Return the label of a text. A subject without the form of a drone's id, such as an operator, is left out."""
        about = text.about if text.about is not None and _DRONE.match(text.about) else None
        return cls(text.code, about)


class Codes(Struct, frozen=True, array_like=True):
    """The codes of a status's texts, one for each and in their order."""

    problems: Annotated[tuple[Label, ...], Meta(max_length=MAX_PROBLEMS)] = ()
    finding: Label | None = None
    notices: Annotated[tuple[Label, ...], Meta(max_length=MAX_NOTICES)] = ()

    def flaw(self, problems: Sequence[str], finding: str, notices: Sequence[str]) -> str | None:
        """Return an error text unless each of these texts has a code, and each code a text."""
        given = len(self.problems), int(self.finding is not None), len(self.notices)
        needed = len(problems), int(finding != ""), len(notices)
        return None if given == needed else f"codes of {sum(given)} texts for {sum(needed)}"


class Texts(NamedTuple):
    """The texts of a status. ``finding``: None while a search continues."""

    problems: tuple[CodedText, ...] = ()
    finding: CodedText | None = None
    notices: tuple[CodedText, ...] = ()

    @classmethod
    def read(cls, problems: Sequence[str], finding: str, notices: Sequence[str], codes: Codes | None) -> Texts:
        """Return the texts of a status with their codes, which are empty if the status has none."""
        if codes is None:
            return cls(coded("", problems), CodedText("", finding) if finding else None, coded("", notices))
        found = None if codes.finding is None else CodedText(codes.finding.code, finding, codes.finding.about)
        return cls(_labelled(problems, codes.problems), found, _labelled(notices, codes.notices))

    @property
    def codes(self) -> Codes:
        """The codes of these texts."""
        finding = None if self.finding is None else Label.of(self.finding)
        return Codes(tuple(map(Label.of, self.problems)), finding, tuple(map(Label.of, self.notices)))


def sendable(texts: Iterable[CodedText], limit: int) -> tuple[CodedText, ...]:
    """Return each text once, no more and no longer than a status carries."""
    return tuple(dict.fromkeys(text.short for text in texts))[:limit]


def coded(code: str, texts: Iterable[str]) -> tuple[CodedText, ...]:
    """Return texts of another program, such as a driver, with one code."""
    return tuple(CodedText(code, text) for text in texts)


def _labelled(texts: Sequence[str], labels: Sequence[Label]) -> tuple[CodedText, ...]:
    return tuple(CodedText(label.code, text, label.about) for text, label in zip(texts, labels, strict=True))
