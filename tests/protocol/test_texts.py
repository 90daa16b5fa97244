"""Codes of the texts for the operator: on the wire, their signature, and the table of codes."""

from __future__ import annotations

import copy
import pickle
import re
from collections import Counter
from pathlib import Path

import msgpack
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from radron.protocol.codec import MAX_PAYLOAD_BYTES, decode, encode
from radron.protocol.codes import Code
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from radron.protocol.signing import Verifier, sign_status
from radron.protocol.texts import MAX_NOTICES, MAX_PROBLEMS, MAX_TEXT, CodedText, Texts, sendable
from support.flights.members import AUTHORITY
from support.flights.one_pilot import MISSION, START_NS, messages, pilot

ROOT = Path(__file__).parents[2]
MAX_ACTION_WORDS = 15  # of a line on a card for the operator
FLOOD = CodedText(Code.FLOOD, "d3 floods the mesh", "d3")
TEXTS = Texts(
    (FLOOD, CodedText(Code.BATTERY_LOW, "its battery is low")),
    CodedText(Code.NOTHING_FOUND, "nothing found"),
    (CodedText(Code.LINKS_INSECURE, "links are not encrypted"),),
)


def status(texts: Texts = TEXTS, **changes: object) -> Status:
    words = {
        "problems": tuple(map(str, texts.problems)),
        "finding": str(texts.finding or ""),
        "notices": tuple(map(str, texts.notices)),
    }
    fields = {"mission": MISSION.mission_id, "boot": "2" * 16, "stage": Stage.HOLD, "codes": texts.codes, **words, **changes}
    return Status(stamp_ns=START_NS, drone="d2", **fields)


def labels(texts: Texts) -> list[tuple[str, str | None]]:
    one = () if texts.finding is None else (texts.finding,)
    return [(text.code, text.about) for text in (*texts.problems, *one, *texts.notices)]


def test_every_code_is_kebab_case_and_tells_the_operator_what_to_do() -> None:
    for code in Code:
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", code), code
        assert code == code.name.lower().replace("_", "-")
        assert code.when.endswith("."), code
        assert code.action.endswith("."), code
        assert len(code.action.split()) <= MAX_ACTION_WORDS, code


def test_every_code_belongs_to_a_text_of_the_agent() -> None:
    files = [path for folder in ("agent", "protocol") for path in (ROOT / folder).rglob("*.py") if path.name != "codes.py"]
    used = Counter(name for path in files for name in re.findall(r"\bCode\.([A-Z_]+)", path.read_text("utf-8")))
    assert set(used) == set(Code.__members__)


def test_a_text_is_compared_by_its_words_and_keeps_its_code_when_copied_or_shortened() -> None:
    for text in (FLOOD, copy.deepcopy(FLOOD), pickle.loads(pickle.dumps(FLOOD)), FLOOD.short):
        assert (text, text.code, text.about) == ("d3 floods the mesh", Code.FLOOD, "d3")
    long = CodedText(Code.FLOOD, "x" * (MAX_TEXT + 1), "d3")
    assert [(text.code, text.about, len(text)) for text in sendable([long, long, FLOOD], 1)] == [(Code.FLOOD, "d3", MAX_TEXT)]


def test_codes_arrive_with_their_texts() -> None:
    read = decode(encode(status())).texts
    assert read == TEXTS
    assert labels(read) == [("flood", "d3"), ("battery-low", None), ("nothing-found", None), ("links-insecure", None)]


def test_a_status_of_a_release_without_codes_is_read() -> None:
    read = decode(encode(status(codes=UNSET))).texts
    assert read == TEXTS
    assert labels(read) == [("", None)] * 4


def test_the_codes_of_the_longest_texts_fit_into_a_status() -> None:
    text = CodedText("x" * 48, "\U0001f6f8" * MAX_TEXT, "d" * 32)
    longest = Texts((text,) * MAX_PROBLEMS, text, (text,) * MAX_NOTICES)
    assert len(encode(status(longest))) < MAX_PAYLOAD_BYTES


BAD = {
    "no list": "flood",
    "a number as code": [[[7, "d3"], ["battery-low"]], ["nothing-found"], [["links-insecure"]]],
    "a long code": [[["x" * 49, "d3"], ["battery-low"]], ["nothing-found"], [["links-insecure"]]],
    "a code in other letters": [[["Flood\n", "d3"], ["battery-low"]], ["nothing-found"], [["links-insecure"]]],
    "no drone": [[["flood", "D 3"], ["battery-low"]], ["nothing-found"], [["links-insecure"]]],
    "more codes than texts": [[["flood", "d3"]] * 3, ["nothing-found"], [["links-insecure"]]],
    "fewer codes than texts": [[["flood", "d3"]], ["nothing-found"], [["links-insecure"]]],
    "too many codes": [[["flood", "d3"]] * (MAX_PROBLEMS + 1), ["nothing-found"], [["links-insecure"]]],
    "no code of the finding": [[["flood", "d3"], ["battery-low"]], None, [["links-insecure"]]],
    "no codes of notices": [[["flood", "d3"], ["battery-low"]], ["nothing-found"]],
}


@pytest.mark.parametrize("codes", BAD.values(), ids=BAD)
def test_bad_codes_are_counted_and_dropped_with_their_status_and_the_flight_goes_on(codes: object) -> None:
    good = status()
    payload = msgpack.packb({**msgpack.unpackb(encode(good)), "codes": codes})
    with pytest.raises(ProtocolError):
        decode(payload)
    one = pilot()
    assert one.receive(key_of("radron", good), payload, START_NS) is None
    assert one.counters["rejected_malformed"] == 1
    one.receive(key_of("radron", good), encode(good), START_NS)
    assert one.counters["rejected_malformed"] == 1
    one.step(START_NS)


def test_a_status_counts_only_with_the_codes_that_its_drone_has_signed() -> None:
    one, signed = Verifier(AUTHORITY), decode(encode(sign_status(status(), AUTHORITY.trust("d2"))))
    assert one.accepts_status(signed)
    assert not one.accepts_status(replace(signed, codes=replace(signed.codes, problems=signed.codes.problems[::-1])))
    assert not one.accepts_status(replace(signed, codes=UNSET))
    assert one.accepts_status(sign_status(status(codes=UNSET), AUTHORITY.trust("d2")))


@pytest.mark.parametrize("about", ["operator anna", "station", "D7", "d" * 40])
def test_a_text_about_no_drone_does_not_hold_back_the_status(about: str) -> None:
    """A flooding station, a program of another version: their names are no ids of drones."""
    flood = CodedText(Code.FLOOD, f"{about} floods the mesh", about)
    sent = status(Texts((flood,), None, ()))
    assert decode(encode(sent)) == sent
    assert labels(sent.texts) == [(Code.FLOOD, None)]
    one = pilot()
    one.warn((flood,))
    statuses = [each for step in range(60) for each in messages(one.step(START_NS + step * 50_000_000), Status)]
    assert any(str(flood) in each.problems for each in statuses)
