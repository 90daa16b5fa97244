"""The launcher's view of the agents, from their messages."""

from __future__ import annotations

import pytest

from radron.protocol.codec import encode
from radron.protocol.codes import Code
from radron.protocol.keys import key_of
from radron.protocol.message import DroneMessage
from radron.protocol.messages import Estimate, Source, Stage, Status
from radron.protocol.signing import Verifier, sign_status
from radron.protocol.texts import CodedText, Texts, coded
from radron.sim.live.monitor import Observer
from radron.sim.lockstep.members import SimulatedAuthority
from radron.sim.scenario import load_scenario
from radron.sim.vehicle.px4.fleet import VehicleReport

MISSION = load_scenario("paper-demo").mission
NAMES = frozenset(drone.id for drone in MISSION.drones)
DIGEST = "0" * 31


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def vehicle(armed: bool, failsafe: bool = False) -> VehicleReport:
    return VehicleReport("hold", armed, armed, failsafe, 0, 0, 0.0)


def status(
    drone: str, stage: Stage = Stage.PREFLIGHT, problems: tuple[CodedText, ...] = (), mission: str = MISSION.mission_id
) -> Status:
    return Status(
        stamp_ns=1,
        drone=drone,
        mission=mission,
        boot="0" * 16,
        stage=stage,
        problems=tuple(map(str, problems)),
        codes=Texts(problems).codes,
    )


def estimate(drone: str, x: float, last: str = "0") -> Estimate:
    return Estimate(
        stamp_ns=1, drone=drone, mission=MISSION.mission_id, estimator="paper", digest=DIGEST + last,
        sources=(Source(position_m=(x, 2.0, 0.0), covariance_m2=(4.0, 0.0, 0.0, 9.0, 0.0, 0.0)),),
    )  # fmt: skip


def hear(observer: Observer, *messages: DroneMessage) -> None:
    for message in messages:
        observer.receive(key_of(MISSION.swarm, message), encode(message))


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def observer(clock: Clock) -> Observer:
    return Observer(MISSION, clock)


def test_it_names_what_each_drone_still_lacks(observer: Observer, clock: Clock) -> None:
    assert observer.obstacles() == [f"{drone}: not in the mesh yet" for drone in ("d1", "d2", "d3")]
    observer.look([vehicle(armed=False)] * 3, NAMES)
    hear(
        observer,
        status("d1"),
        status("d2", problems=coded(Code.NOT_READY_TO_ARM, ["no compass", "no fix"])),
        status("d3", mission="0" * 16),
    )
    assert observer.obstacles() == ["d2: no compass", f"d3: another mission file ({'0' * 16}, here {MISSION.mission_id})"]
    hear(observer, status("d2", stage=Stage.LANDED), status("d3", stage=Stage.TRACK))
    assert observer.obstacles() == ["d3: in track already"]  # a landed drone can be started again
    hear(observer, status("d3"))
    assert observer.obstacles() == []
    clock.now_s += 10.0
    assert observer.obstacles() == [f"{drone}: no status yet" for drone in ("d1", "d2", "d3")]


def test_a_drone_that_comes_later_is_not_waited_for_by_the_others_either(observer: Observer) -> None:
    observer.look([vehicle(armed=False)] * 3, NAMES - {"d3"})
    missed = CodedText(Code.NO_CONTACT, "no contact with d3 (tls/127.0.0.1:7449)", "d3")
    hear(observer, status("d1", problems=(missed,)), status("d2", problems=(missed, CodedText(Code.NOT_READY_TO_ARM, "no fix"))))
    assert observer.obstacles() == [f"d1: {missed}", f"d2: {missed}", "d3: not in the mesh yet"]
    assert observer.obstacles({"d3"}) == ["d2: no fix"]


def test_a_drone_whose_agent_has_died_has_landed_when_its_vehicle_is_down(observer: Observer) -> None:
    agent = observer.agents[0]
    hear(observer, status("d1", stage=Stage.TRACK))
    observer.look([vehicle(armed=True)] * 3, NAMES)
    assert agent.stage is Stage.TRACK
    observer.look([vehicle(armed=True)] * 3, NAMES - {"d1"})
    assert agent.stage is Stage.TRACK
    observer.look([vehicle(armed=True, failsafe=True)] * 3, NAMES - {"d1"})
    assert (agent.stage, agent.failsafes) == (Stage.RETURN, 1)
    observer.look([vehicle(armed=False)] * 3, NAMES - {"d1"})
    assert agent.stage is Stage.LANDED


def test_an_estimate_that_is_not_repeated_is_no_hypothesis_any_more(observer: Observer, clock: Clock) -> None:
    hear(observer, estimate("d1", 1.5), estimate("d2", 1.5))
    observer.look([vehicle(armed=True)] * 3, NAMES)
    belief = observer.agents[0].hypothesis
    assert belief is not None
    assert belief.position.tolist() == [1.5, 2.0, 0.0]
    assert belief.covariance[1, 1] == 9.0
    clock.now_s += 10.0
    hear(observer, estimate("d2", 1.5), status("d1"))
    observer.look([vehicle(armed=True)] * 3, NAMES)
    assert observer.agents[0].hypothesis is None
    assert observer.agents[1].hypothesis is not None


def test_agents_agree_by_digest_and_by_every_bit_of_the_position(observer: Observer) -> None:
    observer.look([vehicle(armed=False)] * 3, NAMES)
    hear(observer, estimate("d1", 1.5), estimate("d2", 1.5))
    assert not observer.agreed()  # no estimate of d3 yet
    hear(observer, estimate("d3", 1.5))
    assert observer.agreed()
    hear(observer, estimate("d3", 1.5000000000000002))
    assert not observer.agreed()
    hear(observer, estimate("d3", 1.5, last="1"))
    assert not observer.agreed()
    observer.look([vehicle(armed=False)] * 3, NAMES - {"d3"})
    assert observer.agreed()  # the live ones


def test_what_is_no_message_is_counted_and_dropped(observer: Observer) -> None:
    observer.receive("radron/2/radron/d1/status", b"\xff\xff")
    observer.receive("nonsense", b"")
    assert observer.refused == 2
    assert observer.agents[0].status is None


def test_a_status_counts_only_as_its_drone_has_signed_it(observer: Observer) -> None:
    """The operator acts upon statuses; in a swarm without certificates each counts, as above."""
    authority = SimulatedAuthority(1)
    observer.verifier = Verifier(authority.authority)
    observer.look([vehicle(armed=False)] * 3, NAMES)
    signed = {drone: sign_status(status(drone), authority.trust(drone)) for drone in ("d1", "d2")}
    hear(observer, signed["d1"], sign_status(status("d2"), authority.trust("d1")), status("d3"))
    assert observer.obstacles() == ["d2: no status yet", "d3: no status yet"]
    assert observer.refused == 2
    hear(observer, signed["d2"])
    assert observer.obstacles() == ["d3: no status yet"]
