"""The exchange of missing entries in lockstep: queries and answers."""

import numpy as np

from radron.sim.faults.network import FaultyRadio
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.recovery import Recovery
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.tellers import Tellers
from radron.sim.world.radio import RadioTruth

SECOND = 1_000_000_000
NAMES = ("d1", "d2", "d3")
TICK_NS = SECOND // 20


class Log:
    """A pilot with only a log: numbers in the place of entries, three to an answer."""

    def __init__(self, numbers=(), publisher="d2"):
        self.held = set(numbers)
        self.asked = 0
        self.publisher = publisher

    def log_summary(self):
        return bytes(sorted(self.held))

    def log_answer(self, request):
        self.asked += 1
        return [(f"radron/2/s/{self.publisher}/cone", bytes([number])) for number in sorted(self.held - set(request))[:3]]


class Pair:
    """Two drones or three that publish their poses, and exchange missing entries."""

    def __init__(self, *logs, tellers=Tellers, dead=None):
        """``dead``: a drone that publishes nothing."""
        self.logs, self.dead = logs, dead
        truth = RadioTruth(delay_s=0.02, jitter_s=0.0, loss=0.0)
        schedule = Schedule((), NAMES, 1)
        self.radio = FaultyRadio(truth, NAMES, np.random.default_rng(1), schedule, 0.05)
        self.recovery = Recovery("s", NAMES, self.radio, tellers((), schedule, NAMES, (), Poisoners(schedule, [])))
        self.now_ns = SECOND

    def go(self, seconds, poses=True):
        for _ in range(round(20 * seconds)):
            self.now_ns += TICK_NS
            for drone, log in enumerate(self.logs):
                for key, payload in self.radio.receive(drone, self.now_ns):
                    if not self.recovery.hear(drone, key, payload, log, self.now_ns) and key.endswith("/cone"):
                        log.held |= set(payload)
                if poses and drone != self.dead:
                    self.radio.send(drone, f"radron/2/s/{NAMES[drone]}/pose", b"", self.now_ns)
                self.recovery.ask(drone, log, self.now_ns)


def test_a_log_that_is_empty_is_filled_answer_by_answer():
    pair = Pair(Log(), Log(range(20)))
    pair.go(5.0)
    assert pair.logs[0].held == set(range(20))
    assert 7 <= pair.logs[1].asked <= 10


def test_nobody_asks_those_whose_entries_others_pass_on():
    """Own entries from before a restart, and entries of a drone that is dead."""
    for publisher in ("d1", "d3"):
        swarm = Pair(Log(), Log(range(20), publisher), Log(range(20), publisher), dead=2)
        swarm.go(4.0)
        assert swarm.logs[0].held == set(range(20))
        assert swarm.logs[2].asked == 0


def test_equal_logs_ask_every_two_seconds():
    pair = Pair(Log(range(9)), Log(range(9)))
    pair.go(20.0)
    assert [log.asked for log in pair.logs] == [10, 10]


def test_nobody_asks_a_peer_that_is_not_heard():
    pair = Pair(Log(), Log(range(9)))
    pair.go(10.0, poses=False)
    assert [log.asked for log in pair.logs] == [0, 0]
    assert pair.logs[0].held == set()


class Storytellers(Tellers):
    """Tellers that give others another version."""

    def answer(self, drone, to, key, payload):
        return bytes([payload[0] + 100])


def test_a_liar_keeps_to_its_story():
    pair = Pair(Log(), Log(range(3)), tellers=Storytellers)
    pair.go(3.0)
    assert pair.logs[0].held >= {100, 101, 102}
    assert not pair.logs[0].held & {0, 1, 2}
