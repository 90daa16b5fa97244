"""The estimators by name, as the commands and the mission file call them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from shapely import Polygon

from agent.config import MissionConfig
from agent.errors import ConfigError
from agent.fusion.estimator import Estimator
from agent.fusion.given import GivenEstimator
from agent.fusion.initial import InitialSearch
from agent.fusion.paper import PaperEstimator
from agent.fusion.projection import Rule
from agent.ground import Ground


def estimator_named(name: str, mission: MissionConfig) -> Estimator[Any]:
    """Make the estimator of that name for a mission.

    - ``paper``: the paper's filter, with the projection rule as printed.
    - ``paper-geometric``: the same with the rule that the geometry asks for.
    - ``bayes``: the posterior from cones and counts, at rest or moving, with the poses' biases.
    - ``given``: the schedule of fusion.given.

    Raises:
        ConfigError: no such estimator, or the mission lacks what it needs.
    """
    maker = _MAKERS.get(name)
    if maker is None:
        raise ConfigError(f"estimator {name!r} is unknown; use one of {', '.join(ESTIMATORS)}")
    return maker(mission)


def _paper(mission: MissionConfig, rule: Rule, name: str) -> PaperEstimator:
    ground = Ground.from_config(mission)
    return PaperEstimator(mission.fusion.paper, InitialSearch(Polygon(mission.area.polygon_m), ground), rule, name)


def _bayes(mission: MissionConfig) -> Estimator[Any]:
    from agent.fusion.bayes.estimator import BayesEstimator  # noqa: PLC0415  a drone that flies by another has no memory for it

    return BayesEstimator(mission, Polygon(mission.area.polygon_m))


def _given(mission: MissionConfig) -> GivenEstimator:
    if mission.fusion.given is None:
        raise ConfigError("estimator 'given' needs fusion.given.schedule in the mission")
    return GivenEstimator(mission.fusion.given, Ground.from_config(mission))


_MAKERS: dict[str, Callable[[MissionConfig], Estimator[Any]]] = {
    "paper": lambda mission: _paper(mission, "paper", "paper"),
    "paper-geometric": lambda mission: _paper(mission, "geometric", "paper-geometric"),
    "bayes": _bayes,
    "given": _given,
}
ESTIMATORS: tuple[str, ...] = tuple(_MAKERS)
