"""Commands and uploads of the operators to this drone: judged, and carried out or refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from msgspec import Struct

from radron.agent.localization.ownpose import OwnPose
from radron.agent.mission.executive import Executive
from radron.agent.mission.orders import Orders
from radron.agent.mission.problems import Problems
from radron.agent.mission.uploads import Ground, Uploads
from radron.agent.navigation.peers.newest import Peers
from radron.agent.owntime import Utc
from radron.protocol.codes import Code
from radron.protocol.messages import Action, AnyOrder, Command, Status, Upload
from radron.protocol.texts import CodedText

UNPLACED = CodedText(
    Code.HEADING_UNKNOWN, "its heading is not known, and it has neither seen another drone nor been seen by one yet"
)
DISPLACED = CodedText(
    Code.DISPLACED,
    "its localisation jumped before this agent was started, or while nothing was heard of the vehicle: "
    "restart autopilot and agent at its launch place",
)
PASSING = "{name} flies past so near that a takeoff would be in its way; start again in a moment"


class Verdict(Struct, frozen=True):
    """The outcome of a command. ``refused``: why it was not carried out, as the counters name it; empty if it was. ``because``:
    the mission's own words, where the command was in order and the mission could not obey it.
    """

    refused: str = ""
    because: str = ""


class Commanding:
    """Judges the commands and uploads to one drone. ``uploads``: what becomes of the latter."""

    def __init__(
        self,
        mission_id: str,
        orders: Orders,
        executive: Executive,
        problems: Problems,
        own: OwnPose,
        peers: Peers,
        counters: Counter[str],
        utc: Utc,
    ) -> None:
        """``counters``: of refused commands, by reason."""
        self._mission_id, self._orders = mission_id, orders
        self._executive, self._problems, self._own, self._peers = executive, problems, own, peers
        self._counters, self._utc = counters, utc
        self.uploads = Uploads(mission_id)

    def judge(self, order: AnyOrder, now_ns: int) -> Verdict | None:
        """Carry out a command, take an upload, or refuse it; None for one to other drones."""
        verdict = self._judged(order, now_ns)
        if verdict is not None and verdict.refused:
            self._counters[f"dropped_command_{verdict.refused}"] += 1
        return verdict

    def _judged(self, order: AnyOrder, now_ns: int) -> Verdict | None:
        refused = self._orders.refusal(order, now_ns)
        if refused is not None:
            return None if refused == "to_others" else Verdict(refused)
        because = self._take(order, now_ns) if isinstance(order, Upload) else self._obey(order, now_ns)
        if because is not None:
            if isinstance(order, Command) and order.action is Action.RESUME:  # a copy may arrive during a pilot's hold
                self._orders.use_up(order)
            return Verdict("refused", because)
        self._orders.note(order)
        return Verdict()

    def _take(self, upload: Upload, now_ns: int) -> str | None:
        return self.uploads.judge(upload, Ground(now_ns, self._executive.stage, self._own.vehicle, self._peers.statuses(now_ns)))

    def against_start(self, now_ns: int, statuses: Mapping[str, Status]) -> tuple[CodedText, ...]:
        """Return what prevents a start. ``statuses``: of the other drones, by id."""
        found = (
            UNPLACED if self._own.is_unplaced else None,
            DISPLACED if self._own.is_displaced else None,
            self.uploads.obstacle,
            *(CodedText(Code.TRAFFIC, PASSING.format(name=name), name) for name in self._executive.passing(now_ns, self._peers)),
        )
        obstacles = [text for text in found if text is not None]
        return self._problems.against_start(now_ns, self._own.vehicle, statuses, obstacles)

    def _obey(self, command: Command, now_ns: int) -> str | None:
        others = self._peers.statuses(now_ns)
        problems = self.against_start(now_ns, {name: others[name] for name in others if name in command.to})
        # That of the drones that fly it already: all ignore the same earlier measurements.
        begun_ns = self._peers.begun_ns(self._mission_id, now_ns, self._utc.of(now_ns))
        return self._executive.obey(command.action, command.stamp_ns, begun_ns, now_ns, problems)
