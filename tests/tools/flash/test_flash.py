"""The card that makes a Raspberry Pi a robot; what is on it is run on an emulated Pi by hand (docs/robot.md)."""

from __future__ import annotations

import hashlib
import io
import shlex
import shutil
import struct
import subprocess
import tarfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from robot_app.config import DEFAULT_PATH, OMNI_PATH, load_any_config, load_config
from shared.command_line import Refused
from shared.config import ConfigError
from tools.flash import __main__ as flash
from tools.flash.camera import fetch_camera, read_list
from tools.flash.fat import boot_partition
from tools.flash.package import PROJECT, Package, archive_of, configuration, first_start
from tools.flash.settings import CardSettings
from tools.flash.wheels import fetch, read_lock

CMDLINE = "console=tty1 root=PARTUUID=12-02 rootwait"
FAT_AT = 2048
needs_mtools = pytest.mark.skipif(shutil.which("mformat") is None, reason="mtools is not installed")


def test_the_lock_is_told_apart_by_what_a_pi_is() -> None:
    pins = read_lock((PROJECT / "requirements" / "robot.lock").read_text(encoding="utf-8"))
    for python in ("3.11", "3.13"):
        names = [pin.requirement.split("==")[0] for pin in pins if pin.is_for(python)]
        assert names.count("numpy") == 1
        assert {"numba", "llvmlite", "pyserial", "gpiod", "smbus2", "hokuyolx"} <= set(names)
        assert "pyrealsense2" not in names  # its wheels for aarch64 end at Python 3.9
    assert all(pin.hashes for pin in pins)


def test_the_next_start_runs_the_script_and_then_an_ordinary_start_follows() -> None:
    once = first_start(CMDLINE + "\n")
    assert once.startswith(CMDLINE + " systemd.run=/boot/firmware/first-boot.sh ")
    assert "systemd.run_failure_action=reboot" in once
    assert first_start(once) == once


@pytest.mark.parametrize("line", ["", "quiet", "root=/dev/a\nroot=/dev/b"])
def test_a_command_line_that_is_none_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r"cmdline\.txt"):
        first_start(line)


def test_the_script_takes_its_own_words_off_the_command_line(tmp_path: Path) -> None:
    script = (PROJECT / "tools" / "flash" / "first-boot.sh").read_text(encoding="utf-8")
    words = next(line for line in script.splitlines() if line.startswith("sed -i 's| systemd"))
    (tmp_path / "cmdline.txt").write_text(first_start(CMDLINE), encoding="utf-8")
    subprocess.run(
        ["/bin/sh", "-c", words], env={"CMDLINE": str(tmp_path / "cmdline.txt"), "PATH": "/usr/bin:/bin"}, check=True
    )
    assert (tmp_path / "cmdline.txt").read_text(encoding="utf-8") == CMDLINE + "\n"


def test_the_archive_can_be_checked_and_hides_what_is_secret() -> None:
    data = archive_of({"a/b.sh": b"echo", "pairing.pem": b"key", "settings.sh": b"WIFI_PASSWORD=x"})
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        modes = {entry.name: entry.mode for entry in archive.getmembers()}
        sums = archive.extractfile("SHA256SUMS")
        assert sums is not None
        assert f"{hashlib.sha256(b'echo').hexdigest()}  a/b.sh" in sums.read().decode()
    assert modes["pairing.pem"] == modes["settings.sh"] == 0o600
    assert modes["a/b.sh"] == 0o755


