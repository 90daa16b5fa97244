"""Delays from causes to their effects, found in timelines of recordings and of emulated vehicles alike."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from support.px4.sequences import Rows, commands, first_after, of_kind

ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
LAND, SET_MODE = mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_DO_SET_MODE
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
CRITICAL, ARMED = mavlink.MAV_STATE_CRITICAL, 0x80
TAKEOFF_DETECTED, LANDING_DETECTED, ARMED_BY, DISARMED = 0x1414569, 0x19638AC, 0x190CAF3, 0x1F46777
FAILSAFE, FAILSAFE_OF, HOLD_FIRST, HOLD_FIRST_OF, DESCEND = 0x1DEDBD0, 0x194CA8A, 0x144B3E0, 0x1D11DF6, 0x1C2DC72
FUSION_STOPPED, STATION_LOST, FENCE = 0x1E04AA7, 0x1A4B458, 0x13E092F
LOW, EMERGENCY, RETURN_LANDS = 0x14D0DA4, 0x1AD1B07, 0x102D3AA
BY_LANDING = "06"
SOON_MS = 3_000.0  # later effects have another cause
Found = Iterator[tuple[float, float | None]]  # cause, effect


class Flown(NamedTuple):
    """A timeline, and when its streams of setpoints ended."""

    name: str
    rows: Rows
    ends_ms: list[float]


def _acks(flown: Flown) -> Found:
    for row in of_kind(flown.rows, "command"):
        yield row[0], first_after(flown.rows, row[0], "ack", row[2])


def _second_acks(flown: Flown) -> Found:
    for sent in commands(flown.rows, SET_MODE):
        found = [row[0] for row in of_kind(flown.rows, "ack") if row[2] == SET_MODE and row[0] >= sent]
        yield sent, found[1] if len(found) > 1 else None


def _beat(flown: Flown, since_ms: float, wanted: Callable[[list[int]], bool]) -> float | None:
    return next((row[0] for row in of_kind(flown.rows, "heartbeat") if row[0] >= since_ms and wanted(row[2:])), None)


def _armed_beats(flown: Flown) -> Found:
    for sent in commands(flown.rows, ARM, 1.0):
        before = [row for row in of_kind(flown.rows, "heartbeat") if row[0] < sent]
        acked = first_after(flown.rows, sent, "ack", ARM, 0)
        if acked is not None and acked - sent < 100.0 and not (before and before[-1][3] & ARMED):
            yield acked, _beat(flown, acked, lambda beat: bool(beat[1] & ARMED))


def _after_commands(number: int, kind: str, *values: object, within_ms: float = 40_000.0) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        for sent in commands(flown.rows, number, *([1.0] if number == ARM else [])):
            on_ground = [row[2] for row in of_kind(flown.rows, "landed") if row[0] <= sent][-1:] == [ON_GROUND]
            airborne = number == LAND
            if number == TAKEOFF and not _is_armed(flown, sent):
                continue  # counted from arming
            effect = first_after(flown.rows, sent, kind, *values)
            if on_ground != airborne and effect is not None and effect - sent < within_ms:
                yield sent, effect

    return found


def _is_armed(flown: Flown, now_ms: float) -> bool:
    told = [row[2] for row in of_kind(flown.rows, "event") if row[2] in (ARMED_BY, DISARMED) and row[0] <= now_ms + 5.0]
    return told[-1:] == [ARMED_BY]


def _lands(flown: Flown) -> Found:
    """By command, or by a failsafe."""
    yield from _after_commands(LAND, "landed", ON_GROUND)(flown)
    for row in of_kind(flown.rows, "event"):
        if row[2] in (FAILSAFE, FAILSAFE_OF) and row[4][8:10] == "07":
            yield row[0], first_after(flown.rows, row[0], "landed", ON_GROUND)


def _climbs(height_m: float) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        told = [row for row in of_kind(flown.rows, "event") if row[2] == 0x13B2FC7]
        high = all(row[4] == {5.0: "0000a040", 3.0: "00004040"}[height_m] for row in told)
        if told and high:
            for cause, effect in _after(TAKEOFF_DETECTED, "landed", IN_AIR, within_ms=20_000.0)(flown):
                if any(row[0] >= cause and row[2] == TAKING_OFF for row in of_kind(flown.rows, "landed")):
                    yield cause, effect

    return found


def _after(event: int, kind: str, *values: object, within_ms: float = SOON_MS) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        for row in of_kind(flown.rows, "event"):
            if row[2] == event:
                effect = first_after(flown.rows, row[0], kind, *values)
                if effect is not None and effect - row[0] < within_ms:
                    yield row[0], effect

    return found


def _critical_beats(flown: Flown) -> Found:
    for row in of_kind(flown.rows, "event"):
        before = [beat[4] for beat in of_kind(flown.rows, "heartbeat") if beat[0] <= row[0]][-1:]
        if row[2] in (FAILSAFE, HOLD_FIRST, HOLD_FIRST_OF, DESCEND) and before != [CRITICAL]:
            yield row[0], _beat(flown, row[0], lambda beat: beat[2] == CRITICAL)


def _disarmed_beats(flown: Flown) -> Found:
    for row in of_kind(flown.rows, "event"):
        if row[2] == DISARMED:
            yield row[0], _beat(flown, row[0], lambda beat: not beat[1] & ARMED)


def _silences(flown: Flown) -> Found:
    for end in flown.ends_ms:
        effect = first_after(flown.rows, end, "event", FAILSAFE)
        if effect is not None and effect - end < SOON_MS:
            yield end, effect


def _blind(event: int) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        if flown.name.startswith("D_gps_loss"):
            lost = first_after(flown.rows, 0.0, "param_set", "SIM_GPS_USED", 0)
            effect = None if lost is None else first_after(flown.rows, lost, "event", event)
            if lost is not None and effect is not None:
                yield lost, effect

    return found


def _unaided(flown: Flown) -> Found:
    for lost in (row[0] for row in of_kind(flown.rows, "param_set") if row[2:4] == ["SIM_GPS_USED", 0]):
        yield lost, first_after(flown.rows, lost, "fix", 0)


def _resumed(flown: Flown) -> Found:
    back = first_after(flown.rows, 0.0, "param_set", "SIM_GPS_USED", 10)
    failed = first_after(flown.rows, 0.0, "event", DESCEND)
    if flown.name.startswith("D_gps_loss") and back is not None and failed is not None:
        armed = first_after(flown.rows, 0.0, "event", DISARMED) is None
        effect = _beat(flown, max(back, failed + 500.0), lambda beat: beat[0] == 6 << 16)
        if armed and effect is not None:
            yield back, effect


def _stations(flown: Flown) -> Found:
    for row in of_kind(flown.rows, "event"):
        beats = [beat[0] for beat in of_kind(flown.rows, "beat") if beat[3] == 190 and beat[0] <= row[0]]
        if row[2] == STATION_LOST and beats:
            yield beats[-1], row[0]


def _battery(event: int) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        dead = next(commands(flown.rows, mavlink.MAV_CMD_INJECT_FAILURE, 100.0, 1.0), None)
        effect = None if dead is None else first_after(flown.rows, dead, "event", event)
        if dead is not None and effect is not None:
            yield dead, effect

    return found


def _drained(event: int) -> Callable[[Flown], Found]:
    def found(flown: Flown) -> Found:
        armed = next(commands(flown.rows, ARM, 1.0), None)
        effect = first_after(flown.rows, 0.0, "event", event)
        if flown.name == "D_battery_drain_60s" and armed is not None and effect is not None:
            yield armed, effect

    return found


DELAYS: dict[str, Callable[[Flown], Found]] = {
    "command -> ack": _acks,
    "DO_SET_MODE -> second ack": _second_acks,
    "armed -> heartbeat": _armed_beats,
    "arm -> takeoff detected": _after_commands(ARM, "event", TAKEOFF_DETECTED, within_ms=5_000.0),
    "arm -> TAKEOFF": _after_commands(ARM, "landed", TAKING_OFF, within_ms=5_000.0),
    "takeoff -> TAKEOFF": _after_commands(TAKEOFF, "landed", TAKING_OFF, within_ms=5_000.0),
    "takeoff detected -> IN_AIR, 5 m": _climbs(5.0),
    "takeoff detected -> IN_AIR, 3 m": _climbs(3.0),
    "takeoff -> IN_AIR": _after_commands(TAKEOFF, "landed", IN_AIR, within_ms=12_000.0),
    "land -> LANDING": _after_commands(LAND, "landed", LANDING),
    "land -> ON_GROUND": _lands,
    "landing detected -> ON_GROUND": _after(LANDING_DETECTED, "landed", ON_GROUND),
    "landing detected -> disarmed": _after(LANDING_DETECTED, "event", DISARMED, 0x66, BY_LANDING),
    "disarmed -> heartbeat": _disarmed_beats,
    "stream ends -> failsafe": _silences,
    "failsafe -> status 5": _critical_beats,
    "satellites lost -> fix 0": _unaided,
    "satellites lost -> descend": _blind(DESCEND),
    "satellites lost -> given up": _blind(FUSION_STOPPED),
    "satellites back -> OFFBOARD": _resumed,
    "ground station silent -> lost": _stations,
    "ground station lost -> hold": _after(STATION_LOST, "event", HOLD_FIRST_OF),
    "hold -> acts": _after(HOLD_FIRST_OF, "event", FAILSAFE_OF, within_ms=9_000.0),
    "hold at the fence -> acts": _after(HOLD_FIRST, "event", FAILSAFE, within_ms=9_000.0),
    "battery dead -> low": _battery(LOW),
    "battery dead -> hold": _battery(HOLD_FIRST_OF),
    "battery dead -> emergency": _battery(EMERGENCY),
    "battery drains -> low": _drained(LOW),
    "battery drains -> hold": _drained(HOLD_FIRST_OF),
    "battery drains -> emergency": _drained(EMERGENCY),
    "return -> lands at home": _after(0x1522694, "event", RETURN_LANDS, within_ms=20_000.0),
}


def delays(flights: list[Flown]) -> dict[str, list[float]]:
    """Milliseconds, of each kind that occurs."""
    found: defaultdict[str, list[float]] = defaultdict(list)
    for flown in flights:
        for name, find in DELAYS.items():
            found[name] += [effect - cause for cause, effect in find(flown) if effect is not None]
    return dict(found)
