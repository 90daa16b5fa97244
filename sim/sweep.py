"""The cases of a campaign (series of simulated flights): scenarios, each at every combination of varied parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

from radron.agent.errors import ConfigError

if TYPE_CHECKING:
    from radron.sim.scenario import Scenario

Value = float | str
Sweep = Mapping[str, tuple[Value, ...]]  # parameter -> its values, in the order given


@dataclass(frozen=True, slots=True)
class Case:
    """One case of a campaign (series of simulated flights): a scenario at one combination of varied parameters.

    ``point``: the parameters and their values, in the order of the sweep.
    """

    name: str
    scenario: Scenario
    point: tuple[tuple[str, Value], ...] = ()

    @property
    def key(self) -> tuple[str, tuple[Value, ...]]:
        """Identity of the case within its campaign: the scenario's name and the values of the varied parameters."""
        return self.name, tuple(value for _, value in self.point)

    @property
    def label(self) -> str:
        """Text for the case with its name and parameters, such as ``paper-static-swarm radius_m=8``."""
        return " ".join([self.name, *(f"{key}={_text(value)}" for key, value in self.point)])


def parse_sweep(texts: Sequence[str]) -> dict[str, tuple[Value, ...]]:
    """Read the options ``--sweep radius_m=8,10,12`` of a campaign: from each varied parameter to its values.

    Raises:
        ConfigError: no ``=``, no values, or a parameter or value given twice.
    """
    sweep: dict[str, tuple[Value, ...]] = {}
    for text in texts:
        key, values = _split(text, "--sweep", "radius_m=8,10,12")
        points = tuple(_value(value.strip()) for value in values.split(","))
        if "" in points or len(set(points)) < len(points):
            raise ConfigError(f"--sweep {text}: give values that differ, separated by commas, such as radius_m=8,10,12")
        if key in sweep:
            raise ConfigError(f"--sweep {text}: {key} is given twice; list all its values in one --sweep")
        sweep[key] = points
    return sweep


def parse_settings(texts: Sequence[str]) -> dict[str, Value]:
    """Read the options ``--set speed_mps=4`` of a campaign: from each changed parameter to its value.

    Raises:
        ConfigError: no ``=``, or no value.
    """
    return {key: _value(value) for key, value in (_split(text, "--set", "speed_mps=4") for text in texts)}


def cases(names: Sequence[str], sweep: Sweep, settings: Mapping[str, Value] | None = None) -> tuple[Case, ...]:
    """Load scenarios by name or path, and return each at every combination of the varied parameters (``sweep``), checked.

    ``settings``: parameters that are changed in all cases.

    Raises:
        ConfigError: an unknown scenario, key or value; two scenarios of one name.
    """
    from radron.sim.scenario import load_scenario, override  # noqa: PLC0415  (the physics behind it takes a second to load)

    found: list[Case] = []
    for name in names:
        scenario = load_scenario(name)
        if any(case.name == scenario.name for case in found):
            raise ConfigError(f"two scenarios have the name {scenario.name!r}; give each scenario once, with a unique name")
        for values in product(*sweep.values()):
            point = dict(zip(sweep, values, strict=True))
            changes = {**(settings or {}), **point}
            varied = override(scenario, changes) if changes else scenario
            found.append(Case(scenario.name, varied, tuple(point.items())))
    return tuple(found)


def without_effect(flown: Sequence[Case], settings: Iterable[str], estimator: str | None, law: str | None) -> list[str]:
    """Return a warning line for each changed parameter that has no effect in one of the cases.

    ``settings``: parameters changed in all cases. ``estimator``, ``law``: of all flights; None for the scenario's own.
    """
    told = []
    for case in flown:
        name = estimator or case.scenario.mission.fusion.estimator
        by_rms = name == "bayes" and (law or case.scenario.mission.encirclement.law) == "smooth"
        told += [_unheeded(key, name, by_rms) for key in (*settings, *(key for key, _ in case.point))]
    return list(dict.fromkeys(text for text in told if text is not None))


def _unheeded(key: str, estimator: str, by_rms: bool) -> str | None:
    """``by_rms``: the radius of the circle follows the estimate's RMS."""
    match key.rsplit(".", maxsplit=1)[-1]:
        case "radius_m" if by_rms:
            return (
                f"note: {key} is only the upper limit of the circle's radius, which with the smooth law and estimator bayes "
                "follows the estimate's RMS: set mission.encirclement.nearest_m, or fly --law paper"
            )
        case "nearest_m" if not by_rms:
            return f"note: {key} has an effect only with the smooth law and estimator bayes: set radius_m"
    for section, family in (("mission.fusion.paper.", "paper"), ("mission.fusion.bayes.", "bayes")):
        if key.startswith(section) and not estimator.startswith(family):
            return f"note: {key} has no effect on estimator {estimator}: fly --estimator {family}"
    return None


def _split(text: str, option: str, example: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not (key.strip() and equals and value.strip()):
        raise ConfigError(f"{option} {text}: expected a parameter and its value, such as {example}")
    return key.strip(), value.strip()


def _value(text: str) -> Value:
    """The text as a number if it is one (an int stays an int: ``drones=3``), else unchanged."""
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text


def _text(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"
