"""Installation of a bundle into the other slot, or return to its release: the slot is on trial after a reboot."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from radron.agent.update.errors import UpdateError
from radron.agent.update.records import Records
from radron.agent.update.slots import Slots
from radron.protocol.onboard import COMPATIBLE, Needs, Release, Report, Trial

Run = Callable[[list[str], Callable[[str], None]], tuple[int, list[str]]]  # command, callback for its lines; exit code, lines


@dataclass(frozen=True, slots=True)
class Updater:
    """Changes the software release that this computer boots next, by installing an update or returning to the previous
    release.
    """

    slots: Slots
    records: Records
    release: Release
    report: Callable[[], Report | None]
    reboot: Callable[[], None]
    say: Callable[[str], None]
    now_ns: Callable[[], int]
    run: Run

    def install(self, bundle: Path, older: bool = False) -> None:
        """Install an update (signed bundle file) into the other system partition, and reboot the computer.

        Args:
            bundle: the file.
            older: also accept a bundle older than the running release.

        Raises:
            UpdateError: a foreign signature, an older release, a flight; or it cannot be written.
        """
        with self.records.changing():
            self._install(bundle, older)

    def roll_back(self) -> None:
        """Return to the release in the other system partition, and reboot the computer.

        Raises:
            UpdateError: the other partition has no working release, or a flight is under way.
        """
        with self.records.changing():
            self._roll_back()

    def _install(self, bundle: Path, older: bool) -> None:
        self._check_idle()
        new = self._inspected(bundle)
        if new.is_older_than(self.release) and not older:
            raise UpdateError(f"{new} is older than what runs here, {self.release}; if you mean it, add --older")
        slot = self._begin(new)
        self.records.put_slot(slot, None)
        self.say(f"writing {new} to slot {slot}")
        code, said = self.run(["rauc", "install", str(bundle)], self.say)
        if code != 0 or self.slots.primary != slot:
            self.records.end()
            raise UpdateError(f"{bundle.name}: not installed: {_reason(said)}; slot {self.slots.booted} stays in service")
        self.records.put_slot(slot, new)
        self._start(slot)

    def _roll_back(self) -> None:
        self._check_idle()
        slot = self.slots.other(self.slots.booted)
        release = self.records.slots.get(slot)
        if release is None:
            raise UpdateError(f"slot {slot} holds no release that has worked here: nothing to go back to; push another bundle")
        self._begin(release)
        self.slots.put_first(slot)
        self._start(slot)

    def _check_idle(self) -> None:
        trial, report = self.records.trial, self.report()
        if trial is not None and trial.slot == self.slots.booted:
            raise UpdateError(f"{trial.release} is on trial in slot {trial.slot}: wait until that is decided")
        if report is not None and report.flies:
            what = "its vehicle is armed" if report.armed else f"a flight is under way ({report.stage})"
            raise UpdateError(f"{what}: no update before it has landed and is disarmed")

    def _inspected(self, bundle: Path) -> Release:
        """The release in a bundle with a valid signature."""
        code, said = self.run(["rauc", "info", "--output-format=json", str(bundle)], lambda line: None)
        found = next((line for line in said if line.startswith("{")), None)
        if code != 0 or found is None:
            raise UpdateError(f"{bundle.name}: {_refusal(said)}")
        info = json.loads(found)
        if info.get("compatible") != COMPATIBLE:
            raise UpdateError(f"{bundle.name}: is for other computers ({info.get('compatible')!r}, not {COMPATIBLE!r})")
        return Release(version=str(info.get("version")), build=str(info.get("build") or ""))

    def _begin(self, release: Release) -> str:
        slot = self.slots.other(self.slots.booted)
        needs = Needs.of(self.report())
        self.records.begin(Trial(slot=slot, release=release, before=self.release, needs=needs, begun_ns=self.now_ns()))
        return slot

    def _start(self, slot: str) -> None:
        report = self.report()
        if report is not None and report.flies:
            self.say("the vehicle was armed meanwhile: the new release starts when this computer is switched on the next time")
            return
        self.say(f"starting slot {slot}")
        self.reboot()


def run_told(command: list[str], tell: Callable[[str], None]) -> tuple[int, list[str]]:
    """Run a program; ``tell`` is called at once with every line of its output. Return its exit code and all lines."""
    said: list[str] = []
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            said.append(line.rstrip())
            tell(said[-1])
    return process.returncode, said


def _refusal(said: list[str]) -> str:
    """Why RAUC does not take a bundle."""
    text = "\n".join(said)
    if "certificate has expired" in text:
        return "the certificate that signed it has expired; sign it anew: `radron-deploy bundle build`"
    if "not yet valid" in text:
        return "the certificate that signed it is not yet valid by this computer's clock: set the clock"
    if "ertificate purpose" in text:
        return (
            "is signed by a certificate that may not sign releases; issue one with `radron-deploy pki issue NAME --role release`"
        )
    if "ignature" in text and "erif" in text and "failed" in text:
        return "foreign signature: it is not signed by a release certificate of this swarm's authority"
    return f"is no bundle, or is damaged: {_reason(said)}"


def _reason(said: list[str]) -> str:
    """The most useful line: RAUC's last error, else a line about a failure, else the last line."""
    lines = [line.strip() for line in said if line.strip()]
    for sign in ("LastError", "rror", "failed", ""):
        found = [line for line in lines if sign in line]
        if found:
            return found[-1].removeprefix("LastError: ")
    return "no reason given"
