"""``radron-update``: on an onboard computer, as root. ``radron-deploy push`` and ``status`` call it over SSH."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from radron.agent.terminal import run_command
from radron.agent.update.records import REPORT, Records, own_release, read_report
from radron.agent.update.slots import Slots
from radron.protocol.onboard import Report

if TYPE_CHECKING:
    from radron.agent.update.install import Updater


def main() -> None:
    """Run the command ``radron-update``; errors that the user can fix end in one line and exit code 2."""
    options = _options(sys.argv[1:])
    run_command("radron-update", lambda: options.run(options))


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="radron-update", description="Updates of this onboard computer.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    commands.add_parser("status", help="tell releases, slots and health as JSON").set_defaults(run=_status)
    install = commands.add_parser("install", help="install a bundle into the other slot, and start it")
    install.add_argument("bundle", type=Path)
    install.add_argument("--older", action="store_true", help="also one that is older than what runs now")
    install.set_defaults(run=_install)
    commands.add_parser("rollback", help="start the other slot's release").set_defaults(run=_roll_back)
    settle = commands.add_parser("settle", help="after a boot: confirm the slot, or give it up (radron-settle.service)")
    settle.add_argument("--deadline", type=float, metavar="SECONDS", help="for the agent to be well")
    settle.set_defaults(run=_settle)
    clock = commands.add_parser("clock", help="set a dead clock to the autopilot's time (radron-clock.service)")
    clock.set_defaults(run=_clock)
    boot = commands.add_parser("bootloader", help="the boot loader, as RAUC asks for it")
    boot.add_argument("words", nargs="+")
    boot.set_defaults(run=_bootloader)
    return parser.parse_args(arguments)


def _status(_: argparse.Namespace) -> None:
    import msgspec  # noqa: PLC0415

    from radron.agent.update.computer import look  # noqa: PLC0415

    print(msgspec.json.encode(look(Slots(), Records())).decode())


def _install(options: argparse.Namespace) -> None:
    _updater().install(options.bundle, options.older)


def _roll_back(_: argparse.Namespace) -> None:
    _updater().roll_back()


def _settle(options: argparse.Namespace) -> None:
    from radron.agent.update.computer import agent_state  # noqa: PLC0415
    from radron.agent.update.settle import DEADLINE_S, Surroundings, settle  # noqa: PLC0415

    around = Surroundings(report=_report, excuse=agent_state, reboot=_reboot, say=_say)
    deadline_s = DEADLINE_S if options.deadline is None else options.deadline
    settle(Slots(), Records(), own_release(), around, deadline_s)


def _clock(_: argparse.Namespace) -> None:
    from radron.agent.clock.setting import CERTIFICATE, TOLD, set_clock, validity_of  # noqa: PLC0415

    print(f"radron-clock: {set_clock(TOLD, validity_of(CERTIFICATE, own_release().made_ns))}", flush=True)


def _bootloader(options: argparse.Namespace) -> None:
    answer = Slots().answer(*options.words)
    if answer:
        print(answer)


def _updater() -> Updater:
    from radron.agent.update.install import Updater, run_told  # noqa: PLC0415

    return Updater(Slots(), Records(), own_release(), _report, _reboot, _say, time.time_ns, run_told)


def _report() -> Report | None:
    return read_report(REPORT, time.monotonic())


def _reboot() -> None:
    subprocess.run(["systemctl", "--no-block", "reboot"], check=True)


def _say(text: str) -> None:
    """Print a line while the connection lasts; an update continues when the connection is lost."""
    with suppress(OSError):
        print(f"radron-update: {text}", flush=True)


if __name__ == "__main__":
    main()
