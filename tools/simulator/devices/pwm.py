"""A folder that looks like /sys/class/pwm/pwmchip0."""

from __future__ import annotations

from pathlib import Path


class PwmFolder:
    """Two channels that are exported already, as plain files: what is read is their first line."""

    def __init__(self, folder: Path, channels: int = 2) -> None:
        self.path = folder / "pwmchip0"
        self.path.mkdir()
        (self.path / "export").touch()
        for channel in range(channels):
            pwm = self.path / f"pwm{channel}"
            pwm.mkdir()
            for file in ("period", "duty_cycle", "enable"):
                (pwm / file).write_text("0\n", "ascii")

    def value(self, channel: int, file: str) -> int:
        return int((self.path / f"pwm{channel}" / file).read_text("ascii").split("\n")[0])

    def pulse_us(self, channel: int) -> float:
        return self.value(channel, "duty_cycle") / 1000
