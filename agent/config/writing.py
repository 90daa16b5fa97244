"""Configurations as TOML, which the agent reads again."""

from __future__ import annotations

from typing import Any

import msgspec
import tomli_w


def as_toml(config: msgspec.Struct) -> str:
    """Return a configuration as TOML text. Fields that are None are left out, because TOML has no such value."""
    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value
