"""Attack by many valid log entries: a member, or a thief of its key, publishes them to keep its peers computing."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from radron.protocol.codec import as_bytes, decode_from
from radron.protocol.entries import Cone, ConeOrder, Counts, Coverage, Credential, Entry, Exposure
from radron.protocol.keys import key_of
from radron.protocol.message import Message
from radron.protocol.signing import Trust, sign_entries
from radron.sim.faults.agents import DenseEntries, OldEntries
from radron.sim.faults.schedule import Active, Schedule

LIVE_NS = 1_000_000  # of an exposure: without information about a source, and short, so that many fit into a second
MAX_AT_ONCE = 256  # entries
_FAINT = 1e-6  # probability of a cone's orders: no information about a source

Crowding = OldEntries | DenseEntries


class Crowd:
    """Makes the additional log entries of one attack in the name of one drone, under a separate boot id."""

    def __init__(self, fault: Crowding, swarm: str, trust: Trust, boot: str) -> None:
        self._fault, self._swarm, self._trust, self._boot = fault, swarm, trust, boot
        self._template: Exposure | None = None  # the drone's newest: its mission, epoch and place
        self._began_ns: int | None = None
        self._sequence = 0  # of the last entry; 0 is the credential's

    def follow(self, message: Message) -> None:
        """Record a message of the drone itself, from which mission, epoch and place of the additional entries are taken."""
        if isinstance(message, Exposure) and message.boot != self._boot:
            self._template = message

    def due(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Return keys and payloads of the additional entries due by now; empty before the drone's first exposure."""
        template = self._template
        if template is None:
            return []
        made: list[Entry] = []
        if self._began_ns is None:
            self._began_ns = now_ns
            made.append(self._credential(template, now_ns))
        wanted = int((now_ns - self._began_ns) * 1e-9 * self._fault.per_s)
        until = min(wanted, self._sequence + MAX_AT_ONCE)
        while self._sequence < until:
            self._sequence += 1
            made.append(self._entry(template, now_ns, self._sequence))
        return [(key_of(self._swarm, entry), as_bytes(entry)) for entry in self._signed(made)]

    def _signed(self, entries: Sequence[Entry]) -> list[Entry]:
        return list(sign_entries(entries, self._trust.sign))

    def _credential(self, template: Exposure, now_ns: int) -> Credential:
        return Credential(
            stamp_ns=now_ns,
            drone=template.drone,
            mission=template.mission,
            boot=self._boot,
            sequence=0,
            certificate=self._trust.certificate,
        )

    def _entry(self, template: Exposure, now_ns: int, sequence: int) -> Entry:
        if isinstance(self._fault, OldEntries):
            return self._cone(template, now_ns - round(self._fault.ago_s * 1e9) + sequence, sequence)
        if self._fault.what == "exposure":
            return self._exposure(template, sequence)
        if self._fault.what == "cone":
            return self._cone(template, now_ns + sequence, sequence)
        place = template.poses[-1].position_m[:2]
        return Coverage(
            stamp_ns=now_ns + sequence,
            drone=template.drone,
            mission=template.mission,
            boot=self._boot,
            sequence=sequence,
            epoch=template.epoch,
            path_m=(place,),
            swath_m=0.1,
        )

    def _exposure(self, template: Exposure, sequence: int) -> Exposure:
        """Return an exposure without counts, number ``sequence`` of a regular series."""
        assert self._began_ns is not None
        begun_ns = self._began_ns + max(LIVE_NS, round(1e9 / self._fault.per_s)) * sequence
        pose = replace(template.poses[-1], offset_ns=0)
        numbered = {"boot": self._boot, "sequence": sequence, "stamp_ns": begun_ns, "end_ns": begun_ns + LIVE_NS}
        empty = {"live_time_s": 1e-9 * LIVE_NS, "counts": Counts(0, 0, 0), "poses": (pose,), "spectrum": ()}
        return replace(template, **numbered, **empty, carried=template.carried)

    def _cone(self, template: Exposure, stamp_ns: int, sequence: int) -> Cone:
        return Cone(
            stamp_ns=stamp_ns,
            drone=template.drone,
            mission=template.mission,
            boot=self._boot,
            sequence=sequence,
            epoch=template.epoch,
            apex_m=template.poses[-1].position_m,
            apex_sigma_m=template.position_sigma_m,
            yaw_sigma_rad=template.yaw_sigma_rad,
            orders=(ConeOrder((0.0, 0.0, 1.0), 1.0, 0.1, _FAINT), ConeOrder((0.0, 0.0, -1.0), 1.0, 0.1, _FAINT)),
            energies_kev=(200.0, 461.7),
            energy_sigmas_kev=(5.0, 5.0),
            separation_mm=1.0,
        )


class Crowds:
    """Makes the additional log entries of all such attacks in a simulated flight."""

    def __init__(self, schedule: Schedule, swarm: str, trusts: Sequence[Trust]) -> None:
        """``schedule``: times of the faults. ``swarm``: its name. ``trusts``: signing keys of each drone, of which the attacker
        has a copy.
        """
        self._schedule, self._swarm, self._trusts = schedule, swarm, trusts
        self._crowds: dict[tuple[Active, int], Crowd] = {}

    def beside(self, drone: int, key: str, payload: bytes, now_ns: int) -> list[tuple[str, bytes]]:
        """Return keys and payloads of the additional entries to be sent after a drone's message.

        The poses set the pace, as they arrive steadily.
        """
        if not key.endswith(("/pose", "/exposure")):
            return []
        told: list[tuple[str, bytes]] = []
        faults: list[tuple[Crowding, Active]] = [*self._schedule.active(OldEntries, drone)]
        for fault, one in (*faults, *self._schedule.active(DenseEntries, drone)):
            if (one, drone) not in self._crowds:
                boot = f"{int(one.rng.integers(2**63)):016x}"
                self._crowds[one, drone] = Crowd(fault, self._swarm, self._trusts[drone], boot)
            crowd = self._crowds[one, drone]
            crowd.follow(decode_from(key, payload))
            told += crowd.due(now_ns) if key.endswith("/pose") else []
        return told
