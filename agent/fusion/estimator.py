"""The interface of the estimators, and their results: the source estimate and the posterior of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from agent.fusion.observation import Observation
from agent.geometry import Point2
from protocol.entries import AnyEntry

S = TypeVar("S")


class GridStep(Struct, frozen=True):
    """One step of the fixed time grid: [start_ns, end_ns) UTC; start_ns = index times the step width."""

    index: int
    start_ns: int
    end_ns: int

    @property
    def middle_ns(self) -> int:
        """The middle of the step."""
        return (self.start_ns + self.end_ns) // 2


def _horizontal_rms_m(covariance: NDArray[np.float64]) -> float:
    return math.sqrt(max(0.0, float(covariance[0, 0] + covariance[1, 1])))


class Sight(Struct, frozen=True, eq=False):
    """The apparent place of the source for a drone: relative to its own, biased localisation. Mission frame, as if the drone's
    poses were true.

    The drone's bias (measured minus true) shifts its own position and its view of the source alike. So the apparent place y = x +
    b has a smaller covariance than the true place x, and is the drone's target. position: (3,) metres. covariance: (3, 3) m2.
    """

    position: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def rms_m(self) -> float:
        """Horizontal 1-sigma radius, sqrt(P_xx + P_yy), metres."""
        return _horizontal_rms_m(self.covariance)


class Hypothesis(Struct, frozen=True, eq=False):
    """The source estimate ("hypothesis" in the paper) at ``stamp_ns``, mission frame. The arrays are read-only.

    position: (3,) metres. covariance: (3, 3) m2. velocity: (3,) m/s. cones: number of cones used. x0_stamp_ns: time at which the
    initial estimate was declared. activity_bq, activity_sigma_bq: None if the estimator does not estimate the activity. evidence:
    log Bayes factor of a source against background alone; None if the estimator does not compute it: then ``covariance`` is the
    filter's own, and need not match the actual error. sights: the apparent place by drone; empty if the estimator has no pose
    biases. nuclide: None if the estimator assumes the mission's, or for an unknown nuclide. lines_kev: for an unknown nuclide the
    energies of the lines in its spectrum, ascending; otherwise None. others: further sources, in the order of their importance.
    watched_s: live time of all cameras on or inside the circle around this source, with a share of the live time farther out;
    None if the estimator reports one source only. look: for a source reported at rest that may move, its place if it moves; the
    drones verify it before they continue. contradicted: ids of drones whose measurements are left out, as they contradict the
    other drones' measurements. turned_deg: by drone, the certain turn of its cones to the left of its heading.
    """

    stamp_ns: int
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    velocity: NDArray[np.float64]
    cones: int
    x0_stamp_ns: int
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    evidence: float | None = None
    sights: Mapping[str, Sight] = field(default_factory=dict)
    nuclide: str | None = None
    lines_kev: tuple[int, ...] | None = None
    others: tuple[Hypothesis, ...] = ()
    watched_s: float | None = None
    look: Hypothesis | None = None
    contradicted: tuple[str, ...] = ()
    turned_deg: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for array in (self.position, self.covariance, self.velocity):
            array.setflags(write=False)

    @property
    def rms_m(self) -> float:
        """Horizontal 1-sigma radius, sqrt(P_xx + P_yy), metres."""
        return _horizontal_rms_m(self.covariance)

    def sight_of(self, drone: str) -> Sight:
        """The apparent place of the source for a drone; the hypothesis itself if the drone's bias is not estimated."""
        return self.sights.get(drone) or Sight(self.position, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class Exclusion:
    """The exclusion by a search for several sources, beside the sources that it has found.

    limits_bq: by nuclide, the exclusion limit of the activity in all of the area but the glare; None: no limit yet. left: (C,)
    cells that may hold a source of the least searched activity, where more measurements would decide. glare: (C,) cells near
    found sources, which outshine a further source.
    """

    limits_bq: Mapping[str, float | None]
    left: NDArray[np.bool_]
    glare: NDArray[np.bool_]

    @property
    def known_bq(self) -> dict[str, float]:
        """The limits of the nuclides that have one."""
        return {nuclide: limit_bq for nuclide, limit_bq in self.limits_bq.items() if limit_bq is not None}


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """The posterior of a search, while no hypothesis is declared. Mission frame.

    A search for several sources continues beside declared hypotheses: it is for one more source of the least searched activity.
    places: (C, 2) centres of the cells, which are squares along the axes, and cell_m: (C,) their sizes, metres. inside: (C,)
    cells in the area. weight: (C,) P(source in the cell), adding up to 1 - ``none``. activity_bq: (C,) geometric mean of the
    activity given a source in the cell. none: P(no source). excluded_bq: exclusion limit of the activity, in the mean over the
    possible places; None: no limit yet. exclusion: of an estimator of several sources; then ``excluded_bq`` is the largest of its
    limits. lead: the search for a source with some measurements, but too few for a report: it has priority. beyond: mean place
    (m) of a source beyond the fence, if that is more probable than all else.
    """

    places: NDArray[np.float64]
    cell_m: NDArray[np.float64]
    inside: NDArray[np.bool_]
    weight: NDArray[np.float64]
    activity_bq: NDArray[np.float64]
    none: float
    excluded_bq: float | None
    exclusion: Exclusion | None = None
    lead: Outlook | None = None
    beyond: Point2 | None = None


class Estimator(Protocol, Generic[S]):
    """Observations to hypothesis, as pure functions on an immutable state ``S``.

    Results depend on the arguments alone: no clock, no random state, no memory of earlier calls. Then the hypothesis is a
    function of the log, and a late entry is merged by a replay from an earlier state.
    """

    name: str
    reads: tuple[type[AnyEntry], ...]  # the kinds of entries that it uses
    grid_s: float | None  # step width of its time grid; None: the mission's
    hold_s: float  # lag behind now, so that most entries arrive before their step is computed

    def initial(self, start_ns: int | None) -> S:
        """Return the state before the first observation. ``start_ns``: the mission's start, None if it is not known."""

    def step(self, state: S, step: GridStep, observations: Sequence[Observation]) -> S:
        """Return the state after a grid step with observations (in the order of their entries' identities).

        Called in ascending order, for such steps only. The estimator itself accounts for the empty steps between (process noise,
        motion), and may not depend on now.
        """

    def work(self, state: S, observations: int) -> int:
        """Return the cost of a step from this state with so many observations, in units of about 25 microseconds."""

    def hypothesis(self, state: S, step: GridStep) -> Hypothesis | None:
        """Return the source estimate of the state, predicted to ``step``, the interval of now.

        ``step``: not before the last observation's step; shifted by ``hold_s`` against the grid.
        """

    def outlook(self, state: S, step: GridStep) -> Outlook | None:
        """Return the posterior of a search; None if the state has a hypothesis (but see ``Outlook``), or for lack of a search."""
