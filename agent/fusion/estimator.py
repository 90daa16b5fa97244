"""The interface of the estimators, and their results: the source estimate and the posterior of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from radron.agent.fusion.observation import Observation
from radron.agent.geometry import Point2
from radron.protocol.contamination import Contamination
from radron.protocol.entries import AnyEntry

S = TypeVar("S")


class GridStep(Struct, frozen=True):
    """One step of the fixed time grid of an estimator: [start_ns, end_ns) UTC; start_ns = index times the step width."""

    index: int
    start_ns: int
    end_ns: int

    @property
    def middle_ns(self) -> int:
        """Time in the middle of this step of the time grid (UTC, ns)."""
        return (self.start_ns + self.end_ns) // 2


def _horizontal_rms_m(covariance: NDArray[np.float64]) -> float:
    return math.sqrt(max(0.0, float(covariance[0, 0] + covariance[1, 1])))


class Sight(Struct, frozen=True, eq=False):
    """The apparent place of the source for one drone: relative to the drone's own, biased position. Mission frame.

    The drone's bias b (measured minus true position) shifts its own position and its measurements of the source alike. So the
    apparent place y = x + b has a smaller covariance than the true place x, and is the drone's target. position: (3,) metres.
    covariance: (3, 3) m2.
    """

    position: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def rms_m(self) -> float:
        """Horizontal 1-sigma radius of the apparent place, sqrt(P_xx + P_yy), metres."""
        return _horizontal_rms_m(self.covariance)


class Hypothesis(Struct, frozen=True, eq=False):
    """The estimate of the source by which the drones fly ("hypothesis" in the paper), at ``stamp_ns``, mission frame.

    position: (3,) metres. covariance: (3, 3) m2. velocity: (3,) m/s. cones: number of cones used. x0_stamp_ns: time at which the
    first estimate was declared. activity_bq, activity_sigma_bq: None if the estimator does not estimate the activity. evidence:
    log Bayes factor of a source against background alone; None if the estimator does not compute it: then ``covariance`` is the
    filter's own, and need not match the actual error. sights: the apparent place by drone; empty if the estimator has no pose
    biases. nuclide: None if the estimator assumes the mission's, or for an unknown nuclide. lines_kev: for an unknown nuclide the
    energies of the lines in its spectrum, ascending; otherwise None. others: further sources, in the order of their importance.
    watched_s: live time of all cameras on or inside the circle around this source, with a share of the live time farther out;
    None if the estimator reports one source only. look: for a source reported at rest that may move, its place if it moves; the
    drones verify it before they continue. contradicted: ids of drones whose measurements are left out, as they contradict the
    other drones' measurements. turned_deg: by drone, the angle by which its camera is certainly turned to the left on the
    vehicle. The arrays are read-only.
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
        """Horizontal 1-sigma radius of the source's position, sqrt(P_xx + P_yy), metres."""
        return _horizontal_rms_m(self.covariance)

    def sight_of(self, drone: str) -> Sight:
        """Return the apparent place of the source for a drone; the estimate itself if the drone's bias is not estimated."""
        return self.sights.get(drone) or Sight(self.position, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class Exclusion:
    """Upper limits of a search for several sources: for further sources beside those found, over C cells of the area.

    limits_bq: by nuclide, the activity above which a further source is excluded in all of the area except the glare; None: no
    limit yet. left: (C,) mask of cells that may hold a source of the least searched activity, where more measurements would
    decide. glare: (C,) mask of cells near found sources, which outshine a further source.
    """

    limits_bq: Mapping[str, float | None]
    left: NDArray[np.bool_]
    glare: NDArray[np.bool_]

    @property
    def known_bq(self) -> dict[str, float]:
        """The excluded activities (Bq) of the nuclides for which there is a limit."""
        return {nuclide: limit_bq for nuclide, limit_bq in self.limits_bq.items() if limit_bq is not None}


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """The posterior of a search: how probable a source is in each of C cells of the area, while no source is declared. Mission
    frame.

    A search for several sources continues beside declared sources: it is for one more source of the least searched activity.

    places: (C, 2) centres of the cells, which are squares along the axes, and cell_m: (C,) their sizes, metres. inside: (C,) mask
    of cells in the area. weight: (C,) P(source in the cell), adding up to 1 - ``none``. activity_bq: (C,) geometric mean of the
    activity given a source in the cell. none: P(no source). excluded_bq: activity above which a source is excluded, in the mean
    over the possible places; None: no limit yet. exclusion: of an estimator of several sources; then ``excluded_bq`` is the
    largest of its limits. lead: the search for a source with some measurements, but too few for a report: it has priority.
    beyond: mean place (m) of a source beyond the fence, if that is more probable than all else.
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
    """Interface of the estimators, which locate the source from the observations of all drones.

    An estimator consists of pure functions on an immutable state ``S``: results depend on the arguments alone, with no clock, no
    random state and no memory of earlier calls. Then the estimate is a function of the log, and a late measurement is included by
    a repetition (replay) from an earlier state.
    """

    name: str
    reads: tuple[type[AnyEntry], ...]  # the kinds of entries that it uses
    grid_s: float | None  # step width of its time grid; None: the mission's
    hold_s: float  # lag behind now, so that most entries arrive before their step is computed

    def initial(self, start_ns: int | None) -> S:
        """Return the estimator's state before the first observation. ``start_ns``: the mission's start, None if it is
        not known.
        """

    def step(self, state: S, step: GridStep, observations: Sequence[Observation]) -> S:
        """Return the estimator's state after a step of the time grid, with the step's observations in the order of their entries'
        identities.

        Called in ascending order, only for steps with observations. The estimator itself accounts for the empty steps between
        (process noise, motion), and may not depend on the present time.
        """

    def work(self, state: S, observations: int) -> int:
        """Return the cost of a step from this state of the estimator with so many observations, in units of about 25
        microseconds.
        """

    def hypothesis(self, state: S, step: GridStep) -> Hypothesis | None:
        """Return the source estimate of an estimator's state, predicted to ``step``, the interval that contains the present time.

        Return None without an estimate. ``step``: not before the last observation's step; shifted by ``hold_s`` against the grid.
        """

    def outlook(self, state: S, step: GridStep) -> Outlook | None:
        """Return the posterior of a search for a source, from the estimator's state.

        Return None if the state has a source estimate (but see ``Outlook``), or the estimator does not search.
        """


@runtime_checkable
class Mapper(Protocol):
    """An estimator that also maps contaminated ground."""

    def contamination(self, state: Any, step: GridStep) -> Contamination | None:
        """Return the map of contaminated ground of an estimator's state; None before there is one."""


def contamination_of(estimator: Estimator[S], state: S, step: GridStep) -> Contamination | None:
    """Return the map of contaminated ground of an estimator's state; None if there is none, or the estimator makes none."""
    return estimator.contamination(state, step) if isinstance(estimator, Mapper) else None
