"""Gamma lines of the simulated nuclides.

Energies and intensities (photons per decay) are the evaluated values of NuDat 3 / ENSDF (National Nuclear Data Center), rounded;
Cs-137's is the 0.851 of the project's reference. Weaker lines and the characteristic X rays are neglected: the capsule of a
sealed source absorbs X rays below about 50 keV. The 511 keV lines of Na-22 and F-18 assume that both annihilation photons
leave the capsule.

The table is independent of the agent's (``radron.agent.detector.lines``), so that the truth does not share the agent's errors.
"""

from __future__ import annotations

from dataclasses import dataclass

from radron.agent.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Nuclide:
    """A gamma-emitting nuclide. ``lines``: (energy in keV, photons per decay) of its gamma lines, strongest first."""

    name: str
    lines: tuple[tuple[float, float], ...]


def _nuclide(name: str, *lines: tuple[float, float]) -> Nuclide:
    return Nuclide(name, tuple(sorted(lines, key=lambda line: -line[1])))


NUCLIDES: dict[str, Nuclide] = {
    nuclide.name: nuclide
    for nuclide in (
        _nuclide("Am-241", (59.541, 0.359), (26.345, 0.0227)),
        _nuclide(
            "Ba-133",
            (53.162, 0.0214),
            (79.614, 0.0265),
            (80.998, 0.329),
            (160.612, 0.00638),
            (223.237, 0.00453),
            (276.399, 0.0716),
            (302.851, 0.1834),
            (356.013, 0.6205),
            (383.849, 0.0894),
        ),
        _nuclide("Co-57", (122.061, 0.8560), (136.474, 0.1068)),
        _nuclide("Co-60", (1173.228, 0.9985), (1332.492, 0.9998)),
        _nuclide("Cs-137", (661.657, 0.851)),
        _nuclide(
            "Eu-152",
            (121.782, 0.2853),
            (244.697, 0.0755),
            (344.279, 0.2659),
            (411.117, 0.02237),
            (443.965, 0.0312),
            (778.905, 0.1293),
            (867.380, 0.0423),
            (964.057, 0.1451),
            (1085.837, 0.1011),
            (1089.737, 0.01734),
            (1112.076, 0.1367),
            (1212.948, 0.01415),
            (1299.142, 0.01633),
            (1408.013, 0.2087),
        ),
        _nuclide("F-18", (511.0, 1.9346)),
        _nuclide("I-131", (80.185, 0.0262), (284.305, 0.0612), (364.489, 0.815), (636.989, 0.0716), (722.911, 0.0177)),
        _nuclide(
            "Ir-192",
            (205.794, 0.0331),
            (295.957, 0.2871),
            (308.455, 0.2970),
            (316.506, 0.8286),
            (468.069, 0.4784),
            (484.575, 0.0319),
            (588.581, 0.0452),
            (604.411, 0.0822),
            (612.462, 0.0534),
        ),
        _nuclide("K-40", (1460.820, 0.1066)),
        _nuclide("Na-22", (511.0, 1.798), (1274.537, 0.9994)),
        _nuclide(
            "Se-75",
            (66.052, 0.01112),
            (96.734, 0.0342),
            (121.116, 0.1720),
            (136.000, 0.5830),
            (198.606, 0.0148),
            (264.658, 0.5890),
            (279.542, 0.2499),
            (303.924, 0.01316),
            (400.657, 0.1147),
        ),
    )
}


def nuclide(name: str) -> Nuclide:
    """Return the simulated nuclide with a name such as ``Cs-137``.

    Raises:
        ConfigError: unknown name; the text lists the known ones.
    """
    try:
        return NUCLIDES[name]
    except KeyError:
        raise ConfigError(f"nuclide {name!r} is not known; known are {', '.join(NUCLIDES)}") from None
