"""A drone of a live swarm is revoked in flight: the others shut it out one after another, and fly on together, away from it."""

from __future__ import annotations

import asyncio
import sysconfig
import time
from itertools import pairwise, permutations
from pathlib import Path

import pytest

from radron.agent.flight import topics
from radron.agent.flight.audit import audit
from radron.agent.flight.reader import RecordedFlight
from radron.protocol.keys import parse_key
from radron.protocol.messages import Stage
from radron.sim.live.course import Course
from radron.sim.live.places import Places
from radron.sim.live.runfolder import OPERATOR
from radron.sim.live.swarm import READY_S, live_swarm
from radron.sim.live.view import View
from radron.sim.live.worldlink import Order
from radron.sim.px4test.witness import Witness, least_distance_m
from radron.sim.scenario import load_scenario, override
from support.live.run import PATIENCE_S, stretched

TOOL = str(Path(sysconfig.get_path("scripts")) / "radron-agent")
SHUT_OUT_S = 10.0
GAP_S = 1.0
FLOWN_S = 25.0
CLOSEST_M = 3.0  # the mission's separation


def heard_ns(folder: Path, drone: str, sender: str) -> list[int]:
    """When the poses of another drone arrived, by a drone's record."""
    records = [
        record
        for segment in sorted((folder / "agents" / drone / "flight").glob("*.mcap"))
        for record in RecordedFlight(segment).records()
        if record.topic == topics.MESSAGE
    ]
    keys = [(record.publish_ns, parse_key(topics.decode_message(record.data)[0])) for record in records]
    return [at_ns for at_ns, key in keys if (key.sender, key.kind) == (sender, "pose")]


async def revoked(endpoint: str, folder: Path) -> str:
    """Output of the command."""
    words = ("revoke", "d3", "--swarm", "radron", "--connect", endpoint, "--identity", str(folder / "operator"), "--yes")
    process = await asyncio.create_subprocess_exec(TOOL, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT)
    said, _ = await process.communicate()
    assert process.returncode == 0, said.decode()
    return said.decode()


@pytest.mark.slow
def test_a_revoked_drone_is_shut_out_and_the_others_fly_on_with_one_log(tmp_path: Path) -> None:
    async def course() -> tuple[int, int]:
        scenario = override(load_scenario("paper-demo"), {"drones": 3, "mission.track.duration_s": 120.0})
        places = Places.here(3)
        async with live_swarm(scenario, 1, tmp_path, places, View()) as swarm:
            operator = swarm.operator
            await operator.get_ready(READY_S)
            witness = Witness(operator)
            flying = asyncio.create_task(Course(swarm.scenario, 1, operator).mission_flown())
            try:
                tracking = (Stage.TRACK,) * 3
                assert await operator.until(lambda: bool(witness.moments) and tuple(witness.now.stages) == tracking, 120.0)
                struck_s = witness.now.time_s
                said = await revoked(places.endpoints(["d1", "d2", "d3"], "d1")["d1"], tmp_path)
                told_ns = time.time_ns()
                assert "d3 is revoked: in effect at d1, d2" in said
                assert "its log entries count up to number" in said
                await operator.until(lambda: witness.now.time_s > struck_s + FLOWN_S, 2.0 * stretched(FLOWN_S))
                assert tuple(witness.now.stages[:2]) == tracking[:2]
                moments = witness.since(struck_s)
                _, space_m = least_distance_m(moments)  # d3 returns above the others
                flat_m, _ = least_distance_m([moment._replace(position=moment.position[:2]) for moment in moments])
                print(f"least distance {space_m:.2f} m in space, of d1 and d2 {flat_m:.2f} m horizontally")
                assert min(space_m, flat_m) > CLOSEST_M
                operator.world.order(Order.CAMERAS_OFF)
                agents = operator.observer.agents

                def agreed() -> bool:
                    return len({agent.estimate.digest if agent.estimate is not None else "" for agent in agents[:2]}) == 1

                assert await operator.until(agreed, PATIENCE_S)
                assert "d3 has been revoked by operator" in (agents[0].status.notices if agents[0].status is not None else ())
                assert any("d3 has been revoked" in text for text in agents[2].problems)
                return told_ns, time.time_ns()
            finally:
                flying.cancel()

    told_ns, end_ns = asyncio.run(course())
    for drone, other in permutations(("d1", "d2")):
        heard = [at_ns for at_ns in heard_ns(tmp_path, drone, other) if told_ns - 5_000_000_000 < at_ns < end_ns]
        gap_s = max(after - before for before, after in pairwise(heard)) * 1e-9
        last_s = (max(heard_ns(tmp_path, drone, "d3")) - told_ns) * 1e-9
        print(f"largest gap of {other} at {drone}: {gap_s:.2f} s; last of d3: {last_s:.1f} s after the command")
        assert gap_s < stretched(GAP_S)
        assert last_s < stretched(SHUT_OUT_S)
        assert (tmp_path / "agents" / drone / "state" / f"{drone}.revoked").exists()
        (line, *_) = [one for one in audit(RecordedFlight(tmp_path / "agents" / drone / "flight")) if one.action == "revoke"]
        assert (line.station, line.drones, line.result) == (OPERATOR, ("d3",), "obeyed")
        assert "operator operator, serial" in line.signer