def test_a_shell_reads_the_settings_as_they_were_given() -> None:
    settings = CardSettings(wifi_ssid="it's $HOME `x`", wifi_password='"quoted" pass', wifi_country="JP")
    script = settings.as_shell() + 'printf "%s|%s|%s" "$WIFI_SSID" "$WIFI_PASSWORD" "$HOST"'
    said = subprocess.run(["/bin/sh", "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout == 'it\'s $HOME `x`|"quoted" pass|robot'
    assert shlex.split(settings.as_shell())


def test_a_card_with_a_pairing_file_has_a_robot_that_asks_for_it(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(configuration(CardSettings(pairing=tmp_path / "key.pem")), encoding="utf-8")
    assert load_config(tmp_path / "robot.toml").link.pairing == "/etc/robot-app/pairing.pem"


def test_a_configuration_that_the_robot_would_refuse_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[car]\nwheels = 5\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"mine\.toml"):
        configuration(CardSettings(robot_toml=tmp_path / "mine.toml"))


def test_a_card_can_be_that_of_the_omnidirectional_robot(tmp_path: Path) -> None:
    settings = CardSettings(robot_toml=OMNI_PATH, pairing=tmp_path / "key.pem")
    (tmp_path / "omni.toml").write_text(configuration(settings), encoding="utf-8")
    config = load_any_config(tmp_path / "omni.toml")
    assert config.link.pairing == "/etc/robot-app/pairing.pem"
    assert config.devices.camera.interpreter == "/opt/robot-app/camera/python"


@pytest.mark.parametrize("line", ['pairing = ""', 'interpreter = ""'])
def test_a_configuration_in_which_the_card_cannot_write_is_refused_rather_than_left_open(
    line: str, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(DEFAULT_PATH.read_text(encoding="utf-8").replace(line, ""), encoding="utf-8")
    with pytest.raises(Refused, match=rf"mine\.toml: needs the line {line}"):
        configuration(CardSettings(robot_toml=mine, pairing=tmp_path / "key.pem"))


def test_neither_modules_that_are_gone_nor_an_older_app_get_onto_the_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, into = tmp_path / "project", tmp_path / "wheels"
    (project / "build" / "lib" / "robot_app").mkdir(parents=True)
    (project / "build" / "lib" / "robot_app" / "gone.py").touch()
    (project / "robot.lock").write_text("", encoding="utf-8")
    into.mkdir()
    (into / "low_bandwidth_mapper-0.0.9-py3-none-any.whl").touch()
    (into / "numpy-1-any.whl").touch()
    monkeypatch.setattr("tools.flash.wheels._pip", lambda *_: None)
    fetch(project / "robot.lock", project, into, lambda _: None)
    assert not (project / "build" / "lib").exists()
    assert [path.name for path in into.iterdir()] == ["numpy-1-any.whl"]


def test_the_camera_has_a_python_of_its_own_on_the_card() -> None:
    files = read_list((PROJECT / "systemd" / "camera-packages.txt").read_text(encoding="utf-8"))
    assert [file.name.split("_")[0] for file in files[:-1]] == [
        "libpython3.9-minimal",
        "libpython3.9-stdlib",
        "python3.9-minimal",
        "libusb-1.0-0",
    ]
    wheel = files[-1]
    assert wheel.name == "pyrealsense2-2.54.2.5684-cp39-cp39-manylinux2014_aarch64.whl"
    pins = read_lock((PROJECT / "requirements" / "robot.lock").read_text(encoding="utf-8"))
    assert any(f"sha256:{wheel.sha256}" in pin.hashes for pin in pins)


def test_a_file_put_there_by_hand_is_taken_and_a_wrong_one_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.flash.camera.MIRRORS", ((tmp_path / "mirror").as_uri() + "/",))
    data = b"package"
    listed = tmp_path / "list.txt"
    listed.write_text(f"{hashlib.sha256(data).hexdigest()}  pool/x/x_1_arm64.deb\n", encoding="utf-8")
    into = tmp_path / "camera"
    with pytest.raises(Refused, match=r"x_1_arm64\.deb cannot be fetched .* by hand"):
        fetch_camera(listed, into, lambda _: None)
    (tmp_path / "mirror" / "pool" / "x").mkdir(parents=True)
    (tmp_path / "mirror" / "pool" / "x" / "x_1_arm64.deb").write_bytes(b"another")
    with pytest.raises(Refused, match="sends another file"):
        fetch_camera(listed, into, lambda _: None)
    (into / "x_1_arm64.deb").write_bytes(data)
    assert fetch_camera(listed, into, lambda _: None) == [into / "x_1_arm64.deb"]


def test_a_card_names_the_interpreter_of_the_camera_unless_another_is_named(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(configuration(CardSettings()), encoding="utf-8")
    assert load_config(tmp_path / "robot.toml").devices.camera.interpreter == "/opt/robot-app/camera/python"
    mine = DEFAULT_PATH.read_text(encoding="utf-8").replace('interpreter = ""', 'interpreter = "/my/python"')
    (tmp_path / "mine.toml").write_text(mine, encoding="utf-8")
    assert 'interpreter = "/my/python"' in configuration(CardSettings(robot_toml=tmp_path / "mine.toml"))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"hostname": "Robot 1"}, "host name"),
        ({"user": "root"}, "user"),
        ({"ssh_key": "-----BEGIN OPENSSH PRIVATE KEY-----"}, r"\.pub"),
        ({"wifi_ssid": "lab"}, "country"),
        ({"wifi_ssid": "lab", "wifi_country": "JP", "wifi_password": "short"}, "8 to 63"),
        ({"wifi_ssid": "a\nb", "wifi_country": "JP"}, "one line"),
        ({"time_zone": "../etc"}, "time zone"),
    ],
)
def test_what_the_pi_would_refuse_is_refused_before(wrong: dict[str, str], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        CardSettings(**wrong)


def image(tmp_path: Path) -> Path:
    """A disk image with one FAT partition, as Raspberry Pi OS begins."""
    path = tmp_path / "raspios.img"
    sectors = 40 * 2048
    table = bytearray(512)
    table[446:462] = struct.pack("<B3sB3sII", 0, b"", 0x0C, b"", FAT_AT, sectors)
    table[510:] = b"\x55\xaa"
    with path.open("wb") as file:
        file.write(table)
        file.truncate((FAT_AT + sectors) * 512)
    at = f"{path}@@{FAT_AT * 512}"
    subprocess.run(["mformat", "-i", at, "-F", "-T", str(sectors), "::"], check=True, capture_output=True)
    subprocess.run(["mcopy", "-i", at, "-", "::cmdline.txt"], input=CMDLINE.encode(), check=True, capture_output=True)
    return path


@pytest.fixture
def without_fetching(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flash, "build", lambda *_: Package(b"archive", b"#!/bin/sh\n"))


@needs_mtools
@pytest.mark.usefixtures("without_fetching")
def test_an_image_gets_the_package_and_keeps_the_rest(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    base, out = image(tmp_path), tmp_path / "out" / "robot.img"
    before = base.read_bytes()
    monkeypatch.setattr("sys.argv", ["flash", "image", str(base), "--out", str(out)])
    assert flash.main() == 0
    boot = boot_partition(out)
    assert boot.read("robot-first-boot.tar") == "archive"
    assert boot.read("cmdline.txt") == first_start(CMDLINE)
    assert base.read_bytes() == before
    assert list(out.parent.iterdir()) == [out]


@pytest.mark.usefixtures("without_fetching")
def test_a_card_gets_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "cmdline.txt").write_text(CMDLINE, encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["flash", "card", str(tmp_path)])
    assert flash.main() == 0
    assert (tmp_path / "robot-first-boot.tar").read_bytes() == b"archive"
    assert (tmp_path / "cmdline.txt").read_text(encoding="utf-8") == first_start(CMDLINE)


@pytest.mark.usefixtures("without_fetching")
def test_a_folder_that_is_no_boot_partition_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.argv", ["flash", "card", str(tmp_path)])
    assert flash.main() == 2
    assert str(tmp_path) in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["--pairing", "FILE"], ["--wifi", "lab", "--country", "JP"]])
