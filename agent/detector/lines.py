"""The gamma lines that the agent searches for, by nuclide."""

from __future__ import annotations

from radron.agent.errors import ConfigError

# keV and photons per decay, from the evaluated decay data of the Decay Data Evaluation Project
# (http://www.lnhb.fr/nuclear-data/), rounded to 10 eV; lines above 50 keV. annihilation photons: two for each positron.
GAMMAS: dict[str, tuple[tuple[float, float], ...]] = {
    "Am-241": ((59.54, 0.359),),
    "Ba-133": (
        (53.16, 0.0214),
        (79.61, 0.0263),
        (81.00, 0.333),
        (160.61, 0.0064),
        (223.24, 0.0045),
        (276.40, 0.0713),
        (302.85, 0.1831),
        (356.01, 0.6205),
        (383.85, 0.0894),
    ),
    "Co-57": ((122.06, 0.8549), (136.47, 0.1071)),
    "Co-60": ((1173.23, 0.9985), (1332.49, 0.9998)),
    "Cs-137": ((661.66, 0.850),),
    "Eu-152": (
        (121.78, 0.2841),
        (244.70, 0.0755),
        (344.28, 0.2659),
        (411.12, 0.0224),
        (443.96, 0.0312),
        (778.90, 0.1297),
        (867.38, 0.0424),
        (964.06, 0.1450),
        (1085.84, 0.1013),
        (1089.74, 0.0173),
        (1112.08, 0.1341),
        (1212.95, 0.0142),
        (1299.14, 0.0163),
        (1408.01, 0.2085),
    ),
    "F-18": ((511.00, 1.9346),),
    "I-131": ((80.19, 0.0261), (284.31, 0.0606), (364.49, 0.812), (636.99, 0.0726), (722.91, 0.0180)),
    "Ir-192": (
        (205.79, 0.0334),
        (295.96, 0.2872),
        (308.46, 0.2968),
        (316.51, 0.8275),
        (468.07, 0.4781),
        (484.58, 0.0319),
        (588.58, 0.0452),
        (604.41, 0.0820),
        (612.46, 0.0534),
    ),
    "K-40": ((1460.82, 0.1055),),
    "Na-22": ((511.00, 1.80), (1274.54, 0.9994)),
    "Se-75": (
        (66.05, 0.0111),
        (96.73, 0.0341),
        (121.12, 0.1720),
        (136.00, 0.5850),
        (198.61, 0.0150),
        (264.66, 0.5890),
        (279.54, 0.2503),
        (303.92, 0.0132),
        (400.66, 0.1150),
    ),
}

# Lines that a CdTe camera of 2 mm can use for full-energy events and cones, keV.
LINES_KEV: dict[str, tuple[float, ...]] = {
    "Am-241": (59.54,),
    "Ba-133": (81.00, 276.40, 302.85, 356.01, 383.85),
    "Co-57": (122.06, 136.47),
    "Co-60": (1173.23, 1332.49),
    "Cs-137": (661.66,),
    "Eu-152": (121.78, 244.70, 344.28, 778.90, 964.06, 1085.84, 1112.08, 1408.01),
    "F-18": (511.00,),
    "I-131": (284.31, 364.49, 636.99),
    "Ir-192": (295.96, 308.46, 316.51, 468.07, 604.41, 612.46),
    "K-40": (1460.82,),
    "Na-22": (511.00, 1274.54),
    "Se-75": (121.12, 136.00, 264.66, 279.54, 400.66),
}
CANDIDATES = tuple(name for name in LINES_KEV if name != "K-40")  # that is present everywhere


def lines_of(nuclide: str) -> tuple[float, ...]:
    """Return the gamma line energies (keV, ascending) by which the agent searches for a nuclide.

    Raises:
        ConfigError: the nuclide is not in the table.
    """
    try:
        return LINES_KEV[nuclide]
    except KeyError:
        raise ConfigError(f"nuclide {nuclide!r} is not known; known: {', '.join(LINES_KEV)}") from None
