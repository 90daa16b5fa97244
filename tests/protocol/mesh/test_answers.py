"""Budgets of the log query: a drone's queries leave the others' budgets untouched, and operators share one."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable

import pytest

from radron.protocol.mesh.answers import MAX_DRONE_BURST, MAX_OPERATORS_BPS, MAX_OPERATORS_BURST, Answers
from radron.protocol.units import STATION

ENTRY = bytes(100_000)


class Query:
    """A query as Zenoh hands it over; counts the bytes of its replies."""

    payload = None
    got = 0

    def __enter__(self) -> Query:
        return self

    def __exit__(self, *error: object) -> None: ...

    def reply(self, key: str, payload: bytes) -> None:
        self.got += len(payload)


class Loop(asyncio.SelectorEventLoop):
    """Its time goes on only where a test says so."""

    now_s = 0.0

    def time(self) -> float:
        return self.now_s


def played(course: Callable[[Loop, Answers], Awaitable[None]]) -> None:
    loop = Loop()
    try:
        answers = Answers(loop, lambda _: [("key", ENTRY)] * 5, Counter())
        loop.run_until_complete(course(loop, answers))
    finally:
        loop.close()


async def asked(answers: Answers, asker: str, times: int = 1) -> int:
    """Bytes that an asker gets."""
    queries = [Query() for _ in range(times)]
    for query in queries:
        answers.reply(query, asker)  # type: ignore[arg-type]
        while answers._sending:
            await asyncio.sleep(0.0)
    return sum(query.got for query in queries)


@pytest.mark.parametrize(("crowding", "burst"), [(STATION, MAX_OPERATORS_BURST), ("d2", MAX_DRONE_BURST)])
def test_an_asker_gets_its_budget_and_leaves_the_others_theirs(crowding: str, burst: float) -> None:
    async def course(loop: Loop, answers: Answers) -> None:
        assert await asked(answers, crowding, 30) == pytest.approx(burst, abs=5 * len(ENTRY))
        assert await asked(answers, "d3") == 5 * len(ENTRY)
        assert [problem.split(" asks")[0] for problem in answers.problems] == ["an operator" if crowding == STATION else "d2"]

    played(course)


def test_over_time_operators_get_half_a_megabyte_a_second() -> None:
    async def course(loop: Loop, answers: Answers) -> None:
        got = 0
        for _ in range(1_200):  # 20 a second, as many as Zenoh lets through
            loop.now_s += 0.05
            got += await asked(answers, STATION)
        assert got == pytest.approx(MAX_OPERATORS_BURST + 60.0 * MAX_OPERATORS_BPS, abs=5 * len(ENTRY))

    played(course)


def test_an_asker_that_waits_for_its_turn_is_no_problem_and_one_that_crowds_is_told_for_ten_seconds() -> None:
    async def course(loop: Loop, answers: Answers) -> None:
        for _ in range(60):  # as ``recovery`` asks where nothing comes
            await asked(answers, "d2")
            loop.now_s += 2.0
        assert answers.problems == ()
        await asked(answers, "d2", 200)
        assert answers.problems
        loop.now_s += 9.0
        assert answers.problems
        loop.now_s += 2.0
        assert answers.problems == ()

    played(course)
