"""What can be set about the window."""

from __future__ import annotations

from dataclasses import dataclass, field

from shared.link.radio_config import LinkUse


@dataclass(frozen=True, slots=True)
class GaugeConfig:
    """Where the gauges change colour."""

    slow_mps: float = 0.10  # paper 1, section 5: below is slow,
    fast_mps: float = 0.40  # above is fast,
    max_speed_mps: float = 0.46  # and this was the fastest
    max_steering_rad: float = 0.52
    battery_full_v: float = 7.2  # two LiFePO4 cells after charging
    battery_low_v: float = 6.2  # the flat part of the discharge curve ends
    battery_empty_v: float = 5.6  # 2.8 V a cell: the pack is damaged below
    max_current_a: float = 8.0
    warm_c: float = 70.0
    throttle_c: float = 80.0  # paper 1, section 5: between these the Pi begins to slow down
    hot_c: float = 85.0
    stale_after_s: float = 1.5  # older telemetry is shown in grey with its age


@dataclass(frozen=True, slots=True)
class WindowConfig:
    """The operator's window."""

    host: str = "127.0.0.1"  # what the connection menu offers at first
    port: int = 47100
    link: LinkUse = "tcp"  # what it offers at first: Wi-Fi, LoRa ("radio"), or both
    width_px: int = 1600
    height_px: int = 1000
    refresh_hz: float = 12.0  # each repaint recomposes the whole window because of the OpenGL canvas
    drive_hz: float = 10.0  # a hand command holds for half a second
    drive_speed_mps: float = 0.20  # paper 1, section 5: the medium speed
    drive_max_speed_mps: float = 0.46
    drive_max_steering_rad: float = 0.40
    log_lines: int = 500
    gauges: GaugeConfig = field(default_factory=GaugeConfig)

    def __post_init__(self) -> None:
        if not 1 <= self.refresh_hz <= 60:
            raise ValueError("refresh_hz must be between 1 and 60")
        if not 4 <= self.drive_hz <= 50:
            raise ValueError("drive_hz must be between 4 and 50")
        if not 0 < self.port < 65536:
            raise ValueError("port must be between 1 and 65535")
        if self.log_lines < 1:
            raise ValueError("log_lines must be at least 1")
