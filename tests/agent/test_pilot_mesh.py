"""Pilots over a real mesh: two agents with the same id notice each other, and a restarted one recovers its log."""

import asyncio
import time
from contextlib import asynccontextmanager

from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from support.flights.one_pilot import MISSION, SECOND, cone_of, pilot
from support.mesh.meshes import endpoint, until


@asynccontextmanager
async def on_mesh(one, drone, listen, *connect):
    mesh = await Mesh.open(
        MeshConfig(listen=listen, connect=connect),
        MISSION.swarm,
        drone,
        receive=lambda key, payload: one.receive(key, payload, time.time_ns()),
        drained=lambda: one.advance(time.time_ns()),
        answer=one.log_answer,
    )
    try:
        yield mesh
    finally:
        await mesh.close()


def test_two_agents_with_one_id_notice_each_other():
    async def run():
        one, twin, other = pilot("d1"), pilot("d1", boot="f" * 16), pilot("d2")
        pilots = {"one": one, "twin": twin, "other": other}
        said = {name: "" for name in pilots}
        first, second = endpoint(), endpoint()
        async with (
            on_mesh(one, "d1", first) as mesh_one,
            on_mesh(twin, "d1", second) as mesh_twin,
            on_mesh(other, "d2", endpoint(), first, second) as mesh_other,
        ):
            meshes = {"one": mesh_one, "twin": mesh_twin, "other": mesh_other}

            def noticed():
                for name, agent in pilots.items():
                    for key, payload in agent.step(time.time_ns()).publications:
                        meshes[name].publish(key, payload)
                        if key.endswith("/status"):
                            said[name] = payload
                return all(b"another agent is running as d1" in said[name] for name in ("one", "twin"))

            await until(noticed)
            assert b"another agent" not in said["other"]

    asyncio.run(run())


def test_a_restarted_agent_gets_back_everything_its_own_entries_included():
    async def run():
        partner, restarted = pilot("d2"), pilot("d1", boot="f" * 16)
        now_ns = time.time_ns()
        for sequence in range(700):
            drone = ("d1", "d2")[sequence % 2]
            cone = cone_of(drone, sequence, now_ns - 100 * SECOND + sequence * SECOND // 10, boot=drone[-1] * 16)
            partner.receive(key_of(MISSION.swarm, cone), encode(cone), now_ns)
        first = endpoint()
        async with on_mesh(partner, "d2", first), on_mesh(restarted, "d1", endpoint(), first) as mesh:
            await until(lambda: "d2" in mesh.alive)
            replies = [await mesh.ask("d2", restarted.log_summary())]
            await until(lambda: len(restarted.fusion.log) == 500)
            replies.append(await mesh.ask("d2", restarted.log_summary()))
            await until(lambda: restarted.digest == partner.digest)
            assert replies == [500, 200]
            assert await mesh.ask("d2", restarted.log_summary()) == 0
            end_ns = time.time_ns()
            for agent in (partner, restarted):
                agent.advance(end_ns)
                while agent.pending:
                    agent.advance(end_ns)
            assert restarted.hypothesis.position.tobytes() == partner.hypothesis.position.tobytes()

    asyncio.run(run())
