"""Members that publish false data: the others' copies are valid, and wrong as the scenario says."""

from itertools import product
from math import dist

import msgspec
import pytest

from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Entry
from radron.protocol.keys import key_of
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.liars import KIND_OF, Liars
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Schedule
from radron.sim.lockstep.flight import watched
from radron.sim.lockstep.members import SimulatedAuthority
from support.flights import moments
from support.flights.drone_messages import SECOND, at


def told(what, how, drone=0, **values):
    """A drone's messages in seconds 0 to 20, false from 10 to 15, beside the true ones."""
    lie = msgspec.convert(
        {"kind": "lie", "at_s": 10.0, "for_s": 5.0, "target": "d1", "what": what, "how": how, **values}, KINDS["lie"]
    )
    schedule = Schedule([lie], ("d1", "d2"), 1)
    liars, pairs = (
        Liars([lie], schedule, [SimulatedAuthority(1).trust(name).sign for name in ("d1", "d2")], Poisoners(schedule, [])),
        [],
    )
    for second in range(20):
        schedule.advance(float(second))
        known = at(KIND_OF[what], second)
        key, payload = key_of("s", known), encode(known)
        heard = liars.tell(drone, key, payload)
        assert liars.told(drone, key, payload) == (heard if isinstance(known, Entry) else payload)  # the same version for all
        pairs.append((known, decode_from(key, heard)))
    return pairs


@pytest.mark.parametrize(("what", "how"), list(product(KIND_OF, ("false", "replayed", "mistimed"))))
def test_it_lies_in_its_time_under_valid_numbers(what, how):
    pairs = told(what, how)
    assert [known != heard for known, heard in pairs] == [10 <= second < 15 for second in range(20)]
    for known, heard in pairs:
        assert (heard.stamp_ns == known.stamp_ns) == (how != "mistimed" or known == heard)
        if isinstance(known, Entry):
            assert (heard.boot, heard.sequence) == (known.boot, known.sequence)
    assert all(known == heard for known, heard in told(what, how, drone=1))


def test_replayed_is_what_was_so_before():
    for known, heard in told("pose", "replayed", ago_s=3.0)[10:15]:
        assert heard.position_m[0] == known.position_m[0] - 3.0
    for known, heard in told("counts", "replayed", ago_s=3.0)[10:15]:
        assert heard.counts.hits == known.counts.hits - 3
        assert (heard.stamp_ns, heard.end_ns) == (known.stamp_ns, known.end_ns)


def test_mistimed_is_under_an_older_stamp():
    assert {known.stamp_ns - heard.stamp_ns for known, heard in told("plan", "mistimed", ago_s=3.0)[10:15]} == {3 * SECOND}


def test_false_positions_are_shifted_one_way_and_counts_multiplied():
    shifts = [
        tuple(b - a for a, b in zip(k.position_m, h.position_m, strict=True)) for k, h in told("pose", "false", shift_m=7.0)
    ]
    assert all(dist(shift, (0.0, 0.0, 0.0)) == pytest.approx(7.0) for shift in shifts[10:15])
    assert all(shift == pytest.approx(shifts[10]) for shift in shifts[10:15])
    assert all(heard.counts.hits == 3 * known.counts.hits for known, heard in told("counts", "false", factor=3.0)[10:15])
    assert all(heard.range_m == 15.0 for _, heard in told("sighting", "false", shift_m=5.0)[10:15])
    assert all(heard.orders[0].axis[0] < 0.1 for _, heard in told("cone", "false")[10:15])


def test_who_asks_a_liar_for_entries_hears_what_all_others_do(monkeypatch):
    """Also of a measurement a moment ago: else one number means one entry here, and another there, for good."""
    monkeypatch.setattr("radron.sim.faults.recovery.PERIOD_NS", SECOND // 20)  # a query at any time
    lie = {"kind": "lie", "at_s": 1.0, "target": "d3", "what": "counts", "how": "mistimed", "ago_s": 3.0}
    held = []

    def watch(moment):
        if moment.time_s >= 6.0:
            held.extend([record.entry for record in pilot.fusion.log] for pilot in moment.pilots[:2])
        return bool(held)

    watched(moments.setting(lie).scenario, 1, watch)
    for entries in held:
        assert len([entry for entry in entries if entry.drone == "d3"]) > 10
        assert len({(entry.drone, entry.boot, entry.sequence) for entry in entries}) == len(entries)
