"""The estimator's part of the mission file: its kind and parameters."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from radron.agent.config.section import Activity, Coordinate, NonNegative, Positive, Section
from radron.protocol.units import Identifier


class PaperEstimatorConfig(Section, frozen=True, kw_only=True):
    """Parameters of estimator ``paper``, the linear Kalman filter of the paper (Sec. IV-B).

    ``order``: which of a cone's two clusters was the electron is not measured; the choice is the smaller scattering angle
    (``forward``) or the larger probability (``probable``).
    """

    process_noise_m2ps: Positive = 2.0  # q
    measurement_variance_m2: Positive = 100.0  # rho
    cross_axis_factor: Positive = 1e4
    initial_cones: Annotated[int, Meta(ge=3, le=1000)] = 10  # M
    initial_baseline_m: NonNegative = 2.0  # between the apexes of the M cones
    initial_variance_m2: Positive = 100.0
    order: Literal["forward", "probable"] = "forward"


class BayesEstimatorConfig(Section, frozen=True, kw_only=True):
    """Parameters of the Bayesian estimator: priors of the source and of the vehicles' pose errors, and thresholds.

    ``background_per_s``: events per second of a camera without a source, measured where the drones start (``radron-agent
    calibrate``); none: by the built-in tables.
    """

    later: ClassVar[frozenset[str]] = frozenset({"background_per_s"})

    grid_s: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.1
    activity_bq: tuple[Activity, Activity] = (3e7, 3e12)  # up to the sources of industrial radiography and teletherapy
    activity_levels: Annotated[int, Meta(ge=2, le=64)] = 12
    velocity_mps: Positive = 0.7  # of a moving source: 1 sigma of each axis
    velocity_s: Positive = 300.0  # correlation time of that velocity
    fast_velocity_mps: Positive = 2.0  # of a fast source: 1 sigma of each axis
    fast_velocity_s: Positive = 5.0
    hurry_ps: Positive = 0.003  # rate of changes between moving and fast
    switch_ps: Positive = 0.00005  # rate of starts and stops
    bias_drift_m: NonNegative = 0.03  # random walk of a vehicle's position error, 1 sigma after a second
    bias_yaw_drift_deg: NonNegative = 0.3
    gain_sigma: NonNegative = 0.05  # relative sensitivity of a camera against the others, 1 sigma
    gain_drift: NonNegative = 0.003
    cell_m: Annotated[float, Meta(ge=0.5, le=100.0)] = 2.5  # least cell size of the search grid
    most_cells: Annotated[int, Meta(ge=16, le=100_000)] = 4096
    background_per_s: Annotated[float, Meta(ge=0.1, le=1000.0)] | None = None
    background_levels: Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=16)] = (0.8, 1.0, 1.25, 1.55, 1.95)
    background_sigma: Positive = 0.3  # of the logarithm of the ratio between actual and expected background
    motion_prior: tuple[Positive, Positive, Positive] = (0.5, 0.3, 0.2)  # at rest, moving, moving fast
    search_diffusion_m2ps: tuple[Positive, Positive] = (2.0, 20.0)  # of a moving source and of a fast one during the search
    declared_rms_m: Positive = 3.5  # largest posterior RMS at which the source is declared found
    given_up_rms_m: Positive = 7.0  # posterior RMS above which the track is given up: the search starts again from the posterior
    doubt: Annotated[float, Meta(gt=0.0, lt=1.0)] = 1e-3  # largest probability of no source at which the source is declared found


class SourcesEstimatorConfig(Section, frozen=True, kw_only=True):
    """Parameters of estimator ``sources``, which estimates several sources at rest."""

    most: Annotated[int, Meta(ge=1, le=6)] = 6  # sources
    activity_bq: tuple[Activity, Activity] = (1e6, 1e13)
    gain_sigma: Positive = 0.05  # relative sensitivity of a camera against the others, 1 sigma
    area_sigma: NonNegative = 0.08  # relative, of the tabulated areas: flown with Cs-137 alone, where they are 1 to 5 % off
    refined_s: Annotated[float, Meta(ge=0.5, le=60.0)] = 2.0  # time between two refinements
    moved_s: Annotated[float, Meta(ge=0.5, le=600.0)] = 10.0  # time between two searches for further sources
    least_gain: NonNegative = 3.0  # of log evidence, by a further source
    declared_rms_m: Positive = 3.5  # largest posterior RMS at which a source is reported


class FieldEstimatorConfig(Section, frozen=True, kw_only=True):
    """Parameters of estimator ``field``, which maps contaminated ground."""

    background_sigma: Positive = 0.3  # of the logarithm of the ratio between actual and expected background
    gain_sigma: Positive = 0.05  # relative sensitivity of a camera, 1 sigma


class GivenHypothesisConfig(Section, frozen=True, kw_only=True):
    """A source estimate that is not measured but moves by a schedule: ``[[t_s, x, y], ...]``, for tests of the flight.

    Times in s from the mission's start, positions in m in the mission frame.
    """

    schedule: Annotated[tuple[tuple[NonNegative, Coordinate, Coordinate], ...], Meta(min_length=1, max_length=1000)]


class FusionConfig(Section, frozen=True, kw_only=True):
    """The choice of the estimator that locates the source from all measurements, its parameters, and its time steps
    (``grid_s``).
    """

    later: ClassVar[frozenset[str]] = frozenset(
        {"sources", "ground", "field"}
    )  # no part of a mission's id while they have their defaults

    estimator: Identifier = "bayes"  # paper, paper-geometric, bayes, sources, field, given, or one of an installed package
    grid_s: Annotated[float, Meta(ge=0.05, le=10.0)] = 0.5
    # Below the sources: soil scatters photons, and sends out some of its own. Missions for real grounds state "soil". The default
    # remains the meaning of missions and flight records without this key: they are older, and keep their ids.
    ground: Literal["none", "soil"] = "none"
    paper: PaperEstimatorConfig = PaperEstimatorConfig()
    bayes: BayesEstimatorConfig = BayesEstimatorConfig()
    sources: SourcesEstimatorConfig = SourcesEstimatorConfig()
    field: FieldEstimatorConfig = FieldEstimatorConfig()
    given: GivenHypothesisConfig | None = None
