"""Python interface for scripts and notebooks: load a scenario, fly it, inspect the posterior, compare estimators, draw figures.

The functions and types here, with ``radron.sim.result.RunResult`` and ``radron.sim.result.Trace``, are a stable interface; the
rest of the package may change without notice. An example: ``docs/notebooks/first-flight.ipynb``.

    from radron.sim import api

    scenario = api.load("demo", {"mission.track.duration_s": 20})
    flight = api.fly(scenario, seed=3, listen=["paper"])
    print(api.summary(flight))
    print(flight.result.error_median_m, flight.posteriors["bayes"][-1].rms_m)
    api.figures(flight)["map"].savefig("map.png")

Errors in the input are raised as ``radron.agent.errors.ConfigError``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from radron.agent.errors import ConfigError
from radron.sim.geometry import Array
from radron.sim.lockstep.flight import fly as _fly
from radron.sim.lockstep.world import TICK_NS
from radron.sim.result import Flight, RunResult, Trace
from radron.sim.scenario import Scenario, load_scenario, override, shipped
from radron.sim.scoring.moment import EPOCH_NS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from radron.sim.scoring.moment import Moment

__all__ = ["Flown", "Posterior", "compare", "figures", "fly", "load", "save", "scenarios", "summary"]


@dataclass(frozen=True, slots=True)
class Posterior:
    """The probability distribution of the source's horizontal position at one instant, as an estimator computed it.

    Coordinates are in the mission frame (east, north). The distribution consists of C components (grid cells or Gaussians).

    Attributes:
        time_s: time of the posterior since the start of the simulation (as ``Trace.time_s``).
        kind: ``grid``: cells, while the estimator ``bayes`` searches; ``sum``: a Gaussian sum, while it tracks; ``gaussian``: a
            mean and a covariance, from other estimators.
        position_m: (C, 2) centres of the components.
        weight: (C,) probabilities of the components, adding up to 1 - ``none``.
        covariance_m2: (C, 2, 2) covariance of each component; for a grid cell, the covariance of a square of side a, a^2 / 12 per
            axis.
        none: probability that there is no source.
    """

    time_s: float
    kind: Literal["grid", "sum", "gaussian"]
    position_m: Array
    weight: Array
    covariance_m2: Array
    none: float

    @property
    def mean_m(self) -> Array:
        """Mean position of the source (east, north), given that there is a source."""
        mean: Array = self._share @ self.position_m
        return mean

    @property
    def covariance(self) -> Array:
        """(2, 2) covariance of the source's position in m2, given that there is a source.

        It includes the spread within each component and between the components.
        """
        offset = self.position_m - self.mean_m
        spread: Array = np.einsum("c,cij->ij", self._share, self.covariance_m2 + offset[:, :, None] * offset[:, None, :])
        return spread

    @property
    def rms_m(self) -> float:
        """Root mean square distance of the source from the mean position, in metres: the root of the covariance's trace."""
        return math.sqrt(max(0.0, float(np.trace(self.covariance))))

    @property
    def _share(self) -> Array:
        share: Array = self.weight / self.weight.sum()
        return share


@dataclass(frozen=True, slots=True)
class Flown:
    """A finished simulated flight, with its scores, time series and posterior distributions.

    Attributes:
        scenario: the scenario flown.
        result: scores of the whole flight, for the estimator that determined where to fly.
        listened: scores of the estimators that only listened (read the log without any influence on the flight), by name.
        trace: time series at 5 Hz.
        posteriors: by estimator, the posteriors of the first drone in order of time, from the first one available.
    """

    scenario: Scenario
    result: RunResult
    listened: dict[str, RunResult]
    trace: Trace
    posteriors: dict[str, list[Posterior]]


def scenarios() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return shipped()


def load(scenario: str | Path, overrides: Mapping[str, str | float] | None = None) -> Scenario:
    """Load a scenario: a mission, and the true sources, sensors and vehicles for its simulation.

    Args:
        scenario: name of a shipped scenario, or the path of a ``.toml`` file.
        overrides: values to change, by dotted path as ``--set`` takes them: ``{"mission.encirclement.radius_m": 10}``, or one of
            the short names ``radius_m``, ``speed_mps``, ``activity_bq``, ``source_speed_mps``, ``drones`` (number of drones).

    Raises:
        ConfigError: unknown scenario, key or value; the message says what is allowed.
    """
    return override(load_scenario(str(scenario)), overrides or {})


