"""Parts of other packages by name: entry points of the groups ``radron.estimators`` and ``radron.detectors``.

Only installed parts can be named: neither a configuration nor a recorded flight can make an agent import anything else.
"""

from __future__ import annotations

from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from radron.agent.errors import ConfigError

Kind = Literal["estimator", "detector"]


def entry_point(kind: Kind, name: str, where: str, own: Collection[str]) -> EntryPoint:
    """Return the installed package's registration (entry point) of an estimator or detector driver by name; nothing is imported.

    own: names of the estimators or drivers that radron itself has, for the error.

    Raises:
        ConfigError: no such part is installed; ``where`` begins the text.
    """
    found = {point.name: point for point in entry_points(group=f"radron.{kind}s")}
    if name not in found:
        known = ", ".join([*own, *sorted(set(found) - set(own))])
        raise ConfigError(f"{where}: unknown {kind} {name!r}; known: {known}")
    return found[name]


def made(kind: Kind, point: EntryPoint, config: object, members: Collection[str]) -> Any:
    """Import an estimator or detector driver of another package, make it from its configuration, and check its interface.

    config: passed to the part. members: names of the attributes that it must have.

    Raises:
        ConfigError: it cannot be imported or made, or lacks a member of the interface.
    """
    try:
        part = point.load()(config)
    except ConfigError:
        raise
    except Exception as error:  # foreign code may fail in any way
        raise ConfigError(
            f"{kind} {point.name!r}: {point.value} cannot be used: {type(error).__name__}: {error}; correct or uninstall it"
        ) from error
    lacking = [member for member in members if not hasattr(part, member)]
    if lacking:
        raise ConfigError(f"{kind} {point.name!r}: {point.value} makes no {kind}: it lacks {', '.join(lacking)}")
    return part
