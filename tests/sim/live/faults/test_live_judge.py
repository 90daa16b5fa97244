"""A live flight's judge: the agents' statuses, the fate of a disarmed vehicle, and the agents' logs."""

import json
from math import cos, pi, sin
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from radron.protocol.codes import Code
from radron.protocol.messages import Pose, Stage, Status
from radron.protocol.texts import CodedText, Texts
from radron.sim.faults.machines import Disarm, StreamLost
from radron.sim.live.faults.judge import Disarmed, LiveJudge, OwnPose, SilentStream, exceptions, heading_rad
from radron.sim.live.monitor import Belief, ObservedAgent
from radron.sim.live.report import AgentEnd, LiveReport
from radron.sim.live.worldlink import Truth
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.moment import Scene
from radron.sim.vehicle.px4.fleet import VehicleReport
from radron.sim.world.sources import Source
from support.flights import moments

SECOND = 1_000_000_000


def turned(yaw_rad: float) -> tuple[float, float, float, float]:
    return cos(0.5 * yaw_rad), 0.0, 0.0, sin(0.5 * yaw_rad)


def truth(time_s: float, x: float = 10.0, z: float = 3.0) -> Truth:
    vehicle = VehicleReport("offboard", True, True, False, 0, 0, 0.0)
    return Truth(
        time_s=time_s, position_m=((x, 10.0, z), (x, 20.0, z), (x, 30.0, z)), velocity_mps=((0.0, 0.0, 0.0),) * 3, sources=(),
        vehicles=(vehicle,) * 3, late_s=0.0, dropped=0, stamp_ns=int(time_s * SECOND), attitude=(turned(0.0),) * 3,
    )  # fmt: skip


def wrong(
    x: float, sigma_m: float = 0.1, yaw_rad: float = 0.0, z: float = 3.0, seconds: float = 4.0, epoch: int = 0
) -> list[str]:
    """Faults in the poses of d1, launched at (8, 2), published at (10, 10)."""
    judged, set_ = OwnPose(), moments.setting()
    for time_s in (0.0, 0.9):
        judged.check(_pose(time_s, 10.0, 0.1, 0.0, 0), [truth(time_s)], 0, set_)  # in the frame in which it began
    told = [
        judged.check(_pose(1.0 + 0.1 * k, x, sigma_m, yaw_rad, epoch), [truth(1.0 + 0.1 * k, z=z)], 0, set_)
        for k in range(round(10.0 * seconds))
    ]
    return [text for text in told if text is not None]


def _pose(time_s: float, x: float, sigma_m: float, yaw_rad: float, epoch: int) -> Pose:
    return Pose(
        stamp_ns=int(time_s * SECOND), drone="d1", epoch=epoch, position_m=(x - 8.0, 8.0, 3.0), velocity_mps=(0.0, 0.0, 0.0),
        quaternion=turned(yaw_rad), position_sigma_m=sigma_m, yaw_sigma_rad=0.02,
    )  # fmt: skip


def test_a_pose_that_cannot_be_is_told_once_it_lasts() -> None:
    assert wrong(10.5) == []
    (text,) = wrong(13.0)
    assert "3.0 m from where it is, sigma 0.10 m" in text
    assert wrong(13.0, sigma_m=0.6) == []  # reported
    assert wrong(13.0, seconds=1.5) == []
    assert wrong(13.0, z=0.1) == []  # on the ground
    assert wrong(13.0, epoch=1) == []  # another frame, which the judge does not know
    assert len(wrong(10.0, yaw_rad=0.5)) == 1
    assert wrong(10.0, yaw_rad=0.2) == []


def test_a_frame_that_the_mission_does_not_lay_out_exactly_is_not_judged() -> None:
    set_ = moments.setting()
    estimated = tuple(replace(drone, localization="slam") for drone in set_.scenario.mission.drones)
    mission = replace(set_.scenario.mission, drones=estimated)
    set_ = Setting(replace(set_.scenario, mission=mission), moments.HEAL_S, moments.END_S)
    judged = OwnPose()
    times_s = [0.1 * k for k in range(40)]
    told = [judged.check(_pose(time_s, 20.0, 0.1, 0.0, 0), [truth(time_s)], 0, set_) for time_s in times_s]
    assert told == [None] * 40


def judge() -> LiveJudge:
    return LiveJudge(moments.setting(), [ObservedAgent(name) for name in ("d1", "d2", "d3")])


def test_a_pose_is_held_against_the_truth_of_its_time_however_late_that_comes() -> None:
    """At 5 m/s; poses after the last truth are not judged at all."""
    one, wrong_ = judge(), judge()
    times_s = [0.1 * k for k in range(100)]
    for seconds in (times_s[:20], times_s[20:60]):  # the launcher reads the messages of 4 s before the truths of these
        for time_s in seconds:
            one.hear(0, _pose(time_s, 10.0 + 5.0 * time_s, 0.1, 0.0, 0))
            wrong_.hear(0, _pose(time_s, 20.0 + 5.0 * time_s, 0.1, 0.0, 0))
        for time_s in seconds:
            one.see(time_s, truth(time_s, 10.0 + 5.0 * time_s))
            wrong_.see(time_s, truth(time_s, 10.0 + 5.0 * time_s))
    for time_s in times_s[60:]:
        one.hear(0, _pose(time_s, 10.0 + 5.0 * time_s, 0.1, 0.0, 0))
    assert [each.invariant for each in one.violations] == []
    assert [(each.invariant, each.drones) for each in wrong_.violations] == [("own-pose", ("d1",))]


