"""The regular messages of a drone: pose, frame, source estimate and status, gathered from all its parts."""

from __future__ import annotations

from collections import Counter
from functools import partial

from msgspec import UNSET

from radron.agent.config.beyond import outside_texts
from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.proofs import Proofs
from radron.agent.localization.clocks import Clocks
from radron.agent.localization.ownpose import OwnPose
from radron.agent.localization.poseproblems import pose_problems
from radron.agent.mission.commanding import Commanding
from radron.agent.mission.executive import Executive
from radron.agent.mission.orders import Orders
from radron.agent.mission.problems import Problems
from radron.agent.mission.reporter import Believed, Outbox, Reporter
from radron.agent.mission.revoking import Revoking
from radron.agent.mission.worldmodel import WorldModel
from radron.agent.navigation.peers.newest import Peers
from radron.agent.sensing.own import OwnDetector
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.protocol.codes import Code
from radron.protocol.messages import Alternative, Failsafe, Pose, Reaction, Stage, Status
from radron.protocol.stages import FLYING
from radron.protocol.texts import MAX_NOTICES, CodedText, Texts, sendable

MISEXPOSED_NS = 30_000_000_000  # duration of the report of exposures that do not count
TURNED = (
    "{}: its cones are turned by about {:.0f} deg to the {}: check compass, mount and camera_rpy_deg (radron-agent calibrate)"
)
LEFT_OUT = "what it measures does not fit what two others measure, and is left out: its position or its detector may be wrong"
MISEXPOSED = "they are left out; its agent is faulty, or its key has been copied"


