"""Tables of response of ordinary detectors: shipped ones by name, or a user's file (format: docs/ordinary.md)."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from radron.agent.config.section import FileName, Section
from radron.agent.errors import ConfigError
from radron.agent.inputs import read_bytes
from radron.protocol.entries import MAX_CHANNELS

if TYPE_CHECKING:
    from radron.agent.config.mission import MissionConfig

MAX_TABLE_BYTES = 1_000_000
CAMERAS_ONLY = frozenset({"bayes", "sources", "paper", "paper-geometric"})  # estimators that take all counts for a camera's
_FOLDER = Path(__file__).parent / "tables"
_EnergyKev = Annotated[float, Meta(gt=0.0, le=20_000.0)]
_Area = Annotated[float, Meta(ge=0.0, le=1e6)]  # cm2
_Angle = Annotated[float, Meta(ge=0.0, le=180.0)]
_Areas = tuple[_Area, ...]


class ResponseTable(Section, frozen=True, kw_only=True):
    """Response of an ordinary detector to a parallel flux of photons, by energy and direction.

    kind: whether the detector gives spectra or counts alone. edges_kev: (C + 1,) rising, of the channels. fwhm_kev2: (a, b, c),
    the squared full width at half maximum of a line at E keV is a + b E + c E^2 keV2. energies_kev: (E,) rising. angles_deg: (D,)
    rising from 0, between the direction to the source and straight down from a level drone, mean over all azimuths; up to 180, or
    up to 90 for a detector with the same response from above as from below. peak_cm2: (E, D) effective area for counts of the
    photon's full energy. rest_cm2: (E, D, C) effective area for all other counts, by channel.
    """

    format: Literal["radron-response-1"]
    name: Annotated[str, Meta(min_length=1, max_length=64)]
    kind: Literal["spectrum", "counts"]
    about: Annotated[str, Meta(max_length=1000)] = ""
    edges_kev: Annotated[tuple[_EnergyKev, ...], Meta(min_length=2, max_length=MAX_CHANNELS + 1)]
    fwhm_kev2: tuple[float, float, float]
    energies_kev: Annotated[tuple[_EnergyKev, ...], Meta(min_length=2, max_length=200)]
    angles_deg: Annotated[tuple[_Angle, ...], Meta(min_length=1, max_length=37)]
    peak_cm2: tuple[_Areas, ...]
    rest_cm2: tuple[tuple[_Areas, ...], ...]

    @property
    def channels(self) -> int:
        """Number of the channels."""
        return len(self.edges_kev) - 1

    def check(self, where: str) -> None:
        """Raise ConfigError if the table contradicts itself; ``where`` begins the text."""
        for name in ("edges_kev", "energies_kev", "angles_deg"):
            if not all(one < other for one, other in pairwise(getattr(self, name))):
                raise ConfigError(f"{where}: {name}: does not rise; give it in ascending order, each value once")
        if self.kind == "counts" and self.channels != 1:
            raise ConfigError(f"{where}: edges_kev: {self.channels} channels; a counter (kind 'counts') has one")
        if self.angles_deg[0] != 0.0 or self.angles_deg[-1] not in {0.0, 90.0, 180.0}:
            raise ConfigError(f"{where}: angles_deg: give 0, or angles from 0 to 90, or from 0 to 180")
        rows, columns = len(self.energies_kev), len(self.angles_deg)
        if len(self.peak_cm2) != rows or any(len(row) != columns for row in self.peak_cm2):
            raise ConfigError(f"{where}: peak_cm2: give {rows} rows (energies_kev) of {columns} values (angles_deg)")
        if len(self.rest_cm2) != rows or any(
            len(row) != columns or any(len(cell) != self.channels for cell in row) for row in self.rest_cm2
        ):
            raise ConfigError(
                f"{where}: rest_cm2: give {rows} rows (energies_kev) of {columns} (angles_deg) with {self.channels} values"
            )
        constant, linear, square = self.fwhm_kev2
        if any(constant + linear * energy + square * energy**2 <= 0.0 for energy in self.energies_kev) and any(
            area > 0.0 for row in self.peak_cm2 for area in row
        ):
            raise ConfigError(f"{where}: fwhm_kev2: is not above 0 at all energies_kev")


class ResponseContent(Section, frozen=True, kw_only=True):
    """A table of response in a mission: the name of its file, and the file's content."""

    name: FileName
    content: Annotated[bytes, Meta(max_length=MAX_TABLE_BYTES)]

    @property
    def table(self) -> ResponseTable:
        """The table. Raises ConfigError if the content is none."""
        return read_table(self.content, f"table of response {self.name!r}")

    @property
    def digest(self) -> str:
        """The digest of the content, 16 hex digits."""
        return hashlib.blake2b(self.content, digest_size=8).hexdigest()


