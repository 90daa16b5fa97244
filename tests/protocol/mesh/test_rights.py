"""Rights of a member by its certificate to publish, declare and ask: each attack with a twin that shows the allowed case."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

from radron.protocol.identity import Role, load_identity
from radron.protocol.keys import ROOT, command_key, drone_key, log_query_key
from radron.protocol.messages import DRONE_KINDS
from radron.protocol.units import STATION
from support.mesh.encrypted import QUIET_S, endpoint, heard, joined, swarm
from support.mesh.meshes import SWARM, until


def test_a_drone_publishes_under_its_own_name_only(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, d3 = await swarm(folder, stack, "d1", "d2", "d3")
            await heard(lambda: d2.publish("pose", b"first"), d1, d3)
            for kind in DRONE_KINDS:
                d2.mesh.publish(drone_key(SWARM, "d3", kind), b"forged")
                d2.publish(kind, b"own")
            for one in (d1, d3):
                await until(lambda one=one: [payload for _, payload in one.messages].count(b"own") == len(DRONE_KINDS))  # type: ignore[misc]
                await asyncio.sleep(0.2)
                assert {payload for _, payload in one.messages} == {b"first", b"own"}
                assert all("/d2/" in key for key, _ in one.messages)

    asyncio.run(course())


def test_a_drone_declares_only_itself_alive(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2 = await swarm(folder, stack, "d1", "d2")
            token = d2.mesh._session.liveliness().declare_token(drone_key(SWARM, "d3", "alive"))
            await asyncio.sleep(QUIET_S)
            assert d1.mesh.alive == {"d2"}
            token.undeclare()
            await stack.enter_async_context(joined(load_identity(folder / "d3"), connect=(d1.listen,)))
            await until(lambda: d1.mesh.alive == {"d2", "d3"})

    asyncio.run(course())


@pytest.mark.parametrize("role", [Role.OPERATOR, Role.OBSERVER])
def test_who_is_no_drone_publishes_nothing_as_one_but_hears_and_asks(folder: Path, role: Role) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, ground = await swarm(folder, stack, "d1", "d2", str(role))
            await heard(lambda: ground.mesh.publish(command_key(SWARM, str(role)), b"first"), d1)
            await heard(lambda: d2.publish("pose", b"first"), d1, ground)
            ground.mesh.publish(drone_key(SWARM, "d2", "pose"), b"forged")
            ground.mesh.publish(drone_key(SWARM, str(role), "pose"), b"forged")
            ground.mesh.publish(command_key(SWARM, str(role)), b"command")
            d2.publish("pose", b"own")
            await until(lambda: {b"own", b"command"} <= {payload for _, payload in d1.messages})
            await until(lambda: ground.got(drone_key(SWARM, "d2", "pose"))[-1] == b"own")
            assert {payload for _, payload in d1.messages} == {b"first", b"own", b"command"}
            assert await ground.mesh.ask("d1", b"") == 1
            await until(lambda: ground.got(drone_key(SWARM, "d2", "cone")))

    asyncio.run(course())


def test_entries_reach_who_joins_late_and_who_asks(folder: Path) -> None:
    """The channel of the advanced publishers and the log query work under access control."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2 = await swarm(folder, stack, "d1", "d2")
            for number in range(50):
                d2.publish("cone", b"%d" % number)
            await until(lambda: len(d1.got(drone_key(SWARM, "d2", "cone"))) == 50)
            ends = tuple(one.listen for one in (d1, d2))
            late = await stack.enter_async_context(joined(load_identity(folder / "d3"), endpoint(), ends))
            await until(lambda: len(late.got(drone_key(SWARM, "d2", "cone"))) == 50)
            assert await late.mesh.ask("d1", b"") == 1

    asyncio.run(course())


