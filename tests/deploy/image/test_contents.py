"""The plain files of the image: they fit the layout, the fleet's files and the agent, and hold no secrets."""

from __future__ import annotations

import configparser
import io
import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

from radron.agent.clock.setting import CERTIFICATE, GIVES_TIME, TOLD
from radron.agent.update.records import FOLDER, REPORT
from radron.agent.update.slots import GRUBENV
from radron.deploy.fleet.files import CREDENTIALS, DATA, UPDATES
from radron.deploy.image.bootloader import FIRST_BOOT, grub_configuration, grub_environment
from radron.deploy.image.layout import IMAGE_BYTES, MIB, PARTITIONS, ROOT_A, ROOT_B
from radron.deploy.image.rootfs import Release, add_contents, packages, sources
from radron.protocol.onboard import COMPATIBLE, MAX_BOOT_ATTEMPTS

CONTENTS = Path(__file__).parents[3] / "deploy/image/contents"
ROOTFS = CONTENTS / "rootfs"
UNIT = ROOTFS / "etc/systemd/system/radron-agent.service"


def text(name: str) -> str:
    return (ROOTFS / name).read_text()


def settings(unit: str, key: str) -> list[str]:
    return re.findall(rf"^{key}=(.*)$", unit, re.MULTILINE)


def test_the_partitions_lie_in_a_row_and_the_image_ends_with_them() -> None:
    end = MIB
    for part in PARTITIONS:
        assert part.start == end
        assert part.size % MIB == 0
        end += part.size
    assert end + MIB == IMAGE_BYTES
    assert len({part.guid for part in PARTITIONS}) == len(PARTITIONS)


def test_grub_and_rauc_know_the_same_slots() -> None:
    grub, rauc = grub_configuration(), configparser.ConfigParser()
    assert "@" not in grub
    for slot in (ROOT_A, ROOT_B):
        assert slot.guid in grub
        assert f'set root="$disk,gpt{slot.number}"' in grub
    rauc.read_string(text("etc/rauc/system.conf"))
    devices = {rauc[name]["bootname"]: rauc[name]["device"] for name in rauc.sections() if name.startswith("slot.")}
    assert devices == {"A": f"/dev/disk/by-partlabel/{ROOT_A.name}", "B": f"/dev/disk/by-partlabel/{ROOT_B.name}"}
    assert str(GRUBENV) == "/efi/grub/grubenv"
    backend = rauc["handlers"]["bootloader-custom-backend"].lstrip("/")
    assert "radron-update bootloader" in text(backend)
    assert rauc["system"]["compatible"] == COMPATIBLE
    assert rauc["keyring"]["check-purpose"] == "codesign"
    assert f'"$tries" != {MAX_BOOT_ATTEMPTS}' in grub


def test_grubs_variables_have_the_length_that_grub_can_overwrite() -> None:
    block = grub_environment(FIRST_BOOT)
    assert len(block) == 1024
    assert block.startswith(b"# GRUB Environment Block\nORDER=A B\n")
    assert block.endswith(b"B_TRY=0\n" + b"#" * (1024 - block.index(b"B_TRY") - 8))


@pytest.mark.skipif(shutil.which("grub-script-check") is None, reason="grub-script-check is not installed (grub-common)")
@pytest.mark.parametrize("name", ["early.cfg", "grub.cfg"])
def test_grubs_scripts_are_correct(name: str) -> None:
    subprocess.run(["grub-script-check", str(CONTENTS / "grub" / name)], check=True)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("unit", ["radron-agent.service", "radron-clock.service"])
def test_what_reads_from_outside_is_hardened(unit: str) -> None:
    command = ["systemd-analyze", "security", "--offline=yes", "--threshold=30", "--no-pager", str(UNIT.with_name(unit))]
    rated = subprocess.run(command, capture_output=True, text=True, check=False)
    if "unrecognized option" in rated.stderr:
        pytest.skip("this systemd-analyze cannot judge a file (before version 250)")
    assert rated.returncode == 0, rated.stdout.splitlines()[-1:]


def test_the_agent_may_use_serial_lines_and_usb() -> None:
    unit = UNIT.read_text()
    assert {"char-ttyACM rw", "char-ttyUSB rw", "char-ttyS rw", "char-usb_device rw"} <= set(settings(unit, "DeviceAllow"))
    assert settings(unit, "SupplementaryGroups") == ["dialout plugdev"]
    assert 'GROUP="plugdev"' in text("etc/udev/rules.d/60-radron.rules")
    assert not settings(unit, "PrivateDevices")


