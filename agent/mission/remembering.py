"""The state for an agent that is restarted in flight: kept up to date during the flight, restored afterwards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from msgspec.structs import replace

from radron.agent.frames.kept import KeptFrame
from radron.agent.localization.ownpose import OwnPose
from radron.agent.mission.memory import Memory
from radron.agent.mission.stages import Mission
from radron.agent.navigation.navigator import Navigator
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import Wall
from radron.agent.owntime import Utc
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Stage


class Remembering:
    """The memory of one drone.

    ``memory``: the same object as long as nothing in it changes. ``copied``: the revoked drones whose keys have shown to be
    copied.
    """

    def __init__(
        self,
        mission_id: str,
        mission: Mission,
        navigator: Navigator,
        own: OwnPose,
        counters: Counter[str],
        memory: Memory | None,
        utc: Utc,
    ) -> None:
        """``memory``: from the agent that flew this drone before."""
        self._mission_id, self._mission, self._navigator = mission_id, mission, navigator
        self._own, self._counters, self._utc = own, counters, utc
        self.memory, self.copied = memory, set(memory.copied if memory is not None else ())
        # As of ``Navigator.epochs`` and ``parted``, when frames and others were last stored.
        self._stored_urgent: tuple[dict[str, int], dict[str, Wall | None]] = {}, {}
        # Until telemetry shows whether that flight continues.
        self._former = memory if memory is not None and memory.flies else None

    def stage(self, now_ns: int) -> Stage:
        """Return the stage to publish: the stored one until telemetry shows whether that flight continues. If it were a stage on
        the ground, the other drones would not account for a vehicle in its failsafe.
        """
        if self._former is not None and self._former.is_recent(self._mission_id, now_ns):
            return self._former.stage
        return self._mission.stage

    def rejoin(self, vehicle: VehicleState) -> int:
        """Continue the stored flight if telemetry shows that the vehicle still flies; on the ground the flight is void.

        Returns the stamp with which the swarm's mission began; 0 if not known, or nothing is continued.
        """
        memory = self._former
        fits = memory.fits(self._mission_id, vehicle) if memory is not None else None
        if memory is None or fits is None:
            return 0
        self._former = None
        if not fits:
            self._counters["memory_void"] += 1
            return 0
        self._counters["rejoined"] += 1
        self._mission.rejoin(memory, vehicle, vehicle.stamp_ns)
        self._navigator.resume(memory.home)
        self._navigator.remember(self._plausible(memory.frames), memory.others)
        if memory.response is not None:
            self._navigator.response.remember(memory.response)
        return memory.started_ns

    def note(self, now_ns: int, peers: Peers) -> None:
        """Keep the memory up to date, once it is known whether the former flight continues.

        Response, frames and the others' messages change all the time. They are stored along with the rest only, or with data that
        cannot be recovered later: a frame by continuity after a jump, and the last contact with another drone.
        """
        if self._former is not None:
            return
        memory, known = self._present(now_ns), self.memory and replace(self.memory, response=None, frames={}, others={})
        urgent = self._navigator.epochs, self._navigator.parted
        if memory == known and urgent == self._stored_urgent:
            return
        self._stored_urgent = urgent
        if memory is not None and memory.flies:
            frames, others = self._plausible(self._navigator.frames), self._navigator.last_news(peers, now_ns)
            memory = replace(memory, response=self._navigator.response.found, frames=frames, others=others)
        self.memory = memory

    def _present(self, now_ns: int) -> Memory | None:
        """The memory without response, frames and others; None where there is nothing to remember."""
        memory = self._mission.memory(self._mission_id, self._navigator.home.kept, now_ns, self._own.epoch_offset)
        copied = tuple(sorted(self.copied))
        if memory is not None:
            epoch = self._own.vehicle.epoch if self._own.vehicle is not None else 0
            return replace(memory, epoch=epoch, copied=copied, ahead_ns=self._utc.ahead_ns)
        if not copied:
            return None
        stage = self._mission.stage
        return Memory(mission=self._mission_id, stamp_ns=0, started_ns=0, stage=stage, resume=stage, copied=copied)

    def _plausible(self, frames: Mapping[str, KeptFrame]) -> dict[str, KeptFrame]:
        """Return the plausible frames; the others are counted and dropped."""
        found = {name: kept for name, kept in frames.items() if kept.is_plausible}
        if len(found) < len(frames):
            self._counters["kept_frame_implausible"] += len(frames) - len(found)
        return found
