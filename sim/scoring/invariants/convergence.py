"""Agreement of the drones' logs and source estimates after faults of the network have ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations

from radron.agent.pilot import Pilot
from radron.protocol.stages import SEARCHING
from radron.sim.scoring.invariants.able import Able
from radron.sim.scoring.invariants.base import Breach, Invariant, Setting
from radron.sim.scoring.moment import EPOCH_NS, Moment

AGREE_S = 20.0  # a log query every few seconds, and 5 s of backlog
MAX_STEP_AGE_NS = 1_000_000_000  # limit of the age of a slow agent's last step
_LOOK_TICKS = 100
_ROUNDS, _CALLS = 20, 5000  # of exchange, and of work: far more than any flight takes
_LATER_NS = 1_000_000_000


class Converged(Invariant[Moment]):
    """Requires that the drones agree after the network has healed, until the first of them returns.

    Only drones that are able to finish the mission are judged:

    - an entry in one log is in all logs 20 s later, or in none (if it does not count any more);
    - entries held by a log for 20 s are in the frames and the source estimate of its drone;
    - at least every 20 s their estimates are of times at most 1 s apart;
    - at the end, with all entries exchanged, they have one digest and one estimate, to the bit.

    During measurement their logs are hardly ever equal at one moment: six drones add over a hundred entries a second, each of
    which takes a tick or two to arrive, and longer at a slow agent. Each entry is therefore judged by itself, by its bytes, every
    5 s. Nor is there always a moment at which one log is completely processed: with a steady flow of late entries, some always
    wait. Estimates of equal logs are compared at each tick (``agreement``).
    """

    name = "convergence"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._able = Able(setting)
        self._ticks = 0
        self._looked_s: float | None = None  # first
        self._disputed_s: dict[bytes, float] = {}  # entries held by some and missing at others, with the begin
        self._worked_s = [setting.heal_s] * len(setting.names)  # earlier receptions are in the hypothesis
        self._told_s = setting.heal_s  # last time at which their hypotheses were of one time
        self.ever = False  # since the heal the entries held then have been agreed on, or there are not two drones to disagree

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that have not agreed for too long."""
        able = self._able.see(moment)
        if moment.time_s < self.setting.heal_s or self._over(moment, able):
            return
        pilots = [moment.pilots[drone] for drone in able]
        for drone, pilot in zip(able, pilots, strict=True):
            if pilot is not None:
                self._worked_s[drone] = max(self._worked_s[drone], moment.time_s - pilot.backlog_s)
            if moment.time_s - self._worked_s[drone] > AGREE_S:
                yield Breach((drone,), f"its hypothesis lacks what its log has held for {AGREE_S:g} s")
        if _are_of_one_time(pilots):
            self._told_s = moment.time_s
        elif moment.time_s - self._told_s > AGREE_S:
            yield Breach(able, f"their hypotheses are of different times for {AGREE_S:g} s")
        if self._ticks % _LOOK_TICKS == 0:
            self._look_at_logs(moment.time_s, pilots)
        self._ticks += 1
        late = sum(moment.time_s - since_s > AGREE_S for since_s in self._disputed_s.values())
        if late:
            yield Breach(able, f"{late} entries that some of them hold and others lack for {AGREE_S:g} s")

    def _look_at_logs(self, time_s: float, pilots: Sequence[Pilot | None]) -> None:
        """Note the entries held by some of the drones only. A dead agent holds nothing."""
        held: list[set[bytes]] = [set() if pilot is None else set(pilot.fusion.log.payloads()) for pilot in pilots]
        common = set[bytes].intersection(*held) if held else set()
        disputed = set[bytes]().union(*held) - common
        self._disputed_s = {payload: self._disputed_s.get(payload, time_s) for payload in disputed}
        if self._looked_s is None:
            self._looked_s = time_s
        self.ever = self.ever or all(since_s > self._looked_s for since_s in self._disputed_s.values())

    def _over(self, moment: Moment, able: tuple[int, ...]) -> bool:
        """Return whether a drone has stopped searching, after they have agreed."""
        return self.ever and any((pilot := moment.pilots[k]) is None or pilot.stage not in SEARCHING for k in able)

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Exchange all log entries, and yield the drones whose logs or source estimates still differ.

        The agents cannot be used afterwards.
        """
        able = tuple(drone for drone in self._able.see(moment) if moment.pilots[drone] is not None)
        pilots = [pilot for drone in able if (pilot := moment.pilots[drone]) is not None]
        if len(pilots) < 2:
            return
        now_ns = EPOCH_NS + round(moment.time_s * 1e9)
        for pilot in pilots:  # after a wrong clock an agent may take back its stamps
            pilot.observe_clock(0, now_ns)
            pilot.advance(now_ns)
        exchange(pilots, now_ns)
        work_off(pilots, now_ns)
        digests = {pilot.digest for pilot in pilots}
        told = {None if (one := pilot.hypothesis) is None else (one.stamp_ns, one.position.tobytes()) for pilot in pilots}
        behind = sum(pilot.pending for pilot in pilots)
        if len(digests) > 1 or len(told) > 1 or behind:
            text = f"{len(digests)} digests and {len(told)} hypotheses at the end, with all entries exchanged"
            yield Breach(able, text + (f"; {behind} have not worked off their logs" if behind else ""))


def exchange(pilots: Sequence[Pilot], now_ns: int) -> None:
    """Pass log entries between agents until no log lacks an entry that another log contains. now_ns: the true time."""
    for _ in range(_ROUNDS):
        passed = 0
        for asking, answering in permutations(pilots, 2):
            for key, payload in answering.log_answer(asking.log_summary()):
                asking.receive(key, payload, now_ns)
                passed += 1
        if not passed:
            return


def work_off(pilots: Sequence[Pilot], now_ns: int) -> None:
    """Let all agents compute their source estimates for one common time, a second later than any present estimate.

    now_ns: the true time.
    """
    stamps_ns = [now_ns, *(pilot.hypothesis.stamp_ns for pilot in pilots if pilot.hypothesis is not None)]
    for pilot in pilots:
        for _ in range(_CALLS):
            pilot.advance(now_ns)
            if not pilot.pending:
                break
        common_ns = max(stamps_ns) + _LATER_NS  # a clock may have been ahead
        for _ in range(_CALLS):
            pilot.frames.advance(pilot.fusion.begin_ns(common_ns))
            pilot.fusion.advance(common_ns)
            if not pilot.pending:
                break


def _are_of_one_time(pilots: Sequence[Pilot | None]) -> bool:
    """Return whether all have hypotheses, of about one time, or none has; a dead agent has none."""
    told = [None if pilot is None or (one := pilot.hypothesis) is None else one.stamp_ns for pilot in pilots]
    stamps_ns = [stamp_ns for stamp_ns in told if stamp_ns is not None]
    if any(pilot is None for pilot in pilots):
        return False
    return not stamps_ns or (len(stamps_ns) == len(told) and max(stamps_ns) - min(stamps_ns) <= MAX_STEP_AGE_NS)
