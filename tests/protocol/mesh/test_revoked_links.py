"""Members that are revoked: their links end, and everybody else's go on."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from radron.protocol.errors import MeshError
from radron.protocol.identity import load_identity
from radron.protocol.issuing import Issuer
from radron.protocol.keys import command_key, drone_key
from radron.protocol.mesh.session import MeshConfig
from support.mesh.encrypted import DRONES, endpoint, joined
from support.mesh.meshes import SWARM, linked, until


def test_a_revoked_drone_publishes_nothing_and_hears_nothing(issuer: Issuer, folder: Path) -> None:
    async def course() -> None:
        d1_own = load_identity(folder / "d1")
        revoked = replace(d1_own, revoked=replace(d1_own.revoked, names=frozenset({"d3"})))
        for others in (None, ("operator",)):
            listen = endpoint()
            async with (
                joined(revoked, listen, others=others) as d1,
                joined(load_identity(folder / "d2"), connect=(listen,)) as d2,
                joined(load_identity(folder / "d3"), connect=(listen,)) as d3,
                joined(load_identity(folder / "operator"), connect=(listen,)) as operator,
            ):
                await until(lambda d1=d1: "d2" in d1.mesh.alive)  # type: ignore[misc]
                await until(lambda operator=operator: "d1" in operator.mesh.alive)  # type: ignore[misc]
                for number in range(20):
                    for one in (d1, d2, d3):
                        one.publish("pose", b"%d" % number)
                    operator.mesh.publish(command_key(SWARM, "operator"), b"command")
                    await asyncio.sleep(0.02)
                await until(lambda d1=d1: len(d1.messages) >= 21)  # type: ignore[misc]
                assert "d3" not in d1.mesh.alive
                assert {key for key, _ in d1.messages} == {drone_key(SWARM, "d2", "pose"), command_key(SWARM, "operator")}
                # The revoked drone dials again five times a second, and each link ends at once: the amount delivered depends on
                # the machine.
                assert len(d3.got(drone_key(SWARM, "d1", "pose"))) < 10
                assert len(d2.got(drone_key(SWARM, "d1", "pose"))) > 10

    asyncio.run(course())


def test_a_session_that_is_opened_anew_keeps_the_others_and_loses_no_entry(folder: Path) -> None:
    """d3 is revoked: d1, dialled by both others, ends its links; d1's measurements meanwhile arrive at d2 all the same."""

    async def course() -> None:
        listen = endpoint()
        identities = {name: load_identity(folder / name) for name in DRONES}
        async with (
            joined(identities["d1"], listen) as d1,
            joined(identities["d2"], connect=(listen,)) as d2,
            joined(identities["d3"], connect=(listen,)) as d3,
        ):
            await linked(d1, d2)
            await linked(d1, d3)
            d3.publish("pose", b"before")
            await until(lambda: d1.got(drone_key(SWARM, "d3", "pose")))  # the twin: it is heard until then
            without = MeshConfig(listen=listen, identity=identities["d1"], drones=DRONES, revoked=frozenset({"d3"}))
            began_s = time.monotonic()
            opening = asyncio.create_task(d1.mesh.reopen(without))
            heard_s = []
            number = 0
            while time.monotonic() - began_s < 2.0:
                number += 1
                d1.publish("cone", b"%d" % number)
                for one in (d1, d2, d3):
                    one.publish("pose", b"after" if opening.done() else b"meanwhile")
                await asyncio.sleep(0.02)
                if len(d2.got(drone_key(SWARM, "d1", "pose"))) > len(heard_s):
                    heard_s += [time.monotonic()] * (len(d2.got(drone_key(SWARM, "d1", "pose"))) - len(heard_s))
            await opening
            await until(lambda: b"%d" % number in d2.got(drone_key(SWARM, "d1", "cone")))
            assert d2.got(drone_key(SWARM, "d1", "cone")) == [b"%d" % n for n in range(1, number + 1)]
            assert max(later - one for one, later in pairwise([began_s, *heard_s])) < 2.0  # redial after 0.2 to 1 s
            assert b"after" not in d1.got(drone_key(SWARM, "d3", "pose"))
            assert d1.mesh.alive == {"d2"}
            assert b"after" in d1.got(drone_key(SWARM, "d2", "pose"))

    asyncio.run(course())


def test_a_session_that_cannot_be_opened_anew_is_told_and_the_next_try_brings_what_was_kept(folder: Path) -> None:
    async def course() -> None:
        listen, taken = endpoint(), endpoint()
        own = load_identity(folder / "d1")
        async with joined(own, listen) as d1, joined(load_identity(folder / "d2"), connect=(listen,)) as d2:
            await linked(d1, d2)
            async with joined(load_identity(folder / "d3"), taken):
                with pytest.raises(MeshError, match="is another agent running on this port"):
                    await d1.mesh.reopen(MeshConfig(listen=taken, identity=own, drones=DRONES))
            assert "no other drone is reached: mesh.listen: cannot listen" in d1.mesh.problems[0]
            d1.publish("cone", b"kept")
            assert await d1.mesh.ask("d2", b"") == 0
            await d1.mesh.reopen(MeshConfig(listen=listen, identity=own, drones=DRONES))
            assert d1.mesh.problems == ()
            await until(lambda: d2.got(drone_key(SWARM, "d1", "cone")) == [b"kept"])

    asyncio.run(course())