def fly(
    scenario: Scenario | str,
    seed: int = 1,
    *,
    estimator: str | None = None,
    law: str | None = None,
    listen: Sequence[str] = (),
    every_s: float = 1.0,
    progress: Callable[[float, str], None] | None = None,
) -> Flown:
    """Simulate one flight of a scenario in this process, many times faster than real time; the same seed gives the same flight.

    Args:
        scenario: a loaded scenario, or a name or path for ``load``.
        seed: seed of all randomness of the flight, 0 or more.
        estimator: estimator to fly by instead of the mission's own; may be one of an installed package.
        law: flocking law (rule for the spacing of the drones on their circle), ``paper`` or ``smooth``, instead of the mission's
            own.
        listen: estimators that read the same log on the first drone without any influence on the flight.
        every_s: interval between two recorded posteriors, seconds.
        progress: called about every simulated second with the time (s) and the swarm's stage.

    Raises:
        ConfigError: an unknown scenario, estimator or law, a negative seed, or ``every_s`` that is not positive.
    """
    if seed < 0 or not every_s > 0.0:
        raise ConfigError(f"seed = {seed}, every_s = {every_s:g}: give a seed of 0 or more, and every_s above 0")
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    watch = _Watch(max(1, round(every_s * 1e9 / TICK_NS)))
    flight = _fly(chosen, seed, estimator, listen, law, progress, watch)
    return Flown(chosen, flight.result, flight.listened, flight.trace, watch.posteriors)


def compare(flight: Flown) -> dict[str, dict[str, float | None]]:
    """Compare the estimators of one flight; return the scores by the estimator's name.

    All estimators have read the same cones and counts from the same places, but only the first one determined where to fly.
    Scores, None if there was no estimate: ``time_to_x0_s`` (time to the first estimate), ``error_median_m``, ``error_p90_m``,
    ``nees_mean`` (normalised squared error; 2 if the stated uncertainty matches the error).
    """
    fields = ("time_to_x0_s", "error_median_m", "error_p90_m", "nees_mean")
    results = {flight.result.estimator: flight.result, **flight.listened}
    return {name: {field: getattr(result, field) for field in fields} for name, result in results.items()}


def summary(flight: Flown) -> str:
    """Return one sentence about the flight: the source estimate, its 1-sigma radius, and its distance from the true source."""
    from radron.sim.campaign.report import sentence  # noqa: PLC0415  (Matplotlib waits until it is needed)

    return sentence(flight.result, flight.trace)


def figures(flight: Flown) -> dict[str, Figure]:
    """Return the standard figures of a flight as Matplotlib figures, by name.

    They are ``map`` and ``spacing`` (gaps between the drones on their circle); with a source also ``error`` and ``posterior``;
    with several sources also ``sources``.
    """
    from radron.sim.campaign.report import flight_figures  # noqa: PLC0415

    return flight_figures(_as_flight(flight))


def save(flight: Flown, folder: str | Path) -> list[Path]:
    """Write ``result.json`` and the standard figures of a flight into a folder, and return the files.

    ``radron-sim run --out`` writes these files, too.

    Raises:
        ConfigError: the folder cannot be made or written to.
    """
    from radron.sim.campaign.report import write_flight  # noqa: PLC0415
    from radron.sim.runfile import make_folder  # noqa: PLC0415

    make_folder(Path(folder))
    return write_flight(Path(folder), _as_flight(flight))


def _as_flight(flight: Flown) -> Flight:
    return Flight(flight.result, flight.trace, flight.listened)


class _Watch:
    """Records the first drone's posteriors every ``ticks`` ticks."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks
        self._seen = 0
        self.posteriors: dict[str, list[Posterior]] = {}

    def __call__(self, moment: Moment) -> bool:
        self._seen += 1
        first = moment.pilots[0]
        if self._seen % self._ticks or first is None:
            return False
        for name, found in first.posteriors(EPOCH_NS + round(moment.time_s * 1e9)).items():
            at_s = (found.stamp_ns - EPOCH_NS) * 1e-9
            taken = Posterior(at_s, found.kind, found.position, found.weight, found.covariance, found.none)
            self.posteriors.setdefault(name, []).append(taken)
        return False
