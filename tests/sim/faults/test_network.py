"""Faults of links: receivers, times, number of copies and bytes."""

import msgpack
import msgspec
import numpy as np
import pytest

from radron.protocol.codec import decode_from, encode
from radron.protocol.errors import ProtocolError
from radron.protocol.messages import Pose
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.network import FaultyRadio, padded
from radron.sim.faults.schedule import Schedule
from radron.sim.world.radio import Radio, RadioTruth

SECOND = 1_000_000_000
NAMES = ("d1", "d2", "d3")
POSE, CONE = "radron/2/s/{}/pose", "radron/2/s/{}/cone"
PLACES = np.array([[0.0, 0.0, 3.0], [30.0, 0.0, 3.0], [70.0, 0.0, 3.0]])
TRUTH = RadioTruth(delay_s=0.02, jitter_s=0.0, loss=0.0, recovery_s=0.5)


def fault(kind, **values):
    return msgspec.convert({"kind": kind, "at_s": 0.0, **values}, KINDS[kind])


class Air:
    """Three drones and a radio, in ticks of 50 ms."""

    def __init__(self, *faults, truth=TRUTH):
        self.schedule = Schedule(faults, NAMES, 1)
        self.radio = FaultyRadio(truth, NAMES, np.random.default_rng(3), self.schedule, 0.05)
        self.time_s = 0.0
        self.go(0.0)

    @property
    def now_ns(self):
        return round(self.time_s * SECOND)

    def go(self, time_s):
        """Go on to a time, tick by tick; what each drone has received by then."""
        got = [[], [], []]
        while True:
            self.schedule.advance(self.time_s)
            self.radio.advance(self.now_ns, PLACES)
            for drone in range(3):
                got[drone] += self.radio.receive(drone, self.now_ns)
            if self.time_s >= time_s - 1e-9:
                return got
            self.time_s = round(self.time_s + 0.05, 6)

    def say(self, drone, payload=b"x", key=POSE, count=1):
        for _ in range(count):
            self.radio.send(drone, key.format(NAMES[drone]), payload, self.now_ns)

    def heard(self):
        """(sender, receiver) of all that hear each other now."""
        pairs = set()
        for sender in range(3):
            self.say(sender, bytes([sender]))
        for receiver, messages in enumerate(self.go(self.time_s + 0.5)):
            pairs |= {(payload[0], receiver) for _, payload in messages}
        return pairs


def test_without_an_active_fault_the_radio_is_the_same_bit_for_bit():
    truth = RadioTruth(loss=0.2)
    later = fault("loss", probability=0.5)
    plain = Radio(truth, 3, np.random.default_rng(3))
    air = Air(msgspec.structs.replace(later, at_s=99.0), truth=truth)
    for radio in (plain, air.radio):
        for k in range(300):
            radio.send(k % 3, (POSE, CONE)[k % 2].format("d1"), k.to_bytes(2), k * 1_000_000)
    for drone in range(3):
        assert air.radio.receive(drone, 10 * SECOND) == plain.receive(drone, 10 * SECOND)


ALL = {(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)}


@pytest.mark.parametrize(
    ("given", "cut"),
    [
        (fault("partition", groups=[["d1", "d2"], ["d3"]]), {(0, 2), (2, 0), (1, 2), (2, 1)}),
        (fault("partition", groups=[["d2", "d3"]]), {(0, 1), (1, 0), (0, 2), (2, 0)}),
        (fault("partition", groups=[[]]), ALL),
        (fault("cut", target="d1"), {(0, 1), (1, 0), (0, 2), (2, 0)}),
        (fault("cut", target="d1", peers="d3", direction="send"), {(0, 2)}),
        (fault("cut", target="d1", peers=["d2", "d3"], direction="receive"), {(1, 0), (2, 0)}),
        (fault("cut"), ALL),
        (fault("range", range_m=35.0), {(0, 2), (2, 0), (1, 2), (2, 1)}),
        (fault("range", range_m=35.0, target="d1"), {(0, 2), (2, 0)}),
    ],
)
def test_who_hears_whom(given, cut):
    air = Air(msgspec.structs.replace(given, for_s=2.0))
    assert air.heard() == ALL - cut
    air.go(2.0)
    assert air.heard() == ALL