@pytest.mark.parametrize("number", [500, pytest.param(20_000, marks=pytest.mark.long)])
def test_a_drone_has_its_peers_keep_no_tokens_but_its_own_few(folder: Path, number: int) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, d3 = await swarm(folder, stack, "d1", "d2", "d3")
            session, seen = d2.mesh._session, list[str]()
            own = drone_key(SWARM, "d2", "alive")
            for where in ("radron/**", "radron/**/@adv/**"):
                watched = d1.mesh._session.liveliness().declare_subscriber(
                    where, Callback(lambda sample: seen.append(str(sample.key_expr)), indirect=False), history=True
                )
                stack.callback(watched.undeclare)
            await until(lambda: own in seen)  # the twin
            flood = [drone_key(SWARM, "d9", "alive"), f"{own}/more", "radron/10/s/d2/alive", "radron/x/s/d2/alive"]
            for kind in (f"{ROOT}/{SWARM}/d2/cone/@adv/pub/%x/7/_", f"{own}/@adv/%x", f"{own}%x", "radron/%d/s/d2/alive"):
                flood += [kind % (10 + count) for count in range(number // 4)]
            tokens = await asyncio.to_thread(lambda: [session.liveliness().declare_token(key) for key in flood])
            last = session.liveliness().declare_token("radron/9/s/d2/alive")  # of another version, which must be seen
            await until(lambda: "radron/9/s/d2/alive" in seen, 60.0)
            assert not set(seen) & set(flood)
            assert d1.mesh.alive == {"d2", "d3"}
            d3.publish("pose", b"still heard")
            await until(lambda: d1.got(drone_key(SWARM, "d3", "pose")))
            for token in (*tokens, last):
                token.undeclare()

    asyncio.run(course())


def test_a_drone_answers_for_its_own_log_only(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            _, d2, d3 = await swarm(folder, stack, "d1", "d2", "d3")
            own, other = (drone_key(SWARM, name, "log") for name in ("d2", "d1"))
            forging = [
                d2.mesh._session.declare_queryable(key, lambda query: query.reply(own, b"forged"))
                for key in (other, f"{ROOT}/**")
            ]
            assert await d3.mesh.ask("d1", b"") == 1  # answered by d1 alone, the owner of the log
            assert await d3.mesh.ask("d2", b"") >= 1  # the twin: its own
            for declared in forging:
                declared.undeclare()

    asyncio.run(course())


def test_the_log_is_queried_under_the_own_name_and_caches_by_drones_only(folder: Path) -> None:
    """Each drone has its own budget, and operators draw no more than theirs."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, observer = await swarm(folder, stack, "d1", "d2", "observer")
            await heard(lambda: d1.publish("cone", b"x"), d2, observer)
            cache = f"{ROOT}/{SWARM}/d1/cone/@adv/**"
            ways = {STATION: log_query_key(SWARM, "d1", STATION), "d2": log_query_key(SWARM, "d1", "d2"), "cache": cache}
            got = {}
            for one in (d2, observer):
                for way, key in ways.items():
                    await asyncio.sleep(QUIET_S)  # earlier ones are dropped
                    got[one.drone, way] = await asyncio.to_thread(_replies, one.mesh._session, key)
            assert {asked for asked, replies in got.items() if replies} == {
                ("d2", STATION), ("d2", "d2"), ("d2", "cache"), (None, STATION)
            }  # fmt: skip

    asyncio.run(course())


def _replies(session: zenoh.Session, key: str) -> int:
    return len([reply for reply in session.get(key, timeout=1.0, accept_replies=zenoh.ReplyKeyExpr.ANY) if reply.ok is not None])


def test_a_message_goes_over_one_link_so_that_nobody_can_pass_on_what_another_one_never_said(folder: Path) -> None:
    async def course() -> None:
        names, listen = ("d1", "d2", "d3"), endpoint()
        async with AsyncExitStack() as stack:
            d2 = await stack.enter_async_context(joined(load_identity(folder / "d2"), listen, gossip=False))
            d1, d3 = [
                await stack.enter_async_context(joined(load_identity(folder / name), connect=(listen,), gossip=False))
                for name in ("d1", "d3")
            ]
            await until(lambda: d2.mesh.alive == {"d1", "d3"} and d1.mesh.alive == d3.mesh.alive == {"d2"})
            await heard(lambda: [one.publish("pose", b"x") for one in (d1, d2, d3)], d1, d2, d3)
            await heard(lambda: [one.publish("cone", b"x") for one in (d1, d2, d3)], d1, d2, d3)
            assert {key.split("/")[3] for key, _ in d2.messages} == {"d1", "d3"}
            assert {key.split("/")[3] for one in (d1, d3) for key, _ in one.messages} == {"d2"}
            assert set(names) == {one.drone for one in (d1, d2, d3)}

    asyncio.run(course())
