"""Reports on a faulty camera, and which faults prevent a start."""

import numpy as np

from radron.agent.detector.readout import PixelHits, Readout
from radron.protocol.codec import decode_from
from radron.protocol.messages import Stage, Status
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, messages, pilot, state


def after_30_s(hits_of):
    """The last status and all exposures of a drone on the ground that got the hits of each 0.2 s, by their number."""
    one = pilot()
    status, exposures = None, []
    for k in range(150):
        start_ns = START_NS + k * SECOND // 5
        now_ns = start_ns + SECOND // 5
        one.observe_vehicle(state(now_ns - TICK_NS, armed=False, in_air=False))
        published = one.observe_detector(Readout(start_ns, now_ns, start_ns, 0.2, hits_of(k)))
        exposures += [decode_from(key, payload) for key, payload in published]
        step = one.step(now_ns)
        status = (messages(step, Status) or [status])[-1]
    return status, exposures


def hits(index):
    tick = 1_000_000 * (1 + np.arange(len(index), dtype=np.int64))
    return PixelHits(tick, np.asarray(index, np.uint16), np.full(len(index), 80, np.uint16))


def test_a_noisy_pixel_is_told_to_the_operator_and_counts_no_more():
    status, exposures = after_30_s(lambda k: hits([40_000] * 6 + [(7919 * k) % 65536]))
    assert "camera: 1 noisy pixel masked" in status.problems
    assert status.counters["pixel_hits_of_noise"] > 800
    live_s = sum(exposure.live_time_s for exposure in exposures[10:])
    assert live_s > 20.0
    assert sum(exposure.counts.hits for exposure in exposures[10:]) < 6.0 * live_s


def test_a_camera_without_any_hit_is_told_to_the_operator():
    status, _ = after_30_s(lambda k: PixelHits.none())
    assert any(problem.startswith("camera: no hit for 20 s") for problem in status.problems)


def test_a_camera_that_delivers_nothing_any_more_is_told_to_the_operator():
    one, now_ns = pilot(), START_NS
    told = []
    for k in range(100):
        now_ns += SECOND // 5
        one.observe_vehicle(state(now_ns - TICK_NS, armed=False, in_air=False))
        if k < 25:
            one.observe_detector(Readout(now_ns - SECOND // 5, now_ns, START_NS, 0.2, hits([(7919 * k) % 65536])))
        told += [("camera: it delivers nothing any more" in one.problems, k / 5) for _ in messages(one.step(now_ns), Status)]
    assert 14.8 <= min(at_s for is_told, at_s in told if is_told) <= 16.2
    assert told[-1][0]


def test_a_healthy_camera_is_no_problem():
    status, _ = after_30_s(lambda k: hits([(7919 * k) % 65536]))
    assert not any("camera" in problem for problem in status.problems)
    assert status.stage is Stage.PREFLIGHT


def test_a_camera_that_repeats_itself_is_told_to_the_operator_and_counts_no_more():
    stuck = [(7919 * k) % 65536 for k in range(30)]
    status, exposures = after_30_s(lambda k: hits(stuck if k >= 50 else [(7919 * k + j * j) % 65536 for j in range(5)]))
    assert "camera: it delivers the same hits again and again; they are not used" in status.problems
    assert status.counters["readouts_repeated"] == 99
    assert sum(exposure.counts.hits for exposure in exposures) == 49 * 5 + 30  # the first one came before any telemetry
    assert sum(exposure.live_time_s for exposure in exposures) < 51 * 0.2 + 1e-6
