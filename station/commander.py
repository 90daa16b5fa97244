"""The page's commands and missions to the swarm: as ``radron-agent command`` and ``upload``, over the station's own link."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any

from agent.config.mission import MissionConfig
from agent.operator import missionupload
from agent.operator.groundcontrol import FRESH_S, CommandError, Order, Statuses, carry_out, station_name
from agent.operator.missionupload import UploadOrder
from protocol.errors import ProtocolError
from protocol.identity import Identity, Role
from protocol.mesh.session import Mesh
from protocol.messages import Action
from protocol.trust import trust_of

MOST_AT_ONCE = 8  # commands under way: a hold must not wait for a start
Tell = Callable[[str, bool, str], None]  # a line, whether it is a refusal or failure, and ``command`` or ``upload``


def may_command(identity: Identity | None) -> bool:
    """Whether this station's certificate lets it command; in a swarm without certificates everybody may."""
    return identity is None or identity.own.role is Role.OPERATOR


class Commander:
    """Carries out several commands at a time, each with the numbers that it began with; one upload at a time.

    ``name``: under which it orders.
    """

    def __init__(self, mesh: Mesh, swarm: str, identity: Identity | None, tell: Tell) -> None:
        """``tell``: called with each line about a command or an upload."""
        self.name = station_name(trust_of(identity))
        self._mesh, self._swarm, self._identity, self._tell = mesh, swarm, identity, tell
        self._heard = Statuses(identity)
        self._newest: dict[str, tuple[float, bytes]] = {}  # by key: statuses, and when they came
        self._under_way: dict[asyncio.Task[None], Statuses] = {}
        self._upload: asyncio.Task[None] | None = None

    def receive(self, key: str, payload: bytes) -> None:
        """Take a message from the mesh."""
        if not self._heard.receive(key, payload):
            return
        self._newest[key] = time.monotonic(), payload
        for statuses in self._under_way.values():
            statuses.receive(key, payload)

    def give(self, action: Action, drones: tuple[str, ...]) -> None:
        """Begin to carry out a command; ``drones`` empty: those that are heard."""
        statuses = self._statuses()
        order = Order(action, self._swarm, (), drones or tuple(statuses.heard()))
        if not order.drones:
            self._tell(f"{action}: no drone is heard", True, "command")
        elif len(self._under_way) >= MOST_AT_ONCE:
            self._tell(f"{action}: too many commands at once", True, "command")
        else:
            self._begin(self._carry_out(order, statuses), statuses)

    def upload(self, mission: MissionConfig, taken: Callable[[MissionConfig], None]) -> None:
        """Begin to upload a mission to all its drones; ``taken`` is called with it at the end, if any of them has it then."""
        if self._upload is not None and not self._upload.done():
            self._tell("refused: another mission is being uploaded", True, "upload")
        else:
            statuses = self._statuses()
            self._upload = self._begin(self._upload_to_all(mission, statuses, taken), statuses)

    async def close(self) -> None:
        """Give up what is under way."""
        for task in self._under_way:
            task.cancel()
        await asyncio.gather(*self._under_way, return_exceptions=True)

    def _statuses(self) -> Statuses:
        """What is known of the drones now."""
        statuses = Statuses(self._identity)
        for key, (came_s, payload) in self._newest.items():
            if time.monotonic() - came_s < FRESH_S:
                statuses.receive(key, payload)
        return statuses

    def _begin(self, work: Coroutine[Any, Any, None], statuses: Statuses) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._under_way[task] = statuses
        task.add_done_callback(self._under_way.pop)
        return task

    async def _carry_out(self, order: Order, statuses: Statuses) -> None:
        try:
            await carry_out(order, self._mesh, self._identity, statuses, lambda line: self._tell(line, False, "command"))
        except (CommandError, ProtocolError) as error:
            self._tell(str(error), True, "command")

    async def _upload_to_all(self, mission: MissionConfig, statuses: Statuses, taken: Callable[[MissionConfig], None]) -> None:
        order, identity = UploadOrder(mission, ()), self._identity
        try:
            found = await missionupload.carry_out(
                order, self._mesh, identity, statuses, lambda line: self._tell(line, False, "upload")
            )
        except (CommandError, ProtocolError) as error:
            self._tell(str(error), True, "upload")
            return
        without = [drone for drone, reason in found.items() if reason]
        if without:
            self._tell(f"not taken by {', '.join(without)}: no start is possible until all have the same mission", True, "upload")
        else:
            self._tell(f"all drones have the mission {mission.mission_id}", False, "upload")
        if len(without) < len(found):
            taken(mission)
