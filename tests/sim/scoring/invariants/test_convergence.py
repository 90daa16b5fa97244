"""Whether the able drones agree after the heal: true and false alarms."""

from types import SimpleNamespace

import numpy as np

from radron.sim.scoring.invariants.convergence import Converged
from support.flights import moments

TICK_S = 0.05
REFUSAL = {"kind": "refusal", "at_s": 9.0, "target": "d3"}


def judged(pilots_at, *faults, seconds=30.0):
    """Violations from the heal on, with the drones, and whether they ever agreed. ``pilots_at``: the pilots at a time."""
    invariant = Converged(moments.setting(*faults))
    times_s = moments.HEAL_S + TICK_S * np.arange(round(seconds / TICK_S))
    seen = [moments.moment(float(t), pilots=pilots_at(float(t))) for t in times_s]
    return [(violation.drones, violation.text) for one in seen for violation in invariant.look(one)], invariant.ever


def holding(*logs):
    return lambda _: [moments.pilot(entries=numbers) for numbers in logs]


def test_an_entry_that_one_drone_never_gets() -> None:
    told, ever = judged(holding((1, 2), (1, 2), (1,)))
    assert told == [(("d1", "d2", "d3"), "1 entries that some of them hold and others lack for 20 s")]
    assert not ever
    assert judged(holding((1, 2), (1, 2), (1,)), seconds=19.0) == ([], False)
    assert judged(holding((1, 2), (1, 2), (1, 2))) == ([], True)


def test_only_the_able_drones_have_to_agree() -> None:
    assert judged(holding((1, 2), (1, 2), (1,)), REFUSAL) == ([], True)
    assert judged(holding((1, 2), (1, 2), (1,)), REFUSAL | {"for_s": 9.0})[1] is False


def test_of_two_versions_of_one_entry_each_drone_keeps_the_first() -> None:
    told, ever = judged(holding((1, "2a"), (1, "2b"), (1, "2a")))
    assert [text for _, text in told] == ["2 entries that some of them hold and others lack for 20 s"]
    assert not ever


def test_logs_that_are_never_equal_as_new_entries_come_all_the_time() -> None:
    """140 entries a second: some drones have the newest ones, others only entries older than half a second."""

    def measuring(time_s):
        newest = round(140 * (time_s - 40.0))
        return [moments.pilot(entries=range(newest - late)) for late in (0, 7, 70)]

    assert judged(measuring, seconds=25.0) == ([], True)


def test_what_does_not_count_any_more_is_held_by_none_in_the_end() -> None:
    assert judged(lambda t: [moments.pilot(entries=(1, 2) if k == 0 and t < 65.0 else (1,)) for k in range(3)]) == ([], True)


def test_an_agent_that_does_not_work_off_its_log() -> None:
    told, ever = judged(lambda t: [moments.pilot(backlog_s=t - 49.0 if k == 1 else 0.0) for k in range(3)])
    assert told == [(("d2",), "its hypothesis lacks what its log has held for 20 s")]
    assert ever  # its log is that of the others


def test_entries_that_come_late_all_the_time_may_wait_for_their_batch() -> None:
    assert judged(lambda t: [moments.pilot(pending=True, backlog_s=1.0 + t % 4.0) for _ in range(3)])[0] == []
    assert (
        judged(lambda t: [moments.pilot(backlog_s=11.0 if t < 60.0 else 0.0) for _ in range(3)])[0] == []
    )  # a clock that was set


def at_times(*stamps_s):
    """Drones with hypotheses of these times, in seconds before now; None: without one."""
    told = [None if one is None else moments.hypothesis(stamp_ns=-round(one * 1e9)) for one in stamps_s]
    return lambda _: [moments.pilot(believed=one) for one in told]


def test_hypotheses_of_different_times() -> None:
    different = [(("d1", "d2", "d3"), "their hypotheses are of different times for 20 s")]
    assert judged(at_times(0.0, 0.7, 0.1))[0] == []  # the second one is slow
    assert judged(at_times(0.0, 7.8, 0.1))[0] == different
    assert judged(at_times(0.0, None, 0.1))[0] == different
    assert judged(at_times(None, None, None))[0] == []


class Agent:
    """An agent with a list of numbers as its log; its hypothesis follows from their sum, at one time.

    ``short``: its answers lack the last entry. ``ordered``: its hypothesis follows from the order of arrival, too.
    """

    def __init__(self, entries, ordered=False, short=False):
        self.held, self.ordered, self.short = list(entries), ordered, short
        self.pending, self.backlog_s, self.stage, self.now_ns = False, 0.0, "landed", 0
        self.frames = SimpleNamespace(advance=lambda _: None)
        self.fusion = SimpleNamespace(log=moments.Log(entries), begin_ns=lambda now_ns: now_ns, advance=self.advance)

    @property
    def digest(self):
        return str(sorted(self.held))

    @property
    def hypothesis(self):
        return moments.hypothesis(x=self.held[-1] if self.ordered else sum(self.held), stamp_ns=self.now_ns)

    def observe_clock(self, ahead_ns, now_ns):
        assert ahead_ns == 0  # all clocks are right at the end

    def advance(self, now_ns):
        self.now_ns = max(self.now_ns, now_ns)

    def log_summary(self):
        return tuple(self.held)

    def log_answer(self, summary):
        missing = [number for number in self.held if number not in summary]
        return [("key", number) for number in (missing[:-1] if self.short else missing)]

    def receive(self, key, payload, now_ns):
        self.held.append(payload)


def at_end(*pilots):
    invariant = Converged(moments.setting())
    invariant.look(moments.moment(moments.HEAL_S, pilots=pilots))
    return [violation.text for violation in invariant.finish(moments.moment(90.0, pilots=pilots))]


def test_at_the_end_all_that_was_measured_leads_to_one_log_and_one_hypothesis() -> None:
    said = "2 hypotheses at the end, with all entries exchanged"
    assert at_end(Agent((1, 2, 3)), Agent((2, 3)), Agent((3, 4))) == []
    assert at_end(Agent((1, 2), short=True), Agent((1,)), Agent((1,))) == [f"2 digests and {said}"]
    assert at_end(Agent((1, 2), ordered=True), Agent((1,)), Agent((1,))) == [f"1 digests and {said}"]
