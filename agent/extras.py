"""Optional libraries of the commands, and the extra of the package that installs each."""

from __future__ import annotations

from importlib.util import find_spec

LIBRARIES = {  # extra: import names
    "sim": ("dask", "distributed", "matplotlib", "numba", "pymavlink", "xraylib"),
    "station": ("starlette", "uvicorn", "websockets"),
    "foxglove": ("foxglove",),
    "tak": ("pytak",),
    "geo": ("pyproj",),
}
_EXTRAS = {library: extra for extra, libraries in LIBRARIES.items() for library in libraries}


def remedy(module: str) -> str | None:
    """Return a line of text that names a missing Python library and the command that installs it; None if the library is not
    optional.

    module: import name of the missing module.
    """
    library = module.partition(".")[0]
    extra = _EXTRAS.get(library)
    return extra and f"{library} is not installed: pip install 'radron[{extra}]'"


def lacking(*libraries: str) -> str | None:
    """Return a line of text on how to install the first of these Python libraries that is missing; None if all are installed."""
    return next((remedy(library) for library in libraries if find_spec(library) is None), None)
