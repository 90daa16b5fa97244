import numpy as np

from radron.sim.world.radio import Radio, RadioTruth

SECOND = 1_000_000_000


def carried(truth, key, count=2000):
    radio = Radio(truth, 3, np.random.default_rng(3))
    for k in range(count):
        radio.send(0, key, k.to_bytes(4, "big"), 0)
    return radio


def test_delay_is_kept_and_everybody_else_hears():
    radio = carried(RadioTruth(delay_s=0.02, jitter_s=0.01, loss=0.0), "radron/2/s/a/pose", count=100)
    assert radio.receive(1, int(0.0199 * SECOND)) == []
    assert len(radio.receive(1, int(0.0301 * SECOND))) == 100
    assert len(radio.receive(2, SECOND)) == 100
    assert radio.receive(0, SECOND) == []


def test_news_is_lost_at_the_given_rate():
    radio = carried(RadioTruth(loss=0.1), "radron/2/s/a/pose")
    assert 1720 < len(radio.receive(1, 10 * SECOND)) < 1880


def test_log_entries_all_arrive_but_some_late():
    radio = carried(RadioTruth(loss=0.1, recovery_s=0.5), "radron/2/s/a/cone")
    at_once = radio.receive(1, int(0.04 * SECOND))
    late = radio.receive(1, 100 * SECOND)
    assert 1720 < len(at_once) < 1880
    assert len(at_once) + len(late) == 2000


def test_order_of_arrival():
    radio = Radio(RadioTruth(delay_s=0.01, jitter_s=0.1, loss=0.0), 2, np.random.default_rng(1))
    for k in range(50):
        radio.send(0, "radron/2/s/a/pose", bytes([k]), k * 1_000_000)
    first = radio.receive(1, int(0.05 * SECOND))
    rest = radio.receive(1, SECOND)
    assert len(first) + len(rest) == 50
    assert [p for _, p in first + rest] != [bytes([k]) for k in range(50)]  # jitter reorders
