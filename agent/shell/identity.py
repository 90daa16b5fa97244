"""This drone's certificate: its files, its validity, and the notices to the operator."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from radron.agent.clock.handover import Valid, text
from radron.agent.config.drone import DroneConfig
from radron.agent.errors import ConfigError
from radron.protocol.codes import Code
from radron.protocol.identity import CERTIFICATE_FILE, Identity, load_identity, utc
from radron.protocol.texts import CodedText

INSECURE = CodedText(
    Code.LINKS_INSECURE, "links are not encrypted (mesh.insecure = true): whoever reaches this drone can command the swarm"
)
FLIGHT_S = 2 * 3600.0  # shortest validity of a certificate at a start: links that break after its end do not come back
_HOUR_S, _DAY_S = 3600.0, 86400.0
_NOTICE_DAYS = 30.0
_SET_IT = "set it, such as by `chronyc makestep`"


class DeadClockError(ConfigError):
    """This computer's clock shows a time before its certificate or its software was made. ``valid``: bounds of a
    plausible time.
    """

    def __init__(self, text: str, valid: Valid) -> None:
        super().__init__(text)
        self.valid = valid


class Validity(NamedTuple):
    """Whether a drone's certificate is valid for a flight.

    ``fault``: reason why a flight must not start with it, or None. ``text``: name and end of the certificate.
    """

    fault: CodedText | None
    text: str
    left_days: float

    @property
    def notice(self) -> CodedText | None:
        """A reminder to the operator from a month before the certificate's end; None before."""
        if self.fault is not None or self.left_days > _NOTICE_DAYS:
            return None
        return CodedText(Code.CERTIFICATE_EXPIRING, f"certificate: {self.text}")


def own_identity(drone: DroneConfig) -> Identity | None:
    """Return the drone's certificate and key; None for unencrypted links (``insecure`` in the drone file).

    Raises:
        ConfigError: neither a certificate nor ``insecure`` is given, or both.
        IdentityError: files that cannot be used.
    """
    mesh = drone.mesh
    if mesh.insecure and mesh.identity is not None:
        raise ConfigError("mesh: identity and insecure exclude each other: remove insecure to encrypt the links")
    if mesh.insecure:
        return None
    if mesh.identity is None:
        make = f"run `radron-deploy pki issue {drone.id} --role drone`, and give the folder that it makes"
        raise ConfigError(f"mesh.identity is missing: this drone has no certificate; {make} (mesh.insecure = true: fly without)")
    return load_identity(Path(mesh.identity))


def check_clock(drone: DroneConfig, now_ns: int, made_ns: int | None = None) -> None:
    """Check that this computer's clock is not before the begin of the drone's certificate: no link would come up.

    ``made_ns``: build time of the software, UTC; None: unknown.

    Raises:
        DeadClockError: the clock is before the certificate or the software, as on a computer without a clock battery.
        IdentityError: a certificate that cannot be used.
    """
    identity = own_identity(drone)
    if identity is None:
        return
    valid = Valid(max(identity.own.not_before_ns, made_ns or 0), identity.own.not_after_ns)
    if now_ns < identity.own.not_before_ns:
        raise DeadClockError(f"clock: {validity(identity, now_ns).fault}", valid)
    if now_ns < valid.begin_ns:
        made = f"this release was made at {text(valid.begin_ns)}"
        raise DeadClockError(f"clock: {made}, and this computer's clock shows {text(now_ns)}: {_SET_IT}", valid)


def validity(identity: Identity, now_ns: int) -> Validity:
    """Return whether a certificate is valid for a flight that starts now, by this computer's clock."""
    own, file = identity.own, identity.folder / CERTIFICATE_FILE
    left_s = (own.not_after_ns - now_ns) * 1e-9
    left_days = left_s / _DAY_S
    renew = f"run `radron-deploy pki issue {own.name} --role {own.role}`, and copy the folder that it makes"
    until, now = (f"{utc(at_ns):%Y-%m-%d %H:%M} UTC" for at_ns in (own.not_after_ns, now_ns))
    fault = None
    if own.serial in identity.revoked.serials:
        fault = f"{file}: has been revoked; run `radron-deploy pki issue` with another name than {own.name}"
    elif now_ns < own.not_before_ns:
        begins = f"{utc(own.not_before_ns):%Y-%m-%d %H:%M} UTC"
        fault = f"{file}: not valid before {begins}, and this computer's clock shows {now}: {_SET_IT}"
    elif left_s <= 0.0:
        fault = f"{file}: expired at {until} (this computer's clock shows {now}); {renew}"
    elif left_s < FLIGHT_S:
        fault = f"{file}: expires at {until}, in less than the {FLIGHT_S / _HOUR_S:g} h that a flight may need; {renew}"
    left = f"{left_s / _HOUR_S:.0f} hours" if left_s < 2 * _DAY_S else f"{left_days:.0f} days"
    invalid = None if fault is None else CodedText(Code.CERTIFICATE_INVALID, fault)
    return Validity(invalid, f"{own.name}, {own.role}, until {until}, {_urgency(left_days)}{left} left", left_days)


def _urgency(left_days: float) -> str:
    if left_days <= 1.0:
        return "renew it now: "
    return "renew it this week: " if left_days <= 7.0 else ""