def read_responses(mission: MissionConfig, folder: Path) -> tuple[ResponseContent, ...]:
    """Return the tables of response that the drones of a mission name, each once: as the mission contains them already, shipped
    ones, and files in ``folder``.

    Raises ConfigError if a table is missing.
    """
    known = {one.name: one for one in mission.responses}
    names = dict.fromkeys(drone.response for drone in mission.drones if drone.response is not None)
    return tuple(known.get(name) or ResponseContent(name=name, content=_content(name, folder)) for name in names)


def check_tables(mission: MissionConfig, where: str) -> None:
    """Raise ConfigError if a drone's table of response is missing or wrong, or of another kind of detector; ``where`` begins the
    text.
    """
    for drone in mission.drones:
        table = mission.table(drone.id)
        if table is not None and table.kind != drone.detector:
            raise ConfigError(
                f"{where}: drones: {drone.id}: detector = {drone.detector!r}, but its table of response {drone.response!r} "
                f"is for {table.kind!r}"
            )


def check_detectors(mission: MissionConfig, where: str) -> None:
    """Raise ConfigError if a drone lacks its table of response, or the estimator does not know its detector; ``where`` begins the
    text.
    """
    for drone in mission.drones:
        if drone.detector == "minipix" and drone.response is not None:
            raise ConfigError(f"{where}: drones: {drone.id}: response is of ordinary detectors; give detector, or leave it out")
        if drone.detector != "minipix" and drone.response is None:
            raise ConfigError(
                f"{where}: drones: {drone.id}: detector = {drone.detector!r} needs response: {', '.join(shipped_tables())}, "
                "or the name of a file"
            )
    ordinary = [drone.id for drone in mission.drones if drone.detector != "minipix"]
    if ordinary and mission.fusion.estimator in CAMERAS_ONLY:
        raise ConfigError(
            f"{where}: fusion.estimator = {mission.fusion.estimator!r} needs a Compton camera on every drone, and "
            f"{', '.join(ordinary)} has an ordinary detector; choose another estimator, or leave these drones out"
        )


def shipped_tables() -> tuple[str, ...]:
    """Return the names of the tables that come with radron."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.json")))


def shipped_content(name: str) -> bytes:
    """Return the content of the shipped table of this name."""
    return (_FOLDER / f"{name}.json").read_bytes()


def _content(name: str, folder: Path) -> bytes:
    """The content of a shipped table by its name, or of a file in ``folder``."""
    if name in shipped_tables():
        return shipped_content(name)
    where = f"table of response {name!r}"
    if not (folder / name).exists():
        raise ConfigError(f"{where}: neither a file in {folder} nor shipped ({', '.join(shipped_tables())})")
    return read_bytes(folder / name, MAX_TABLE_BYTES, where, "give fewer energies or angles")


@lru_cache(maxsize=16)
def read_table(content: bytes, where: str) -> ResponseTable:
    """Return the table of response in a file's content (JSON). Raises ConfigError that says what is wrong, and where."""
    try:
        table = msgspec.json.decode(content, type=ResponseTable)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: no table of response: {error}; its format is in docs/ordinary.md") from None
    table.check(where)
    return table