def test_what_cannot_be_used_is_refused_before_anything_is_fetched(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def nobody_is_there(_: str) -> str:
        raise EOFError

    monkeypatch.setattr("getpass.getpass", nobody_is_there)
    monkeypatch.setattr(flash, "build", lambda *_: pytest.fail("fetched"))
    (tmp_path / "cmdline.txt").write_text(CMDLINE, encoding="utf-8")
    no_key = tmp_path / "id.pub"
    no_key.write_text("ssh-ed25519 AAAA", encoding="utf-8")
    no_key.chmod(0o600)
    given = [str(no_key) if word == "FILE" else word for word in words]
    monkeypatch.setattr("sys.argv", ["flash", "card", str(tmp_path), *given])
    assert flash.main() == 2
    said = capsys.readouterr().err
    assert "id.pub: is no pairing file" in said or "--wifi-password-file" in said


@pytest.mark.usefixtures("without_fetching")
def test_a_card_without_room_is_refused_before_it_is_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "cmdline.txt").write_text(CMDLINE, encoding="utf-8")
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=10))
    monkeypatch.setattr("sys.argv", ["flash", "card", str(tmp_path)])
    assert flash.main() == 2
    assert f"{tmp_path}: 0 MB are free" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["cmdline.txt"]


@pytest.mark.parametrize("data", [b"", b"\0" * 512, bytes(510) + b"\x55\xaa"])
def test_a_file_that_is_no_image_is_refused_by_name(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.img").write_bytes(data)
    with pytest.raises(Refused, match=r"x\.img"):
        boot_partition(tmp_path / "x.img")
