"""A drone with a stolen key is revoked in a lockstep flight: an operator sends the order to one drone, and the swarm goes on."""

from math import dist

import pytest

from radron.protocol.codec import encode
from radron.protocol.messages import Stage
from radron.protocol.revocations import Revocation
from radron.protocol.signing import sign_revocation
from radron.sim.lockstep.flight import watched
from radron.sim.lockstep.members import SimulatedAuthority, operator_of
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.moment import EPOCH_NS, Moment

SEED = 3
TOLD_S, KNOWN_S, SETTLED_S, END_S = 30.0, 32.0, 35.0, 50.0
CLOSEST_M = 2.5


@pytest.mark.slow
def test_the_swarm_forgets_what_a_revoked_drone_says_and_keeps_away_from_it():
    scenario = override(load_scenario("paper-demo"), {"drones": 3, "mission.track.duration_s": 90.0})
    mission, operator = scenario.mission, operator_of(SimulatedAuthority(SEED))
    last = {}
    least_m, digests, stages, errors_m = [], [], [], []

    def watch(moment: Moment) -> bool:
        now_ns = EPOCH_NS + round(moment.time_s * 1e9)
        first, second, third = moment.pilots
        if not last and moment.time_s >= TOLD_S:
            for (drone, boot), held in first.fusion.log.summary().items():
                if drone == "d3":
                    last[boot] = held.ranges[-1][1] // 2  # the newer half of the entries is the thief's
            bare = Revocation(
                stamp_ns=now_ns, station=operator.name, member="d3", until_ns=2 * now_ns, last=last, certificate=b""
            )
            told = sign_revocation(bare, operator)
            assert (
                first.receive(f"radron/2/{mission.swarm}/station/{operator.name}/revocation", encode(told), now_ns).refused == ""
            )
        if moment.time_s >= KNOWN_S:
            assert {one.member for one in second.revocations} == {"d3"}
        if moment.time_s >= SETTLED_S:
            digests.append(first.digest == second.digest)
            held = [record.entry.sequence for record in first.fusion.log if record.entry.drone == "d3"]
            assert max(held) == next(iter(last.values()))
            least_m.append(min(dist(moment.position_m[2], moment.position_m[one]) for one in (0, 1)))
            stages.append((first.stage, second.stage, third.stage))
            errors_m.append(dist(first.hypothesis.position[:2], moment.source))
        return moment.time_s >= END_S

    watched(scenario, SEED, watch)
    assert sum(digests) > 0.3 * len(digests)  # the others differ by entries that are on their way
    assert min(least_m) > CLOSEST_M
    assert {(first, second) for first, second, _ in stages} == {(Stage.TRACK, Stage.TRACK)}
    assert {third for *_, third in stages} <= {Stage.RETURN, Stage.LANDING, Stage.LANDED}
    assert max(errors_m) < 2.0
