"""Meshes on this machine: delivery, the log query, leaving, and configurations that cannot work."""

import asyncio
import os
import socket
import time

import pytest

from radron.protocol.codec import MAX_NEWS_BYTES
from radron.protocol.errors import MeshError, ProtocolError
from radron.protocol.keys import command_key, drone_key
from radron.protocol.mesh import inbox, link, session
from radron.protocol.mesh.inbox import ENTRY_KINDS, NEWS_KINDS
from radron.protocol.mesh.recovery import recover
from radron.protocol.mesh.rights import COMMANDS_PER_S
from radron.protocol.mesh.session import Mesh, MeshConfig
from support.mesh.meshes import LEASE, LONG_LEASE_MS, endpoint, free_port, linked, member, pair, until


def test_every_kind_reaches_the_others_and_not_oneself() -> None:
    async def run() -> None:
        async with pair() as (d1, d2):
            for kind in (*ENTRY_KINDS, *NEWS_KINDS):
                d1.publish(kind, f"a {kind}".encode())
            await until(lambda: len(d2.messages) == len(ENTRY_KINDS) + len(NEWS_KINDS))
            assert set(d2.messages) == {
                (drone_key("s", "d1", kind), f"a {kind}".encode()) for kind in (*ENTRY_KINDS, *NEWS_KINDS)
            }
            assert d2.bursts >= 1
            d2.publish("pose", b"back")  # also the time in which an echo would have come
            await until(lambda: d1.messages)
            await asyncio.sleep(2 * session.PUBLISHER_HEARTBEAT_S)
            assert d1.messages == [(drone_key("s", "d2", "pose"), b"back")]

    asyncio.run(run())


def test_a_command_reaches_every_drone_that_is_seen_alive_though_the_operator_dials_one() -> None:
    async def run() -> None:
        first, second = endpoint(), endpoint()
        async with (
            member("d1", first) as d1,
            member("d2", second, (first,)) as d2,
            member("d3", endpoint(), (first, second)) as d3,
        ):
            await linked(d1, d2, d3)
            async with member(None, connect=(first,)) as operator:
                await until(lambda: operator.mesh.alive == {"d1", "d2", "d3"})
                everybody = (d1, d2, d3, operator)  # a sender of orders also gets its own orders
                for i in range(5):
                    operator.mesh.publish(command_key("s", "gcs"), b"%d" % i)
                    await until(lambda i=i: all(len(one.messages) > i for one in everybody))  # type: ignore[misc]
                    await asyncio.sleep(2.0 / COMMANDS_PER_S)
                for one in everybody:
                    assert one.messages == [(command_key("s", "gcs"), b"%d" % i) for i in range(5)]
                await until(lambda: d3.publish("status", b"flying") or len(operator.messages) > 5)  # type: ignore[func-returns-value]
                assert operator.messages[5] == (drone_key("s", "d3", "status"), b"flying")
                assert d1.mesh.alive == {"d2", "d3"}  # an operator is none of the drones

    asyncio.run(run())


def test_who_joins_late_gets_the_entries_so_far_and_then_the_new_ones_in_order() -> None:
    async def run() -> None:
        first = endpoint()
        async with member("d1", first) as d1:
            for i in range(300):
                d1.publish("cone", b"%d" % i)
            async with member("d2", endpoint(), (first,)) as d2:
                await until(lambda: len(d2.messages) >= 300)  # Zenoh can miss a message put while a link comes up
                for i in range(300, 400):
                    d1.publish("cone", b"%d" % i)
                await until(lambda: len(d2.messages) >= 400)
                assert [int(payload) for _, payload in d2.messages] == list(range(400))

    asyncio.run(run())


def test_the_log_query_brings_what_the_history_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "CACHE_ENTRIES", 20)
    cone = drone_key("s", "d1", "cone")
    log = [(cone, b"%d" % i) for i in range(600)]

    def missing(summary: bytes) -> list[tuple[str, bytes]]:
        return log[int(summary) :][:500]

    async def run() -> None:
        first = endpoint()
        async with member("d1", first, answer=missing) as d1:
            for key, payload in log:
                d1.mesh.publish(key, payload)
            async with member("d2", endpoint(), (first,)) as d2:
                await until(lambda: d2.got(cone)[-1:] == [b"599"])
                assert len(d2.messages) < 100
                assert await d2.mesh.ask("d1", b"0") == 500
                assert await d2.mesh.ask("d1", b"500") == 100
                await until(lambda: set(d2.messages) == set(log))
                assert await d2.mesh.ask("nobody", b"") == 0
                assert d2.mesh.counters["log_asked"] == 3
                assert d2.mesh.counters["log_replies"] == 600

    asyncio.run(run())