class Telling:
    """The regular messages of one drone. ``told``: the problems of the last status."""

    def __init__(
        self,
        mission: MissionConfig,
        drone: str,
        boot: str,
        outbox: Outbox,
        counters: Counter[str],
        orders: Orders,
        commanding: Commanding,
        revoking: Revoking,
        problems: Problems,
        world: WorldModel,
        own: OwnPose,
        clocks: Clocks,
        camera: OwnDetector,
        peers: Peers,
        proofs: Proofs,
        executive: Executive,
        *,
        tells_codes: bool = True,
    ) -> None:
        """``boot``: of the agent; ``counters``: of everything that is counted on board; ``tells_codes``: see ``Pilot``; the
        rest: the drone's parts.
        """
        self._id, self._mission_id, self._boot, self._outbox, self._counters = drone, mission.mission_id, boot, outbox, counters
        self._orders, self._commanding, self._revoking = orders, commanding, revoking
        self._problems, self._world, self._own, self._clocks = problems, world, own, clocks
        self._camera, self._peers, self._proofs, self._executive = camera, peers, proofs, executive
        self._reporter = Reporter(drone, mission.mission_id, mission.fusion.estimator)
        self._failsafe = Failsafe(Reaction(mission.safety.agent_lost), mission.return_height_m(drone))
        self._area, self._tells_codes = mission.area, tells_codes
        self._notices = tuple[CodedText, ...]()
        self.told = tuple[CodedText, ...]()

    def hurry(self, now_ns: int) -> None:
        """Send a status with the next report: something has changed that the others must know."""
        self._reporter.hurry(now_ns)

    def notice(self, notices: tuple[CodedText, ...]) -> None:
        """Set the shell's notices for the operator; they replace the previous ones."""
        self._notices = notices

    def tell(self, now_ns: int) -> None:
        """Put the messages due now into the outbox; a status with its signature."""
        frame, fusion = self._own.frame, self._world.fusion
        has_estimate = fusion.hypothesis is not None or fusion.contamination is not None
        believed = partial(Believed.of, fusion) if has_estimate else None
        placed = frame.mission_from_local if frame is not None else None
        stage = self._executive.remembering.stage(now_ns)
        pose_of, status_of = partial(self._pose, stage), partial(self._status, now_ns, stage)
        reports = self._reporter.due(now_ns, self._own.vehicle, placed, believed, pose_of, status_of)
        for message in map(self._clocks.utc.stamped, (*self._revoking.due(now_ns), *reports)):
            if not isinstance(message, Status):
                self._outbox.put(message)
            elif (status := self._outbox.sendable(message)) is not None:
                self._outbox.put(self._proofs.signed_status(status))

    def _pose(self, stage: Stage, vehicle: VehicleState) -> Pose:
        otherwise, home_m = self._own.otherwise, self._executive.home_m
        return Pose(
            stamp_ns=vehicle.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            position_m=vehicle.position_m,
            velocity_mps=vehicle.velocity_mps,
            quaternion=vehicle.quaternion,
            position_sigma_m=vehicle.stamped_sigma_m,
            yaw_sigma_rad=vehicle.yaw_sigma_rad,
            clock_sigma_m=vehicle.clock_sigma_m,
            steered=vehicle.mode is FlightMode.OFFBOARD,
            in_air=vehicle.in_air,
            stage=stage,
            silences_ns=self._executive.silences_ns(self._peers, vehicle.stamp_ns),
            home_m=UNSET if home_m is None else home_m,
            alternative=UNSET if otherwise is None else Alternative(otherwise.translation, otherwise.yaw_rad),
        )

    def _status(self, now_ns: int, stage: Stage) -> Status:
        vehicle, obeyed, self.told = self._own.vehicle, self._orders.obeyed, self._look(now_ns)
        notices = sendable((*self._outside(now_ns), *self._revoking.notices, *self._notices), MAX_NOTICES)
        texts = Texts(self.told, self._executive.finding, notices)
        return Status(
            stamp_ns=now_ns,
            drone=self._id,
            mission=self._mission_id,
            boot=self._boot,
            battery=vehicle.battery if vehicle is not None else None,
            stage=stage,
            counters=dict(self._counters),
            problems=tuple(map(str, texts.problems)),
            finding=str(texts.finding or ""),
            recognised=self._camera.recognised,
            delays_ns=self._clocks.delays_ns(now_ns),
            started_ns=self._executive.started_ns,
            ticket=self._orders.ticket(now_ns),
            failsafe=self._failsafe,
            notices=tuple(map(str, texts.notices)),
            upload=self._commanding.uploads.answer,
            disowns=self._problems.has_twin(now_ns) or UNSET,
            obeyed=obeyed if obeyed is not None else UNSET,
            codes=texts.codes if self._tells_codes and any(texts) else UNSET,
        )

    def _look(self, now_ns: int) -> tuple[CodedText, ...]:
        """All problems, found anew."""
        flying = self._executive.stage in FLYING
        posed = pose_problems(self._id, self._own, self._clocks, self._world.frames, now_ns, flying)
        entries = *self._proofs.problems(now_ns), *self._world.problems(now_ns), *self._contradictions(now_ns)
        seen = (*self._peers.problems(now_ns), *posed, *entries, *self._camera.problems(now_ns))
        flown = self._executive.problems(now_ns)
        return self._problems.all(flown, self._commanding.against_start(now_ns, self._peers.statuses(now_ns)), seen)

    def _outside(self, now_ns: int) -> list[CodedText]:
        """A line for each source beyond the fence, tracked or met by the search: the drones cannot circle it."""
        hypothesis, outlook = self._world.fusion.hypothesis, None
        if self._executive.stage is Stage.SURVEY:
            outlook = self._executive.prospect.at(now_ns)
        tracked = () if hypothesis is None else (hypothesis, *hypothesis.others)
        places = [(float(source.position[0]), float(source.position[1])) for source in tracked]
        if outlook is not None and outlook.beyond is not None:
            places.append(outlook.beyond)
        return outside_texts(self._area, places)

    def _contradictions(self, now_ns: int) -> list[CodedText]:
        """Return a line for each drone, this one included, with contradictory measurements or impossible exposures."""
        hypothesis, log = self._world.fusion.hypothesis, self._world.fusion.log
        misexposed = [
            CodedText(Code.EXPOSURES_LEFT_OUT, f"{drone}: its exposures {why}: {MISEXPOSED}", drone)
            for drone, why in log.misexposed(self._clocks.utc.of(now_ns - MISEXPOSED_NS))
        ]
        if hypothesis is None:
            return misexposed
        turned = [
            CodedText(Code.CONES_TURNED, TURNED.format(drone, abs(deg), "left" if deg > 0.0 else "right"), drone)
            for drone, deg in hypothesis.turned_deg.items()
        ]
        left_out = (CodedText(Code.MEASUREMENTS_LEFT_OUT, f"{drone}: {LEFT_OUT}", drone) for drone in hypothesis.contradicted)
        return [*misexposed, *left_out, *turned]
