"""How many log entries of a drone are taken: as many as three cameras measure, and backlogs at once."""

from radron.agent.fusion.admission import (
    BOOT_BURST,
    BOOT_RATE,
    BURST_ENTRIES,
    DEFERRAL_REPORTED_NS,
    FIRST,
    FIRST_NS,
    RATE,
    RATE_BESIDE,
    Admission,
)
from radron.protocol.entries import Credential, Retraction

SECOND = 1_000_000_000
BEGAN_NS = 1_800_000_000 * SECOND


def entry(drone, boot=0):
    return Retraction(stamp_ns=BEGAN_NS, drone=drone, mission="0" * 16, boot=f"{boot:016x}", sequence=2, first=1, last=1)


def credential(drone, boot):
    return Credential(stamp_ns=BEGAN_NS, drone=drone, mission="0" * 16, boot=f"{boot:016x}", sequence=0, certificate=b"")


def taken(admission, drone, now_ns, offered):
    """How many of so many entries are taken."""
    return sum(takes(admission, entry(drone), now_ns) for _ in range(offered))


def takes(admission, one, now_ns):
    admits = admission.admits(one, now_ns)
    if admits:
        admission.charge(one, now_ns)
    return admits


def settled(drones=3):
    """Of an agent that has run for a while."""
    admission = Admission(drones)
    admission.admits(entry("d1"), BEGAN_NS)
    return admission, BEGAN_NS + FIRST_NS


def test_an_agent_that_has_just_begun_takes_the_log_of_a_long_mission_at_once():
    admission = Admission(3)
    assert [taken(admission, drone, BEGAN_NS, 36_000) for drone in ("d1", "d2")] == [36_000] * 2
    assert FIRST > 36_000


def test_what_was_missed_in_a_minute_comes_at_once():
    admission, now_ns = settled()
    assert taken(admission, "d2", now_ns, 60 * 32) == 60 * 32  # of a camera in flight
    assert admission.put_off(now_ns) == frozenset()


def test_of_a_drone_that_publishes_ever_more_only_as_much_as_of_three_cameras_is_taken_and_it_alone_is_told():
    admission, now_ns = settled()
    most = RATE + 2 * RATE_BESIDE
    counts = [taken(admission, "d2", now_ns + second * SECOND, 1000) for second in range(30)]
    assert sum(counts) == BURST_ENTRIES + 29 * most
    assert taken(admission, "d3", now_ns + 30 * SECOND, 100) == 100
    assert admission.put_off(now_ns + 30 * SECOND) == {"d2"}
    assert admission.put_off(now_ns + 30 * SECOND + DEFERRAL_REPORTED_NS) == frozenset()


def test_entries_that_were_known_or_forged_use_up_nothing():
    admission, now_ns = settled()
    assert all(admission.admits(entry("d2"), now_ns) for _ in range(20_000))


def test_a_drone_that_begins_boot_after_boot_is_put_off_and_told_and_its_entries_of_known_ones_are_taken():
    admission, now_ns = settled()
    times_ns = [now_ns + second * SECOND for second in range(100)]
    assert (
        sum(takes(admission, credential("d2", number), at_ns) for number, at_ns in enumerate(times_ns))
        <= BOOT_BURST + 100 * BOOT_RATE
    )
    assert admission.put_off(times_ns[-1]) == {"d2"}
    assert taken(admission, "d2", times_ns[-1], 100) == 100
    assert takes(admission, credential("d3", 1), times_ns[-1])
