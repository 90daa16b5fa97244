"""Compiled functions: numba's ``njit`` with a type that the checker understands."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def jit(function: F) -> F:
    """Compile a numerical function to machine code (numba's ``njit``), and keep the code between processes.

    numba notices changes of the file that contains a function, but not of compiled functions that it calls from other files:
    after editing one of these, delete the ``*.nb?`` files.
    """
    return cast(F, numba.njit(cache=True, error_model="numpy")(function))
