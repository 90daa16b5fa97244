"""Update of many onboard computers at once with a signed bundle, for ``radron-deploy push``."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from radron.deploy.remote import Host, RemoteError, at_all, run, send
from radron.deploy.update.bundle import BundleManifest
from radron.deploy.update.errors import UpdateError
from radron.deploy.update.hosts import PROGRAM, Tell, ask
from radron.protocol.onboard import MAX_BOOT_ATTEMPTS, Computer, Outcome

INCOMING = "/var/lib/radron-update/incoming"
DECIDED_S = 2400.0  # three attempts of a slowly starting computer
POLL_S = 3.0
_MARGIN_MB = 200  # that stay free on the data partition


@dataclass(frozen=True, slots=True)
class Push:
    """What each computer must install.

    ``bundle``: signed file with the new release; None: go back to the former release in the other disk partition. ``older``:
    accept also a release older than the running one. ``poll_s``: interval of questions for the outcome. ``decided_s``: longest
    wait for it.
    """

    bundle: Path | None
    manifest: BundleManifest | None
    older: bool
    tell: Tell
    poll_s: float = POLL_S
    decided_s: float = DECIDED_S


async def push(hosts: Sequence[Host], order: Push) -> list[Outcome | RemoteError]:
    """Update all computers, and return how the update of each has ended, in the order of ``hosts``.

    Raises:
        UpdateError: a vehicle is armed, or a flight is under way; no computer was changed.
    """
    found = await at_all(hosts, ask)
    flying = [
        f"{host.name} ({'armed' if one.report.armed else one.report.stage})"
        for host, one in zip(hosts, found, strict=True)
        if isinstance(one, Computer) and one.report is not None and one.report.flies
    ]
    if flying:
        raise UpdateError(f"{', '.join(flying)}: no update while a vehicle is armed or a flight is under way; nothing was sent")
    known = dict(zip(hosts, found, strict=True))

    async def one(host: Host) -> Outcome:
        before = known[host]
        if isinstance(before, RemoteError):
            raise before
        return await _update(host, before, order)

    return await at_all(hosts, one)


async def _update(host: Host, before: Computer, order: Push) -> Outcome:
    if not before.slot:
        raise host.error("it does not run the onboard image, and has no slots: `radron-deploy install` brings it up to date")
    trial, wanted = before.trial, order.manifest.release if order.manifest is not None else None
    under_way = trial is not None and trial.release == wanted and (before.busy or trial.slot == before.slot)
    if not under_way:  # else this push continues an earlier push with a lost connection
        if order.bundle is None or order.manifest is None:
            await _call(host, f"{PROGRAM} rollback", order)
        else:
            await _send_and_install(host, before, order.bundle, order.manifest, order)
    return await _decided(host, before, order)


async def _send_and_install(host: Host, before: Computer, bundle: Path, manifest: BundleManifest, order: Push) -> None:
    if manifest.release.is_older_than(before.release) and not order.older:
        raise host.error(f"{manifest.release} is older than what runs there, {before.release}; if you mean it, add --older")
    target = f"{INCOMING}/{manifest.sha256[:16]}.raucb"
    await _make_room(host, target, manifest)
    await send(host, bundle, target, lambda done, total: order.tell(host, "copying", done, total))
    options = " --older" if order.older else ""
    await _call(host, f"{PROGRAM} install {target}{options}; code=$?; rm -f {target}; exit $code", order)


async def _make_room(host: Host, target: str, manifest: BundleManifest) -> None:
    """Remove remains of other bundles, and check that this bundle fits. Raises RemoteError: the disk is full."""
    begun = f"stat -c %s {target} 2> /dev/null || stat -c %s {target}.part 2> /dev/null || echo 0"
    others = f"find {INCOMING} -type f ! -path '{target}*' -delete 2> /dev/null || true"
    there, free = (await run(host, f"{others}; {begun}; df --output=avail -B 1000000 /var | tail -n 1")).split()
    needed_mb = (manifest.size - int(there)) // 1_000_000 + _MARGIN_MB
    if int(free) < needed_mb:
        raise host.error(f"its disk is full: {free} MB free, {needed_mb} MB are needed; fetch its records, and remove some there")


async def _call(host: Host, command: str, order: Push) -> None:
    """Run the updater there. It restarts the computer, which may end the connection."""
    started = False

    def tell(line: str) -> None:
        nonlocal started
        text = line.removeprefix("radron-update: ")
        started = started or text.startswith("starting slot")
        order.tell(host, text, 0, 0)

    try:
        await run(host, command, tell=tell)
    except RemoteError as error:
        if not started:
            raise RemoteError(str(error).replace("radron-update: ", "")) from None


async def _decided(host: Host, before: Computer, order: Push) -> Outcome:
    """Wait until the computer has decided about its new slot.

    Raises:
        RemoteError: no decision in time.
    """
    until_s = time.monotonic() + order.decided_s
    order.tell(host, "starting anew", 0, 0)
    last = "it has not answered since it was started anew"
    while time.monotonic() < until_s:
        try:
            now = await ask(host)
        except RemoteError as error:
            last = str(error)
        else:
            if now.trial is None and now.outcome is not None and now.outcome != before.outcome:
                return now.outcome
            last = _waiting(now)
            order.tell(host, last, 0, 0)
        await asyncio.sleep(order.poll_s)
    raise host.error(f"not decided after {order.decided_s / 60.0:.0f} min ({last}); look again with `radron-deploy status`")


def _waiting(now: Computer) -> str:
    if now.trial is None or now.trial.slot != now.slot:
        return "starting anew"
    agent = now.agent if now.report is None else "; ".join(now.report.problems) or "the agent reports"
    return f"slot {now.slot}, attempt {now.attempts} of {MAX_BOOT_ATTEMPTS}: {agent}"
