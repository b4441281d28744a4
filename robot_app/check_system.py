"""The part of `robot-app check` that is about the computer: its limits, its card, its clock and the pairing file."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from robot_app.check import Finding
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import DeviceError
from robot_app.real_time import highest_priority
from shared.link.base import LinkError
from shared.link.pairing import read_pairing
from shared.runtime.clock import wall_clock_name

_LEAST_FREE_MB = 200
_OLDEST = "20260101"  # a clock before the app was written was never set
_PRIORITY_WANTED = 50


@dataclass(frozen=True, slots=True)
class SystemPlaces:
    """Where a Raspberry Pi OS has what is looked at."""

    state: Path = Path("/var/lib/robot-app")
    unit: Path = Path("/etc/systemd/system/robot-app.service")
    synchronised: Path = Path("/run/systemd/timesync/synchronized")


def check_system(config: AnyRobotConfig, places: SystemPlaces | None = None) -> Iterator[Finding]:
    """One finding after the other. Nothing is changed."""
    at = places or SystemPlaces()
    checks: tuple[tuple[str, str, Callable[[], str]], ...] = (
        ("real time", "limits", lambda: _real_time(at)),
        ("card", str(_nearest(at.state)), lambda: _card(at)),
        ("clock", "systemd-timesyncd", lambda: _clock(at)),
        ("pairing", config.link.pairing or "link.pairing", lambda: _pairing(config)),
    )
    for what, where, look in checks:
        try:
            finding = Finding(what, where, True, look())
        except (DeviceError, LinkError) as error:
            finding = Finding(what, where, False, str(error))
        yield finding


def _real_time(at: SystemPlaces) -> str:
    highest = highest_priority()
    if highest >= _PRIORITY_WANTED:
        return f"FIFO priority up to {highest}"
    if at.unit.is_file():
        return "none in this shell; robot-app.service has it"
    raise DeviceError("no FIFO priority, and no robot-app.service that gives it: sudo sh systemd/install.sh")


def _card(at: SystemPlaces) -> str:
    free_mb = shutil.disk_usage(_nearest(at.state)).free / 1e6
    if free_mb < _LEAST_FREE_MB:
        raise DeviceError(f"{free_mb:.0f} MB free: remove what is not needed, e.g. sudo journalctl --vacuum-size=50M")
    return f"{free_mb / 1e3:.1f} GB free"


def _clock(at: SystemPlaces) -> str:
    """The robot reckons with the time since its start, so this is no fault: only the log's times depend on it."""
    now = wall_clock_name()
    if at.synchronised.exists():
        return f"{now} UTC, synchronised"
    guess = "was never set" if now < _OLDEST else "runs on from the last shutdown"
    return f"{now} UTC, not synchronised, {guess}: times in the log may be wrong, nothing else is"


def _pairing(config: AnyRobotConfig) -> str:
    if not config.link.pairing:
        return "none: anybody on this network can command the robot; `radio-config key new FILE` makes one"
    return f"{read_pairing(Path(config.link.pairing).expanduser()).fingerprint}; the station's must be the same"


def _nearest(folder: Path) -> Path:
    """It, or the first above it that is there."""
    return next(place for place in (folder, *folder.parents) if place.is_dir())