def test_log_entries_wait_until_the_link_is_back_and_news_do_not():
    air = Air(fault("cut", target="d1", for_s=10.0))
    for k in range(40):
        air.say(0, bytes([k]), CONE)
        air.say(0, bytes([k]), POSE)
    assert air.go(9.9) == [[], [], []]
    assert [payload for _, payload in air.go(10.6)[1]] == [bytes([k]) for k in range(40)]


def test_a_dead_agent_takes_its_cache_with_it():
    air = Air(fault("cut", target="d1", for_s=1.0))
    air.say(0, key=CONE)
    air.say(1, key=CONE)
    air.radio.silence(0)
    assert [len(heard) for heard in air.go(3.0)] == [0, 0, 1]  # d2's entry went to d3 at once


def test_lost_news_are_lost_and_lost_entries_come_later():
    air = Air(fault("loss", probability=0.5, target="d1", peers="d2"))
    air.say(0, count=1000)
    air.say(0, key=CONE, count=1000)
    at_once = air.go(0.1)
    assert [len(heard) for heard in at_once][2] == 2000
    news, entries = ([key for key, _ in at_once[1]].count(kind.format("d1")) for kind in (POSE, CONE))
    assert 430 < news < 570  # 4.4 sigmas
    assert 430 < entries < 570
    assert len(air.go(20.0)[1]) == 1000 - entries


def arrivals(given):
    """Times at which 400 messages of d1 arrive at d2."""
    air, times = Air(given), []
    air.say(0, count=400)
    for _ in range(60):
        times += [air.time_s] * len(air.go(air.time_s)[1])
        air.time_s = round(air.time_s + 0.05, 6)
    return np.array(times)


def test_delay_and_jitter():
    late = arrivals(fault("delay", delay_s=0.3, jitter_s=0.5))
    assert late.min() >= 0.3
    assert late.max() <= 0.9
    assert 0.5 < late.mean() < 0.7


def test_reordered_messages_come_after_later_ones():
    late = arrivals(fault("reorder", probability=0.25, held_s=1.0))
    assert set(late.tolist()) == {0.05, 1.05}
    assert 60 < (late > 1.0).sum() < 140


def test_duplicates_come_within_their_time():
    late = arrivals(fault("duplicate", probability=0.25, within_s=0.8))
    assert 460 < len(late) < 540
    assert late.max() <= 0.9


def test_corrupted_messages_have_other_bytes():
    air = Air(fault("corrupt", probability=0.5))
    air.say(0, bytes(100), count=400)
    payloads = [payload for _, payload in air.go(0.1)[1]]
    wrong = [payload for payload in payloads if payload != bytes(100)]
    assert 140 < len(wrong) < 260
    assert {np.sign(len(payload) - 100) for payload in wrong} == {-1, 0, 1}


@pytest.mark.parametrize(("size", "rate_mbps", "number"), [(1000, 0.1, 5), (4000, 0.8, 10), (300, 50.0, 300)])
def test_a_flood_is_of_valid_messages_of_the_drone(size, rate_mbps, number):
    air = Air(fault("flood", target="d2", rate_mbps=rate_mbps, message_bytes=size))
    pose = Pose(
        stamp_ns=5, drone="d2", epoch=0, position_m=(1.0, 2.0, 3.0), velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0), position_sigma_m=0.1, yaw_sigma_rad=0.1,
    )  # fmt: skip
    key = POSE.format("d2")
    air.say(1, encode(pose))
    air.go(0.05)
    air.time_s = 0.1
    got = air.go(0.15)
    assert got[1] == []
    flood = [payload for _, payload in got[2] if len(payload) > len(encode(pose))]
    assert len(flood) == pytest.approx(2 * number, abs=3)
    assert all(decode_from(key, payload) == pose for payload in flood[:5])
    assert len(flood[0]) == pytest.approx(size, rel=0.1)
    assert "padding" in msgpack.unpackb(flood[0])


def test_a_flood_of_messages_larger_than_any_pose_is_refused_by_its_size():
    pose = Pose(
        stamp_ns=5, drone="d2", epoch=0, position_m=(1.0, 2.0, 3.0), velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0), position_sigma_m=0.1, yaw_sigma_rad=0.1,
    )  # fmt: skip
    payload = padded(encode(pose), 60_000)
    assert len(payload) == pytest.approx(60_000, rel=0.1)
    with pytest.raises(ProtocolError, match="bytes"):
        decode_from(POSE.format("d2"), payload)
