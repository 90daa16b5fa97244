"""Estimators by name, as in commands and the mission file: this package's, and installed packages'.

Another package adds an estimator by an entry point of the group ``radron.estimators``. Its name is the estimator's, its object a
callable that takes a ``MissionConfig`` and returns an ``Estimator``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.plugins import entry_point, made

if TYPE_CHECKING:
    from radron.agent.fusion.estimator import Estimator
    from radron.agent.fusion.paper import PaperEstimator
    from radron.agent.fusion.projection import Rule

Estimators = Callable[[str, MissionConfig], "Estimator[Any]"]  # as ``estimator_named``
_MEMBERS = ("name", "reads", "grid_s", "hold_s", "initial", "step", "work", "hypothesis", "outlook")


def estimator_named(name: str, mission: MissionConfig) -> Estimator[Any]:
    """Make the estimator of that name for a mission.

    - ``paper``: the paper's filter, with the projection rule as printed.
    - ``paper-geometric``: the paper's filter with the geometrically correct rule.
    - ``bayes``: the posterior from cones and counts, at rest or moving, with the poses' biases.
    - ``sources``: several sources at rest, of unknown number and nuclides, or a moving one, from spectra and cones.
    - ``field``: contaminated ground of one nuclide, from counts.
    - ``given``: the schedule of fusion.given.
    - any other: of an installed package.

    Raises:
        ConfigError: no such estimator, the mission lacks a required part, or the installed object is no estimator.
    """
    maker = _MAKERS.get(name)
    if maker is not None:
        return maker(mission)
    point = entry_point("estimator", name, "fusion.estimator", ESTIMATORS)
    estimator: Estimator[Any] = made("estimator", point, mission, _MEMBERS)
    return estimator


def check_estimator(name: str, where: str) -> None:
    """Raise ConfigError, whose text names ``where``, if no estimator has that name; nothing is imported for the check."""
    if name not in _MAKERS:
        entry_point("estimator", name, where, ESTIMATORS)


def deferred_named(name: str, mission: MissionConfig) -> Estimator[Any]:
    """Make the estimator for a process that cannot wait: a slow estimator is replaced by one that is computed in another
    process.
    """
    estimator = estimator_named(name, mission)
    if name not in _SLOW:
        return estimator
    from radron.agent.fusion.deferred import Deferred  # noqa: PLC0415  names are checked before anything heavy is imported

    return Deferred(estimator)


def _paper(mission: MissionConfig, rule: Rule, name: str) -> PaperEstimator:
    from shapely import Polygon  # noqa: PLC0415  names are checked before anything heavy is imported

    from radron.agent.fusion.initial import InitialSearch  # noqa: PLC0415
    from radron.agent.fusion.paper import PaperEstimator  # noqa: PLC0415
    from radron.agent.terrain.ground import Ground  # noqa: PLC0415

    ground = Ground.from_config(mission)
    return PaperEstimator(mission.fusion.paper, InitialSearch(Polygon(mission.area.polygon_m), ground), rule, name)


def _bayes(mission: MissionConfig) -> Estimator[Any]:
    from shapely import Polygon  # noqa: PLC0415

    from radron.agent.fusion.bayes.estimator import BayesEstimator  # noqa: PLC0415  other estimators save its memory

    return BayesEstimator(mission, Polygon(mission.area.polygon_m))


def _sources(mission: MissionConfig) -> Estimator[Any]:
    from shapely import Polygon  # noqa: PLC0415

    from radron.agent.fusion.sources.handover import FollowingEstimator  # noqa: PLC0415

    return FollowingEstimator(mission, Polygon(mission.area.polygon_m))


def _field(mission: MissionConfig) -> Estimator[Any]:
    from shapely import Polygon  # noqa: PLC0415

    from radron.agent.fusion.field.estimator import FieldEstimator  # noqa: PLC0415

    return FieldEstimator(mission, Polygon(mission.area.polygon_m))


def _given(mission: MissionConfig) -> Estimator[Any]:
    from radron.agent.fusion.given import GivenEstimator  # noqa: PLC0415
    from radron.agent.terrain.ground import Ground  # noqa: PLC0415

    if mission.fusion.given is None:
        raise ConfigError("estimator 'given' needs fusion.given.schedule in the mission")
    return GivenEstimator(mission.fusion.given, Ground.from_config(mission))


_MAKERS: dict[str, Callable[[MissionConfig], Estimator[Any]]] = {
    "paper": lambda mission: _paper(mission, "paper", "paper"),
    "paper-geometric": lambda mission: _paper(mission, "geometric", "paper-geometric"),
    "bayes": _bayes,
    "sources": _sources,
    "field": _field,
    "given": _given,
}
_SLOW = frozenset({"sources", "field"})  # a step takes up to some seconds
ESTIMATORS: tuple[str, ...] = tuple(_MAKERS)  # of this package
