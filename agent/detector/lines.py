"""The gamma lines that the agent looks for, by nuclide."""

from __future__ import annotations

from agent.errors import ConfigError

# keV; the lines of a few percent and more that a CdTe camera of 2 mm can use, from the evaluated decay data of the
# Decay Data Evaluation Project (http://www.lnhb.fr/nuclear-data/), rounded to 10 eV.
LINES_KEV: dict[str, tuple[float, ...]] = {
    "Am-241": (59.54,),
    "Ba-133": (81.00, 276.40, 302.85, 356.01, 383.85),
    "Co-60": (1173.23, 1332.49),
    "Cs-137": (661.66,),
    "Eu-152": (121.78, 244.70, 344.28, 778.90, 964.06, 1085.84, 1112.08, 1408.01),
    "I-131": (284.31, 364.49, 636.99),
    "Ir-192": (295.96, 308.46, 316.51, 468.07, 604.41, 612.46),
    "K-40": (1460.82,),
    "Na-22": (511.00, 1274.54),
}


def lines_of(nuclide: str) -> tuple[float, ...]:
    """Energies in keV, ascending.

    Raises:
        ConfigError: a nuclide that is not in the table.
    """
    try:
        return LINES_KEV[nuclide]
    except KeyError:
        raise ConfigError(f"nuclide {nuclide!r} is not known; known: {', '.join(LINES_KEV)}") from None
