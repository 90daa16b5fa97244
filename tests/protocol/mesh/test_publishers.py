"""Two sessions that publish under one drone's name are reported; a restart is not."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from radron.protocol.identity import load_identity
from radron.protocol.keys import drone_key
from radron.protocol.mesh.publishers import LEASE_S, MAX_SESSIONS, SHOWN_S, Publishers
from support.mesh.encrypted import joined, swarm
from support.mesh.meshes import DEADLINE_S, Member

POSE = drone_key("s", "d2", "pose")
TWO = ("d2: two sessions publish under its name (a copied key, or an agent started twice)",)


def told(*sessions: tuple[float, float], until_s: float = 20.0, period_s: float = 0.1) -> tuple[str, ...]:
    """Reports at the end of sessions that each publish from one time to another."""
    publishers = Publishers()
    news = [(begin_s + period_s * k, str(one)) for one, (begin_s, end_s) in enumerate(sessions)
            for k in range(round((end_s - begin_s) / period_s))]  # fmt: skip
    for at_s, session in sorted(news):
        publishers.note("d2", session, at_s)
    return publishers.problems(until_s)


@pytest.mark.parametrize("period_s", [0.05, 0.1, 1.0])
def test_two_that_go_on_are_told_once_the_lease_is_over(period_s: float) -> None:
    assert told((0.0, 20.0), (15.0, 15.0 + LEASE_S + 2.0 * period_s), period_s=period_s) == TWO
    assert told((0.0, 20.0), (15.0, 15.0 + LEASE_S - period_s / 2.0), period_s=period_s) == ()


@pytest.mark.parametrize("late_s", [-3.0, 0.0, 0.5, 1.0])
def test_a_restart_whose_last_messages_come_late_is_not_told(late_s: float) -> None:
    assert told((0.0, 15.0 + late_s), (15.0, 20.0)) == ()


def test_an_agent_that_is_started_again_and_again_is_not_told() -> None:
    assert told((0.0, 5.0), (5.0, 9.0), (9.5, 14.0), (15.0, 20.0)) == ()


def test_a_session_after_the_other_is_told_as_long_as_it_may_matter() -> None:
    assert told((0.0, 10.0), (2.0, 5.0), until_s=5.0 + SHOWN_S - 1.0) == TWO
    assert told((0.0, 10.0), (2.0, 5.0), until_s=5.0 + LEASE_S + SHOWN_S + 0.1) == ()


def test_one_that_takes_another_session_for_each_message_is_told_and_fills_no_memory() -> None:
    publishers = Publishers()
    for k in range(10_000):
        publishers.note("d2", "own" if k % 10 == 0 else str(k), 0.01 * k)
    assert publishers.problems(100.0) == TWO
    assert all(len(spans) <= MAX_SESSIONS for spans in publishers._spans.values())


async def publishing(condition: Callable[[], object], *members: Member) -> float:
    """Have members publish poses, ten a second, until a condition holds; for how long they did."""
    began_s = time.monotonic()
    while not condition() and time.monotonic() - began_s < DEADLINE_S:
        for one in members:
            one.publish("pose", b"a pose")
        await asyncio.sleep(0.1)
    return time.monotonic() - began_s


def test_a_certificate_that_two_sessions_use_at_once_is_told(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2 = await swarm(folder, stack, "d1", "d2")
            thief = await stack.enter_async_context(joined(load_identity(folder / "d2"), connect=(d1.listen,)))
            await publishing(lambda: len(d1.got(POSE)) > 5, thief)
            assert d1.mesh.problems == ()
            assert await publishing(lambda: d1.mesh.problems, d2, thief) < 2.0
            assert d1.mesh.problems == TWO

    asyncio.run(course())


def test_an_agent_that_is_started_again_with_its_certificate_is_not_told(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            (d1,) = await swarm(folder, stack, "d1")
            for _ in range(2):
                async with joined(load_identity(folder / "d2"), connect=(d1.listen,)) as d2:
                    before = len(d1.got(POSE))
                    await publishing(lambda: len(d1.got(POSE)) > before + 5, d2)  # noqa: B023
                    began_s = time.monotonic()
                    await publishing(lambda: time.monotonic() > began_s + LEASE_S + 0.5, d2)  # noqa: B023
                    assert d1.mesh.problems == ()

    asyncio.run(course())