def test_a_drone_says_what_its_autopilot_does_not_send_any_more() -> None:
    def told(*codes: Code, boot: str = "00000000000000aa", message: str = "GPS_RAW_INT") -> list[str]:
        judged = SilentStream(StreamLost(target="d1", at_s=10.0, for_s=8.0, message=message), "d1")
        problems = [CodedText(code, "any words") for code in codes]
        statuses = [_status(9.5, "00000000000000aa"), *(_status(time_s, boot, *problems) for time_s in (15.9, 17.0, 17.5, 18.5))]
        return [text for each in statuses if (text := judged.check(each.stamp_ns / SECOND, each)) is not None]

    (text,) = told()
    assert "GPS_RAW_INT" in text
    assert len(told(Code.NOT_READY_TO_ARM)) == 1
    assert told(Code.SATELLITES_LOST) == []
    assert told(Code.AUTOPILOT_DATA_MISSING) == []  # more than that
    assert told(boot="00000000000000bb") == []  # it was started meanwhile
    assert told(message="BATTERY_STATUS") == []  # nothing that it needs


def _status(time_s: float, boot: str, *problems: CodedText, drone: str = "d1", stage: Stage = Stage.TRACK) -> Status:
    words, codes = tuple(map(str, problems)), Texts(problems).codes
    told = {"mission": "0" * 16, "boot": boot, "stage": stage, "problems": words, "codes": codes}
    return Status(stamp_ns=int(time_s * SECOND), drone=drone, **told)


def test_the_error_of_a_source_estimate_counts_while_drones_search_and_not_on_their_way_home() -> None:
    agents = [ObservedAgent(name) for name in ("d1", "d2", "d3")]
    one = LiveJudge(moments.setting(), agents)
    for time_s, stage, source_m in ((49.0, Stage.TRACK, 31.0), (51.0, Stage.TRACK, 32.0), (53.0, Stage.RETURN, 45.0)):
        for agent in agents:
            agent.alive = True
            agent.hear(_status(time_s, "00000000000000aa", drone=agent.drone, stage=stage), time_s)
            agent._belief = Belief(np.array([30.0, 30.0, 0.0]), np.eye(3))
        one.see(time_s, replace(truth(time_s), sources=(Source("Cs-137", 1e9, (source_m, 30.0, 0.0)),)))
    assert one.log.largest_error_m(one.able) == 2.0


def test_the_heading_of_an_attitude() -> None:
    assert heading_rad(turned(1.0)) == 1.0
    upright = (cos(pi / 4), 0.0, -sin(pi / 4), 0.0)  # its forward axis points up, its left one still to the left
    assert abs(heading_rad(upright)) < 1e-9


def test_a_vehicle_that_was_disarmed_on_the_ground_and_is_armed_again() -> None:
    def scene(armed: bool, height_m: float = 0.0) -> Scene:
        autopilots = [moments.autopilot(armed=armed) for _ in range(3)]
        return Scene(0.0, np.array([(0.0, 0.0, height_m)] * 3), None, [None] * 3, autopilots)

    def broken(*seen: Scene) -> list[str]:
        judged = Disarmed(Disarm(target="d2", at_s=0.0))
        return [name for one in seen for name in judged.broken(1.0, one, ("d1", "d2", "d3"))]

    assert broken(scene(False), scene(True), scene(False), scene(False), scene(True), scene(True)) == ["d2"]
    assert broken(scene(False), scene(True), scene(False), scene(False)) == []
    assert broken(scene(False), scene(True), scene(True, 3.0), scene(False, 3.0)) == []


def test_at_the_end_all_that_live_and_are_not_cut_off_agree_also_those_that_never_flew() -> None:
    def told(*faults: dict[str, object], alive: bool = True) -> list[tuple[str, tuple[str, ...]]]:
        one = LiveJudge(moments.setting(*faults), [])
        ends = [_end("d1", "a", True), _end("d2", "a", True), _end("d3", "b", alive)]
        report = LiveReport(agreed=False, ready_s=1.0, world_late_s=0.0, truths_dropped=0, mesh={}, agents=tuple(ends))
        one.finish([Path("none")] * 3, report, {})
        return [(each.invariant, each.drones) for each in one.violations]

    assert told() == [("convergence", ("d1", "d2", "d3"))]
    assert told({"kind": "disarm", "target": "d3", "at_s": 0.0}) == [("convergence", ("d1", "d2", "d3"))]
    assert told({"kind": "cut", "target": "d3", "at_s": 10.0, "for_s": 9.0}) == [("convergence", ("d1", "d2", "d3"))]
    assert told({"kind": "cut", "target": "d3", "at_s": 10.0}) == []
    assert told(alive=False) == []


def _end(drone: str, digest: str, alive: bool) -> AgentEnd:
    counts = {"cones": 0, "setpoints": 0, "computed_setpoints": 0, "largest_gap_s": 0.0, "failsafes": 0}
    return AgentEnd(
        drone=drone, alive=alive, stage=Stage.LANDED, digest=digest, position_m=(1.0, 2.0, 0.0), covariance_m2=None,
        **counts, truth="world", counters={}, problems=(), problem_codes=(),
    )  # fmt: skip


def test_the_exceptions_in_a_log(tmp_path: Path) -> None:
    log = tmp_path / "agent.log"
    assert exceptions(log) == []
    text = 'Traceback (most recent call last):\n  File "a.py", line 1, in f\nIndexError: deque index out of range'
    log.write_text(json.dumps({"event": "internal error", "exception": text}) + "\n{}\n" + text + "\nafter\n")
    assert exceptions(log) == ["IndexError: deque index out of range"]
