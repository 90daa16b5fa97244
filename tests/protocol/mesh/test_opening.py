"""A session that is cancelled while it opens."""

import asyncio
from types import SimpleNamespace

import pytest

from radron.protocol.mesh import link
from radron.protocol.mesh.link import MeshConfig, open_session


@pytest.mark.parametrize("ticks", range(5))
def test_a_cancellation_counts_also_when_the_session_opens_at_that_moment(monkeypatch, ticks):
    """Between the opening and the cancellation pass so many turns of the loop; if it has returned, it was not cancelled."""
    closed = []

    async def run():
        opening = asyncio.get_running_loop().create_future()
        session = SimpleNamespace(info=SimpleNamespace(links=lambda: ()), close=lambda: closed.append(True))
        calls = iter((opening,))
        in_thread = link.in_thread
        monkeypatch.setattr(link, "in_thread", lambda work: next(calls, None) or in_thread(work))
        task = asyncio.create_task(open_session(MeshConfig(), dial_all=True))
        for _ in range(5):
            await asyncio.sleep(0)
        opening.set_result(session)
        for _ in range(ticks):
            await asyncio.sleep(0)
        if task.cancel():
            with pytest.raises(asyncio.CancelledError):
                await task
            assert closed == [True]
        else:
            assert task.result() is session

    asyncio.run(run())
