"""State for an agent that is restarted in flight: small enough to be written at every change."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.frames.kept import KeptFrame
from radron.agent.geometry import Vector3
from radron.agent.navigation.home import KeptHome, Launch
from radron.agent.navigation.identification import FoundResponse
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Stage
from radron.protocol.stages import DESCENDING, ON_GROUND

REFRESH_NS = 5_000_000_000
OLDEST_NS = 120_000_000_000  # after this long the vehicle is down, or on another flight
_FROM_THE_GROUND = (Stage.TAKEOFF, *DESCENDING)


class Memory(Struct, frozen=True, kw_only=True):
    """A drone that flies the mission, as of ``stamp_ns`` (in whole ``REFRESH_NS``: equal states are not written again); on the
    ground ``copied`` alone, without a stamp. All times are own time of the agent, except stamps of the log: ``started_ns``, and
    in ``launch``; UTC is ahead of it by ``ahead_ns``.

    ``started_ns``: stamp of the start command, or 0; ``home_m``: where a return leads, mission frame; None if not known;
    ``home_sigma_m``, ``launch``: as in ``KeptHome``. ``searching_since_ns``: when the present search began; None without a
    search. ``resume``: the stage after a hold, or once the drone has risen. ``released``: a pilot, a ground station or a failsafe
    flies the vehicle. ``aborted``: an operator has ended the flight. ``stays``: this agent has it hold, because its position
    cannot be trusted. ``holds``: a hold that the autopilot shows is this agent's own in any case: it has had no telemetry for a
    while, or offboard has not been reached since the drone was to be steered, or to land, or to be steered again.
    ``epoch_offset``: the number of epochs added to the vehicle's own; ``epoch``: the present one, these included, so that the
    frame of a new one is stored at once. ``response``: the identified response of the vehicle. ``frames``: of all drones whose
    frames the mission does not give, by id. ``copied``: the revoked drones whose keys have shown to be copied. ``others``: the
    last messages of the flying drones, by id.
    """

    mission: str
    stamp_ns: int
    started_ns: int
    stage: Stage
    resume: Stage
    released: bool = False
    aborted: bool = False
    stays: bool = False
    holds: bool = False
    tracking_since_ns: int | None = None
    searching_since_ns: int | None = None
    home_m: Vector3 | None = None
    home_sigma_m: float | None = None
    launch: Launch | None = None
    epoch_offset: int = 0
    epoch: int = 0
    response: FoundResponse | None = None
    frames: dict[str, KeptFrame] = {}
    copied: tuple[str, ...] = ()
    others: dict[str, LastNews] = {}
    ahead_ns: int = 0

    def in_utc(self) -> Memory:
        """Return the same with all times in UTC, which is own time of the agent that continues the flight."""
        by_ns = self.ahead_ns
        if by_ns == 0:
            return self
        return replace(
            self,
            ahead_ns=0,
            stamp_ns=self.stamp_ns + by_ns,
            tracking_since_ns=None if self.tracking_since_ns is None else self.tracking_since_ns + by_ns,
            searching_since_ns=None if self.searching_since_ns is None else self.searching_since_ns + by_ns,
            frames={name: replace(one, stamp_ns=one.stamp_ns + by_ns) for name, one in self.frames.items()},
            others={name: one.moved(by_ns) for name, one in self.others.items()},
        )

    @property
    def home(self) -> KeptHome:
        """The destination of a return."""
        return KeptHome(self.home_m, self.home_sigma_m, self.launch)

    @property
    def flies(self) -> bool:
        """Whether it is of a flight."""
        return self.stage not in ON_GROUND

    def is_recent(self, mission: str, now_ns: int) -> bool:
        """Whether this flight of that mission may still continue."""
        return self.mission == mission and abs(now_ns - self.stamp_ns) <= OLDEST_NS

    def fits(self, mission: str, vehicle: VehicleState) -> bool | None:
        """Whether the telemetry shows that this flight continues; None: undecided yet (armed, but not in the air)."""
        if not vehicle.armed or not self.is_recent(mission, vehicle.stamp_ns):
            return False
        return True if vehicle.in_air or self.stage in _FROM_THE_GROUND else None