def test_a_log_comes_once_to_one_that_takes_it_slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before, a peer that asked while the last answer still waited for delivery got it again, twice or three times."""
    monkeypatch.setattr(inbox, "DELIVERED_S", 60.0)
    monkeypatch.setattr(session, "ASK_S", 60.0)
    log = [(drone_key("s", "d1", "cone"), b"%d" % i) for i in range(180)]

    async def run() -> None:
        first = endpoint()
        answering = member("d1", first, answer=lambda summary: log[int(summary) :][:60])
        async with answering as d1, member("d2", endpoint(), (first,)) as d2:
            await linked(d1, d2)
            d2.takes_s = 0.004  # an answer takes longer than until the next question
            asking = asyncio.create_task(recover(lambda: d2.mesh.alive, lambda: b"%d" % len(d2.messages), d2.mesh.ask, 0.0))
            await until(lambda: d2.mesh.counters["log_replies"] >= len(log) and len(d2.messages) >= len(log))
            asking.cancel()
            assert d2.messages == log
            assert d2.mesh.counters["log_replies"] == len(log)

    asyncio.run(run())


def test_an_answer_that_fails_is_counted_and_the_mesh_goes_on() -> None:
    def fail(summary: bytes) -> list[tuple[str, bytes]]:
        if summary == b"nonsense":
            raise ProtocolError("not a summary")
        return [("bad key //", b""), (drone_key("s", "d1", "cone"), b"1")] if summary == b"bad" else []

    async def run() -> None:
        first = endpoint()
        async with member("d1", first, answer=fail) as d1, member("d2", endpoint(), (first,)) as d2:
            await linked(d1, d2)
            start_s = time.monotonic()
            assert await d2.mesh.ask("d1", b"nonsense") == 0
            await d2.mesh.ask("d1", b"bad")
            assert time.monotonic() - start_s < session.ASK_S  # the query is ended at once all the same
            assert await d2.mesh.ask("d1", b"") == 0
            await until(lambda: d1.mesh.counters["log_answer_failed"] == 2)
            d1.publish("cone", b"still here")
            await until(lambda: (drone_key("s", "d1", "cone"), b"still here") in d2.messages)

    asyncio.run(run())


def test_a_log_query_for_foreign_things_brings_nothing_in() -> None:
    def foreign(summary: bytes) -> list[tuple[str, bytes]]:
        return [(drone_key("other", "d1", "cone"), b""), ("radron/9/x", b""), (drone_key("s", "d1", "cone"), bytes(70_000))]

    async def run() -> None:
        first = endpoint()
        async with member("d1", first, answer=foreign), member("d2", endpoint(), (first,)) as d2:
            await until(lambda: d2.mesh.alive)
            await d2.mesh.ask("d1", b"")
            await until(lambda: d2.mesh.counters["oversized"])
            assert d2.messages == []
            assert d2.mesh.counters["other_swarm"] == d2.mesh.counters["unknown_key"] == 1

    asyncio.run(run())


def test_a_loop_that_was_busy_gets_the_newest_pose_and_all_entries() -> None:
    async def run() -> None:
        async with pair() as (d1, d2):
            for i in range(100):
                d1.publish("pose", b"%d" % i)
                d1.publish("cone", b"%d" % i)
                time.sleep(0.002)  # the loop that d1 and d2 share stands still
            await until(lambda: len(d2.got(drone_key("s", "d1", "cone"))) == 100)
            poses = d2.got(drone_key("s", "d1", "pose"))
            assert poses[-1] == b"99"
            assert len(poses) < 100
            assert d2.mesh.counters["superseded"] == 100 - len(poses)
            assert d2.got(drone_key("s", "d1", "cone")) == [b"%d" % i for i in range(100)]

    asyncio.run(run())


def test_swarms_do_not_hear_each_other() -> None:
    async def run() -> None:
        first = endpoint()
        async with (
            member("d1", first) as d1,
            member("d2", endpoint(), (first,)) as d2,
            member("x", endpoint(), (first,), "t") as other,
        ):
            await linked(d1, d2)
            other.publish("cone", b"")
            other.publish("pose", b"")
            d2.publish("pose", b"")
            await until(lambda: d1.messages)
            await asyncio.sleep(0.1)
            assert d1.messages == [(drone_key("s", "d2", "pose"), b"")]
            assert other.messages == []
            assert other.mesh.alive == frozenset()

    asyncio.run(run())


def test_two_agents_of_one_id_hear_of_each_other() -> None:
    async def run() -> None:
        first = endpoint()
        async with (
            member("d1", first) as d1,
            member("d2", endpoint(), (first,)) as d2,
            member("d1", endpoint(), (first,)) as twin,
        ):
            await linked(d1, d2, twin)
            await until(lambda: twin.publish("status", b"twin") or d1.messages)  # type: ignore[func-returns-value]
            assert d1.messages[0] == (drone_key("s", "d1", "status"), b"twin")

    asyncio.run(run())


def test_what_is_too_large_is_dropped_and_counted() -> None:
    async def run() -> None:
        async with pair() as (d1, d2):
            d1.publish("pose", bytes(MAX_NEWS_BYTES + 1))
            d1.publish("pose", bytes(MAX_NEWS_BYTES))
            await until(lambda: d2.messages)
            assert [len(payload) for _, payload in d2.messages] == [MAX_NEWS_BYTES]
            assert d2.mesh.counters["oversized"] == 1

    asyncio.run(run())


def test_who_leaves_is_gone_at_once_and_publishes_nothing_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(link._SETTINGS, LEASE, LONG_LEASE_MS)  # so that no lease ends

    async def run() -> None:
        async with pair() as (d1, d2):
            start_s = time.monotonic()
            await d2.mesh.close()
            assert time.monotonic() - start_s < link.LINK_CLOSE_S  # ended by itself, not given up
            await until(lambda: not d1.mesh.alive)
            d2.publish("pose", b"")
            assert d2.mesh.counters["publish_failed"] == 1
            assert await d2.mesh.ask("d1", b"") == 0
            assert d2.mesh.alive == frozenset()

    asyncio.run(run())


def test_opening_and_closing_leaves_no_files_open() -> None:
    async def run() -> None:
        async with pair():
            pass
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(3):
            async with pair():
                pass
        await until(lambda: len(os.listdir("/proc/self/fd")) <= before + 2)  # sockets go in Zenoh's threads

    asyncio.run(run())


def test_a_key_of_somebody_else_is_refused() -> None:
    async def run() -> None:
        async with member("d1", endpoint()) as d1:
            for key in ("radron/2/s/d1/nonsense", drone_key("other", "d1", "pose")):
                with pytest.raises(ProtocolError):
                    d1.mesh.publish(key, b"")

    asyncio.run(run())


def test_a_peer_that_cannot_be_reached_is_dialled_until_it_is_there() -> None:
    async def run() -> None:
        late = endpoint()
        start_s = time.monotonic()
        async with member("d2", endpoint(), (late, "tcp/203.0.113.9:7447")) as d2:
            assert time.monotonic() - start_s < 2.0
            assert d2.mesh.alive == frozenset()
            async with member("d1", late) as d1:
                await linked(d1, d2)

    asyncio.run(run())


async def _open(config: MeshConfig) -> None:
    mesh = await Mesh.open(config, "s", "d1", receive=lambda key, payload: None)
    await mesh.close()


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (MeshConfig(listen="7447"), "mesh.listen: '7447' is not an endpoint; expected tcp/HOST:PORT"),
        (MeshConfig(listen="tcp/127.0.0.1:99999"), "is not an endpoint"),
        (MeshConfig(listen="tcp/127.0.0.1:0"), "is not an endpoint"),
        (MeshConfig(connect=("tcp/127.0.0.1:0",)), "mesh.connect: 'tcp/127.0.0.1:0' is not an endpoint"),
        (MeshConfig(listen="tcp/0.0.0.0:7447"), "not the address of one interface"),
        (MeshConfig(listen="tcp/203.0.113.9:7447"), "is not an address of this computer"),
        (MeshConfig(connect=("udp/127.0.0.1:7447",)), "mesh.connect: 'udp/127.0.0.1:7447' is not an endpoint"),
        (MeshConfig(connect=("tcp/no-such-host.invalid:7447",)), "give a numeric address"),
    ],
)
def test_what_cannot_work_is_one_line_and_soon(config: MeshConfig, words: str) -> None:
    start_s = time.monotonic()
    with pytest.raises(MeshError) as caught:
        asyncio.run(_open(config))
    assert time.monotonic() - start_s < link.OPEN_S  # also where a name server does not answer
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_numeric_host_is_not_looked_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine may be late with the lookup's thread, and there is nothing better to give than an address."""

    def lookup(host: str, *_: object, **__: object) -> None:
        raise AssertionError(host)

    monkeypatch.setattr(link.socket, "getaddrinfo", lookup)
    asyncio.run(_open(MeshConfig(listen=endpoint(), connect=(endpoint(), "tcp/[::1]:7447"))))


def test_a_port_in_use_is_one_line() -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)), pytest.raises(MeshError) as caught:
        asyncio.run(_open(MeshConfig(listen=endpoint(port))))
    assert str(caught.value) == (
        f"mesh.listen: cannot listen at 'tcp/127.0.0.1:{port}': address already in use; is another agent running on this port?"
    )


def test_names_that_make_no_key_are_refused() -> None:
    with pytest.raises(ProtocolError, match="is not an identifier"):
        asyncio.run(Mesh.open(MeshConfig(), "Swarm", "d1", receive=lambda key, payload: None))  # type: ignore[arg-type]
