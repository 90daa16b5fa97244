"""``radron-deploy pki``: certificates for the members of a swarm."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.protocol.identity import CERTIFICATE_FILE, IdentityError, Peer, Role, load_identity, utc

if TYPE_CHECKING:
    from radron.deploy.pki.authority import PkiFolder
    from radron.deploy.pki.issued import Issued

PASSPHRASE_VARIABLE = "RADRON_PKI_PASSPHRASE"
_DAY_NS = 86_400_000_000_000

app = typer.Typer(no_args_is_help=True, help="Certificates for the members of a swarm (docs/security.md).")
PkiOption = Annotated[Path, typer.Option("--pki", metavar="FOLDER", help="The authority's folder.")]
KeyOption = Annotated[Path | None, typer.Option("--key", metavar="FILE", help="The authority's key, if it is kept elsewhere.")]


@app.command()
def init(
    swarm: Annotated[str, typer.Option(metavar="NAME", help="The swarm's name.")] = "radron",
    pki: PkiOption = Path("pki"),
    key: KeyOption = None,
) -> None:
    """Make the swarm's authority. Its key is encrypted; --key puts it on a medium that is kept offline."""
    folder = _folder(pki, key)
    folder.init(swarm, lambda: passphrase(folder.key_file, new=True), time.time_ns())
    print(f"{pki}: the authority of {swarm}; its key is {folder.key_file}: keep it, and a copy of the folder, in a safe place")


@app.command()
def issue(
    name: Annotated[str, typer.Argument(help="The member's name; a drone's id.")],
    role: Annotated[Role, typer.Option(help="Role of the member.")],
    days: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, max=3650, help="Validity.", show_default="drone 30, operator and observer 90, others 365"
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="The member's folder.", show_default="NAME in the authority's folder")
    ] = None,
    may_revoke: Annotated[bool, typer.Option("--may-revoke", help="An operator's right to revoke others in flight.")] = False,
    pki: PkiOption = Path("pki"),
    key: KeyOption = None,
) -> None:
    """Issue a certificate with a new key: also to renew one, before it ends."""
    folder, place = _folder(pki, key), pki / name if out is None else out
    made = folder.issue(name, role, days, place, lambda: passphrase(folder.key_file), time.time_ns(), may_revoke)
    print(
        f"{place}: {name}, {_role(made)}, until {utc(made.not_after_ns):%Y-%m-%d %H:%M} UTC; copy this folder to where it is used"
    )


@app.command()
def revoke(
    name: Annotated[str, typer.Argument(help="The member's name.")],
    pki: PkiOption = Path("pki"),
    key: KeyOption = None,
) -> None:
    """Revoke all valid certificates of a member, and write the list revoked.crl, which every other member needs."""
    folder = _folder(pki, key)
    count = len(folder.revoke(name, lambda: passphrase(folder.key_file), time.time_ns()))
    what = "1 certificate" if count == 1 else f"{count} certificates"
    print(f"{name}: {what} revoked; copy {pki / 'revoked.crl'} into the identity folder of every other member")
    print(f"a swarm that flies now learns it from an operator: radron-agent revoke {name}")


@app.command()
def show(
    member: Annotated[
        Path | None, typer.Argument(metavar="[FOLDER]", help="A member's folder instead of the authority's.")
    ] = None,
    pki: PkiOption = Path("pki"),
) -> None:
    """List the issued certificates with their ends, and the revoked ones."""
    now_ns = time.time_ns()
    if member is not None:
        own = load_identity(member).own
        print(f"{member / CERTIFICATE_FILE}: {own.name}, {_role(own)}, serial {own.serial:x}, {_until(own, now_ns)}")
        return
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    folder = _folder(pki, None)
    ends = folder.authority().certificate.not_valid_after_utc
    table = Table("name", "role", "until (UTC)", "days left", "state", "serial", title=f"{pki}, until {ends:%Y-%m-%d}")
    for one in folder.issued():
        left_days = (one.not_after_ns - now_ns) / _DAY_NS
        state = "revoked" if one.revoked_ns is not None else "valid" if left_days > 0 else "expired"
        until = f"{utc(one.not_after_ns):%Y-%m-%d %H:%M}"
        table.add_row(one.name, _role(one), until, f"{max(left_days, 0.0):.1f}", state, one.serial[:16])
    Console().print(table)


def _role(one: Peer | Issued) -> str:
    return f"{one.role}, may revoke" if one.may_revoke else str(one.role)


def _until(own: Peer, now_ns: int) -> str:
    times = f"{utc(own.not_before_ns):%Y-%m-%d %H:%M} to {utc(own.not_after_ns):%Y-%m-%d %H:%M} UTC"
    if now_ns < own.not_before_ns:
        return f"{times}: not yet valid"
    return f"{times}: expired" if now_ns > own.not_after_ns else f"{times}: {(own.not_after_ns - now_ns) / _DAY_NS:.1f} days left"


def drone_issuer(authority: PkiFolder, drone: str, days: int | None) -> Callable[[Path], None]:
    """Return a function that writes a new certificate and key of a drone into a given folder; it asks for the passphrase.

    ``days``: period of validity; None: the usual period.
    """

    def issue_into(folder: Path) -> None:
        authority.issue(drone, Role.DRONE, days, folder, lambda: passphrase(authority.key_file), time.time_ns())

    return issue_into


def _folder(pki: Path, key: Path | None) -> PkiFolder:
    from radron.deploy.pki.authority import PkiFolder  # noqa: PLC0415

    return PkiFolder(pki, key)


def passphrase(key_file: Path, new: bool = False) -> str:
    """Return the passphrase of the authority's key, from an environment variable or the terminal.

    It is never taken from the command line, which all users of the computer can read. ``new``: ask twice.
    """
    if PASSPHRASE_VARIABLE in os.environ:
        return os.environ[PASSPHRASE_VARIABLE]
    if not sys.stdin.isatty():
        raise IdentityError(f"{key_file}: the passphrase is missing; run this in a terminal, or set {PASSPHRASE_VARIABLE}")
    return str(typer.prompt(f"Passphrase of {key_file}", hide_input=True, confirmation_prompt=new, err=True))
