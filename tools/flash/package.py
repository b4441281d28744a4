"""The first-boot package: one archive and one script on the card's boot partition."""

from __future__ import annotations

import hashlib
import io
import re
import tarfile
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from robot_app.config import DEFAULT_PATH, load_any_config
from shared.command_line import Refused
from tools.flash.camera import INTERPRETER, fetch_camera
from tools.flash.settings import CardSettings
from tools.flash.wheels import Say, fetch

PROJECT = Path(__file__).resolve().parents[2]
ARCHIVE, SCRIPT = "robot-first-boot.tar", "first-boot.sh"
_FOLDERS = ("systemd", "docs")
_RUN = "systemd.run=/boot/firmware/first-boot.sh"
_FIRST_START = (
    f"{_RUN} systemd.run_success_action=reboot systemd.run_failure_action=reboot "
    "systemd.unit=kernel-command-line.target"
)
_PAIRING = "/etc/robot-app/pairing.pem"
_NO_PAIRING = re.compile(r'^pairing = ""', re.MULTILINE)
_NO_INTERPRETER = re.compile(r'^interpreter = ""', re.MULTILINE)
_SECRET = frozenset({"pairing.pem", "settings.sh"})


@dataclass(frozen=True, slots=True)
class Package:
    archive: bytes
    script: bytes

    def files(self) -> dict[str, bytes]:
        return {ARCHIVE: self.archive, SCRIPT: self.script}


def build(settings: CardSettings, wheels: Path | None, say: Say) -> Package:
    """Everything that the Pi needs. `wheels`: a folder kept between calls; a temporary one without.

    Raises `Refused` when a package cannot be fetched, and before that what `configuration` raises.
    """
    robot_toml = configuration(settings).encode()
    with tempfile.TemporaryDirectory() as folder:
        into = wheels or Path(folder)
        pinned = fetch(PROJECT / "requirements" / "robot.lock", PROJECT, into, say)
        camera = fetch_camera(PROJECT / "systemd" / "camera-packages.txt", into / "camera", say)
        files = _sources()
        files |= {f"wheels/{path.name}": path.read_bytes() for path in sorted(into.glob("*.whl"))}
        files |= {f"camera/{path.name}": path.read_bytes() for path in camera}
    files["requirements/robot.lock"] = ("\n".join(pinned) + "\n").encode()
    files["settings.sh"] = settings.as_shell().encode()
    files["robot.toml"] = robot_toml
    if settings.pairing is not None:
        files["pairing.pem"] = settings.pairing.read_bytes()
    return Package(archive_of(files), (PROJECT / "tools" / "flash" / SCRIPT).read_bytes())


def configuration(settings: CardSettings) -> str:
    """The robot's configuration, which names the camera's interpreter, and the pairing file when there is one.

    Raises `ConfigError`, and `Refused` for a file without the lines in which they are named.
    """
    path = settings.robot_toml or DEFAULT_PATH
    load_any_config(path)  # what the robot would refuse is refused here
    text = _NO_INTERPRETER.sub(f'interpreter = "{INTERPRETER}"', path.read_text(encoding="utf-8"))
    if settings.pairing is not None:
        text = _NO_PAIRING.sub(f'pairing = "{_PAIRING}"', text)
    written = tomllib.loads(text)
    if not written.get("devices", {}).get("camera", {}).get("interpreter"):
        raise Refused(
            f'{path}: needs the line interpreter = "" under [devices.camera]: the card writes its Python there'
        )
    if settings.pairing is not None and written.get("link", {}).get("pairing") != _PAIRING:
        raise Refused(f'{path}: needs the line pairing = "" under [link]: the card writes there where its file is')
    return text


def archive_of(files: dict[str, bytes]) -> bytes:
    """A tar archive with the check sums of all files in SHA256SUMS; what is secret can be read by root alone."""
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items()))
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for name, data in sorted({**files, "SHA256SUMS": sums.encode()}.items()):
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            entry.mode = 0o600 if name in _SECRET else 0o755 if name.endswith(".sh") else 0o644
            archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()


def first_start(cmdline: str) -> str:
    """The kernel's command line with our script at the next start; once, however often it is prepared.

    Raises ValueError for a line that is none.
    """
    line = cmdline.strip()
    if "root=" not in line or "\n" in line:
        raise ValueError("cmdline.txt is not that of a Raspberry Pi OS: it is one line and names the root partition")
    return (line if _RUN in line else f"{line} {_FIRST_START}") + "\n"


def _sources() -> dict[str, bytes]:
    return {
        str(path.relative_to(PROJECT)): path.read_bytes()
        for folder in _FOLDERS
        for path in sorted((PROJECT / folder).iterdir())
        if path.is_file()
    }
