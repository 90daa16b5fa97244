"""One flight of one drone as a value: its stage, and the state of its transitions besides telemetry and world model."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.mission.braking import Braking
from radron.agent.mission.memory import Memory
from radron.agent.mission.positionloss import PositionLoss
from radron.agent.mission.standing import StandingArmed
from radron.agent.mission.transitions import REASONS, TABLE, TO_REST, Event
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Action, Stage
from radron.protocol.stages import DESCENDING, STEERED, TAKING_PART


class Flight(Struct, frozen=True):
    """One flight, from the start command to the landing; each method returns the following value.

    ``since_ns``: begin of the stage. ``took_part_ns``: since when the drone takes part without a break; meaningless outside of
    these stages. ``started_ns``: stamp of the start command with which the swarm's mission began; 0: not known.
    ``searching_since_ns``: begin of the present search; None without one. ``stranded_since_ns``: since when a search is to end
    for want of contact, room or position. ``resume``: the stage after a hold, or once the drone has risen: the last stage flown
    by setpoints, or commanded below the floor. ``rises``: the autopilot's takeoff, or a failsafe, has ended below the floor.
    ``aborted``: by an operator; until the next start the drone only lands. ``insists``: the operator wants it home although its
    battery does not seem to last for that. ``landed_because``: why it landed, unless on request or by a pilot.
    """

    stage: Stage = Stage.PREFLIGHT
    since_ns: int = 0
    took_part_ns: int = 0
    started_ns: int = 0
    tracking_since_ns: int | None = None
    searching_since_ns: int | None = None
    stranded_since_ns: int | None = None
    resume: Stage = Stage.SURVEY
    rises: bool = False
    was_armed: bool = False
    aborted: bool = False
    insists: bool = False
    landed_because: str = ""
    position_loss: PositionLoss = PositionLoss()
    braking: Braking = Braking()
    standing: StandingArmed = StandingArmed()

    @classmethod
    def restored(cls, memory: Memory, vehicle: VehicleState, now_ns: int) -> Flight:
        """Return the flight that a restarted agent continues."""
        stage, searching_since_ns = memory.stage, memory.searching_since_ns
        return cls(
            stage=stage,
            since_ns=now_ns,
            took_part_ns=now_ns,
            started_ns=memory.started_ns,
            tracking_since_ns=memory.tracking_since_ns,
            searching_since_ns=now_ns if stage is Stage.SURVEY and searching_since_ns is None else searching_since_ns,
            resume=stage if stage in STEERED and not memory.released else memory.resume,
            was_armed=True,
            aborted=memory.aborted or stage is Stage.ABORT,  # older state files hold the stage only
            position_loss=PositionLoss.held(vehicle, now_ns) if memory.stays else PositionLoss(),
        )

    @property
    def is_rising(self) -> bool:
        """Whether the drone flies the last metres of its takeoff, or of its recovery from a failsafe, by setpoints."""
        return self.stage is Stage.TAKEOFF and self.rises

    @property
    def is_steered(self) -> bool:
        """Whether the drone flies by setpoints, unless its position cannot be trusted, or a pilot flies it."""
        return self.stage in STEERED or self.is_rising

    def searched_s(self, now_ns: int) -> float:
        """Return the duration of the present search, including holds, s; 0 before it."""
        return (now_ns - self.searching_since_ns) * 1e-9 if self.searching_since_ns is not None else 0.0

    def is_down(self, vehicle: VehicleState) -> bool:
        """Whether the vehicle is disarmed on the ground, and not about to be armed."""
        is_to_arm = self.stage is Stage.TAKEOFF and not self.rises and not self.was_armed
        return not (is_to_arm or vehicle.armed or vehicle.in_air)

    def observed(self, vehicle: VehicleState, now_ns: int, *, battery_low: bool) -> Flight:
        """Take the newest telemetry; the stage stays."""
        return replace(
            self,
            was_armed=self.was_armed or vehicle.armed,
            position_loss=self.position_loss.observed(vehicle, now_ns, battery_low=battery_low),
            braking=self.braking.observed(vehicle, now_ns),
            standing=self.standing.observed(vehicle, now_ns, comes_down=self.stage in DESCENDING),
        )

    def after(self, event: Action | Event | None, now_ns: int, vehicle: VehicleState | None, *, released: bool = False) -> Flight:
        """Take an event; without a row for this stage and event nothing changes. ``released``: to a pilot or a failsafe."""
        if event is None or (self.stage, event) not in TABLE:
            return self
        stage = TABLE[self.stage, event] or self.resume
        begins_search = stage is Stage.SURVEY and self.searching_since_ns is None
        brakes = event in TO_REST and self.stage in STEERED
        lost = self.position_loss.lands if event is Event.BLIND else None
        return replace(
            self,
            stage=stage,
            since_ns=now_ns,
            took_part_ns=self.took_part_ns if self.stage in TAKING_PART else now_ns,
            searching_since_ns=now_ns if begins_search else self.searching_since_ns,
            resume=stage if stage in STEERED and not released else self.resume,
            rises=event is Event.LOW,
            landed_because=lost or (event.value if event in REASONS else self.landed_because),
            braking=self.braking.begun(vehicle, now_ns) if brakes and vehicle is not None else self.braking,
        )