def test_the_unit_the_provisioning_and_the_drone_file_speak_of_the_same_places() -> None:
    unit, provision = UNIT.read_text(), text("usr/lib/radron/provision")
    assert settings(unit, "LoadCredential") == ["ca.pem", "certificate.pem", "key.pem", "revoked.crl"]
    assert "/run/credstore/" in provision
    assert CREDENTIALS.endswith("/radron-agent.service")
    assert [f"/var/lib/{name}" for name in settings(unit, "StateDirectory")] == [DATA]
    command = settings(unit, "ExecStart")[0]
    assert command == "/opt/radron/bin/radron-agent run --wait --config /run/radron/agent/drone.toml"
    assert 'install -d -m 0750 -g radron "$run/agent"' in provision
    assert settings(unit, "TimeoutStartSec") == ["infinity"]
    assert settings(unit, "Type") == ["notify"]
    assert [f"/run/{name}/report.json" for name in settings(unit, "RuntimeDirectory")] == [str(REPORT)]
    assert str(FOLDER) == UPDATES
    assert f"d {UPDATES} " in text("etc/tmpfiles.d/radron.conf")


@pytest.mark.skipif(shutil.which("shellcheck") is None, reason="shellcheck is not installed")
def test_the_scripts_are_clean() -> None:
    scripts = [path for path in (ROOTFS / "usr/lib/radron").iterdir()] + [CONTENTS / "finish.sh"]
    subprocess.run(["shellcheck", *map(str, scripts)], check=True)


def test_a_computer_with_a_dead_clock_gives_its_time_to_nobody_until_it_is_set() -> None:
    line = "local stratum 10 orphan\n"
    assert line not in text("etc/chrony/chrony.conf")
    assert "include /run/radron/chrony/*.conf\n" in text("etc/chrony/chrony.conf")
    assert '"$run/chrony/local.conf"' in text("usr/lib/radron/provision")
    assert " ".join(GIVES_TIME) == f"chronyc {line.strip()}"
    assert settings(text("etc/systemd/system/radron-clock.path"), "PathExists") == [str(TOLD)]
    assert REPORT.parent == TOLD.parent
    assert settings(text("etc/systemd/system/radron-clock.service"), "ExecStart") == ["/opt/radron/bin/radron-update clock"]
    assert str(CERTIFICATE.parent) in text("usr/lib/radron/provision")


def test_login_is_by_key_only() -> None:
    sshd = text("etc/ssh/sshd_config.d/radron.conf")
    assert "PasswordAuthentication no\n" in sshd
    assert "KbdInteractiveAuthentication no\n" in sshd
    assert "PermitRootLogin prohibit-password\n" in sshd
    assert "usermod --password '*' root" in (CONTENTS / "finish.sh").read_text()


def test_there_are_no_secrets_in_what_the_image_is_made_of() -> None:
    """Keys, passwords and certificates come from the config partition; host keys are made on the drone."""
    secret = re.compile(rb"PRIVATE KEY|BEGIN CERTIFICATE|ssh-(ed25519|rsa) AAAA|\$[156y]\$|psk=|password\s*=", re.IGNORECASE)
    files = [path for path in CONTENTS.rglob("*") if path.is_file()]
    assert len(files) > 20
    assert [path for path in files if secret.search(path.read_bytes())] == []


def test_our_files_enter_the_image_without_a_trace_of_the_checkout(tmp_path: Path) -> None:
    release = Release("1.2.3", "abc", 1_700_000_000)
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        add_contents(tar, release)
    archive.seek(0)
    with tarfile.open(fileobj=archive) as tar:
        members = tar.getmembers()
    assert {(member.uid, member.gid, member.mtime) for member in members} == {(0, 0, 1_700_000_000)}
    modes = {member.name: member.mode for member in members}
    assert modes["usr/lib/radron/provision"] == 0o755
    assert modes["etc/nftables.conf"] == 0o644


def test_the_archive_can_be_that_of_a_given_time() -> None:
    assert all(
        "snapshot.debian.org/archive/debian" in line and "20261101T000000Z" in line for line in sources("20261101T000000Z")
    )
    assert all("deb.debian.org" in line for line in sources(None))
    assert "rauc" in packages()
    assert "apt" not in packages()
