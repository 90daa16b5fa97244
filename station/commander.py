"""Commands and missions that the operator sends to the swarm from the web page.

The commands ``radron-agent command`` and ``upload`` work alike; here the station sends over its own link.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from radron.agent.config.mission import MissionConfig
from radron.agent.operator import missionupload
from radron.agent.operator.groundcontrol import CommandError, Order, carry_out, station_name
from radron.agent.operator.missionupload import UploadOrder
from radron.agent.operator.statuses import Statuses
from radron.protocol.elapsed import elapsed_s
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Identity, Role
from radron.protocol.mesh.session import Mesh
from radron.protocol.messages import Action
from radron.protocol.trust import trust_of

Tell = Callable[[str, bool, str], None]  # a line, whether it is a refusal or failure, and ``command`` or ``upload``


def may_command(identity: Identity | None) -> bool:
    """Return whether this station may command the swarm, by the role in its certificate.

    Without certificates every station may.
    """
    return identity is None or identity.own.role is Role.OPERATOR


class Commander:
    """Sends the operator's commands and uploaded missions to the drones, and repeats them until the drones have answered.

    A newer command to a drone replaces earlier commands to this drone. Only one mission is uploaded at a time. ``name``: name of
    this station in its orders.
    """

    def __init__(self, mesh: Mesh, swarm: str, identity: Identity | None, tell: Tell) -> None:
        """``mesh``: connection to the swarm. ``tell``: called with each line of text about a command or an upload."""
        self.name = station_name(trust_of(identity))
        self._mesh, self._swarm, self._identity, self._tell = mesh, swarm, identity, tell
        self._statuses = Statuses(identity)
        self._under_way: dict[asyncio.Task[None], set[str]] = {}  # with the drones that have got a later command
        self._upload: asyncio.Task[None] | None = None

    def receive(self, key: str, payload: bytes) -> None:
        """Take a message from the network; the drones' statuses contain the answers to commands."""
        self._statuses.receive(key, payload)

    def give(self, action: Action, drones: tuple[str, ...], age_s: float) -> str:
        """Begin to carry out an operator's command.

        A start goes to all the named drones or to none; any other command goes at once to the drones in contact. Earlier commands
        to these drones are given up, as their repetitions would come after the new command.

        Args:
            action: the command.
            drones: the addressed drones; empty: all drones in contact.
            age_s: upper limit of the time since the operator gave the command, in seconds.

        Returns:
            Why the command is refused; empty if it is carried out.
        """
        heard = self._statuses.heard()
        lost = ", ".join(name for name in drones if name not in heard)
        addressed = tuple(name for name in drones or heard if name in heard)
        if not addressed or (lost and action is Action.START):
            return f"not sent: {lost} not heard" if lost else "not sent: no drone is heard"
        if lost:
            self._tell(f"{action}: not sent to {lost}: not heard", True, "command")
        order = Order(action, self._swarm, (), addressed, given_s=elapsed_s() - age_s)
        for withdrawn in self._under_way.values():
            withdrawn.update(addressed)
        later = set[str]()
        self._begin(self._carry_out(order, later), later)
        return ""

    def upload(self, mission: MissionConfig, taken: Callable[[MissionConfig], None], age_s: float) -> str:
        """Begin to upload a mission to all its drones.

        ``taken``: called with the mission at the end, if any drone has adopted the mission by then. ``age_s``: upper limit of the
        time since the operator gave the order, in seconds.

        Returns:
            Why the upload is refused; empty if it has begun.
        """
        if self._upload is not None and not self._upload.done():
            return "refused: another mission is being uploaded"
        heard = self._statuses.heard()
        if lost := ", ".join(drone.id for drone in mission.drones if drone.id not in heard):
            return f"not sent: {lost} not heard"
        order = UploadOrder(mission, (), given_s=elapsed_s() - age_s)
        self._upload = self._begin(self._upload_to_all(order, taken), set())
        return ""

    async def close(self) -> None:
        """Stop all commands and uploads that are not finished."""
        for task in self._under_way:
            task.cancel()
        await asyncio.gather(*self._under_way, return_exceptions=True)

    def _begin(self, work: Coroutine[Any, Any, None], withdrawn: set[str]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._under_way[task] = withdrawn
        task.add_done_callback(self._under_way.pop)
        return task

    async def _carry_out(self, order: Order, withdrawn: set[str]) -> None:
        def say(line: str) -> None:
            self._tell(line, False, "command")

        try:
            await carry_out(order, self._mesh, self._identity, self._statuses, say, withdrawn)
        except (CommandError, ProtocolError) as error:
            self._tell(str(error), True, "command")

    async def _upload_to_all(self, order: UploadOrder, taken: Callable[[MissionConfig], None]) -> None:
        try:
            found = await missionupload.carry_out(
                order, self._mesh, self._identity, self._statuses, lambda line: self._tell(line, False, "upload")
            )
        except (CommandError, ProtocolError) as error:
            self._tell(str(error), True, "upload")
            return
        without = [drone for drone, reason in found.items() if reason]
        if without:
            self._tell(f"not taken by {', '.join(without)}: no start is possible until all have the same mission", True, "upload")
        else:
            self._tell(f"all drones have the mission {order.mission.mission_id}", False, "upload")
        if len(without) < len(found):
            taken(order.mission)
