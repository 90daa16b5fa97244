"""Frames of drones with exactly known localisation after a jump, carried on by the drones' own motion.

The mission gives the frame of the first epoch. The drone publishes the pose of each later frame in the first one, with every
exposure of that epoch (``radron.agent.localization.knownframe``). These frames are therefore a function of the log, too.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import LAUNCH_EPOCH, FrameGraph
from radron.agent.frames.transform import Transform
from radron.protocol.entries import CarriedFrame, Entry, EntryId, Exposure


def told(frame: Transform) -> CarriedFrame:
    """Convert the transform of a local frame into the drone's frame at launch to the form used in messages."""
    return CarriedFrame(frame.translation, frame.yaw_rad, frame.covariance_rows)


def launch_from_local(carried: CarriedFrame) -> Transform:
    """Convert a published frame back to a transform into the drone's frame at launch."""
    covariance = None if carried.covariance is None else np.array(carried.covariance).reshape(4, 4)
    return Transform(carried.yaw_rad, carried.translation_m, covariance)


class CarriedFrames:
    """Adds frames to the graph that drones with exact localisation publish after a jump of their localisation.

    The drone computes such a frame from its own motion. If a drone publishes several frames of one epoch (period without a jump),
    the frame of the first entry counts, for any order of arrival. A drone with two frames in one epoch is faulty anyway.
    """

    def __init__(self, mission: MissionConfig, graph: FrameGraph) -> None:
        self._graph = graph
        self._exact = frozenset(drone.id for drone in mission.drones if drone.is_exact)
        self._told: dict[tuple[str, int], dict[EntryId, CarriedFrame]] = {}
        self._first: dict[tuple[str, int], EntryId] = {}
        self._epochs: dict[EntryId, int] = {}
        self._earliest_ns = 0

    def receive(self, entry: Entry) -> None:
        """Take an entry of the observation log, which may contain such a frame; each entry comes once."""
        if entry.drone not in self._exact or entry.stamp_ns < self._earliest_ns:
            return
        if isinstance(entry, Exposure) and entry.epoch != LAUNCH_EPOCH and entry.carried is not None:
            self._epochs[entry.entry_id] = entry.epoch
            self._add((entry.drone, entry.epoch), entry.entry_id, entry.carried)

    def drop_before(self, stamp_ns: int) -> None:
        """Forget frames published before a time stamp (ns), and ignore log entries from before it that arrive later.

        In an earlier flight, an epoch of equal number was another frame.
        """
        self._earliest_ns = stamp_ns
        self.forget([identity for identity in self._epochs if identity.stamp_ns < stamp_ns])

    def forget(self, identities: Iterable[EntryId]) -> None:
        """Remove log entries that no longer count, together with the frames published in them."""
        changed: set[tuple[str, int]] = set()
        for identity in identities:
            epoch = self._epochs.pop(identity, None)
            if epoch is not None:
                key = identity.drone, epoch
                del self._told[key][identity]
                changed |= {key} if identity == self._first[key] else set()
        for key in sorted(changed):
            self._place(key, min(self._told[key], default=None))

    def _add(self, key: tuple[str, int], identity: EntryId, carried: CarriedFrame) -> None:
        held, first = self._told.setdefault(key, {}), self._first.get(key)
        held[identity] = held[first] if first is not None and held[first] == carried else carried  # equal frames share one object
        if first is None or identity < first:
            self._place(key, identity)

    def _place(self, key: tuple[str, int], first: EntryId | None) -> None:
        drone, epoch = key
        if first is None:
            del self._first[key]
            self._graph.replace_from(drone, epoch, 0, [])
            return
        self._first[key] = first
        carried, launch = self._told[key][first], self._graph.mission_from_local(drone, LAUNCH_EPOCH)
        assert launch is not None  # known from the mission
        self._graph.place(drone, epoch, launch @ launch_from_local(carried))
