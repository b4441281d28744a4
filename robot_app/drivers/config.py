"""Where the devices of the robot are connected and how they are mounted: the tables `[devices...]` of `robot.toml`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

FULL_SCALES_V = (6.144, 4.096, 2.048, 1.024, 0.512, 0.256)  # ADS1115, in the order of its codes
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_LAST_LINE = 27  # of the 40-pin header
Symmetric = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class ScannerConfig:
    """Hokuyo UBG-04LX-F01, or another scanner that speaks SCIP 2.0; a UST over TCP. Its steps it tells itself."""

    port: str = "/dev/ttyACM0"
    address: str = ""  # of a scanner at the network, 192.168.0.10:10940 as delivered; empty: it is at `port`
    baud_rate: int = 115_200  # means nothing on USB; on RS-232 the scanner is found at any rate and set to this one
    period_s: float = 0.028  # of one turn; used when the scanner does not tell its speed
    range_min_m: float = 0.06  # data sheet
    range_max_m: float = 4.0
    x_m: float = 0.25  # where it sits: forward of the rear axle, to the left of the middle, turned to the left
    y_m: float = 0.0
    theta_rad: float = 0.0
    answer_timeout_s: float = 0.3  # for a command; longer than one scan takes at the slowest rate in use
    start_up_s: float = 3.0  # the first scan must have come by then
    silence_s: float = 0.5  # with no good scan for so long it counts as lost
    reopen_every_s: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.range_min_m < self.range_max_m:
            raise ValueError("range_min_m must be positive and below range_max_m")
        host, colon, number = self.address.rpartition(":")
        if self.address and not (host and colon and number.isdecimal() and 0 < int(number) < 65_536):
            raise ValueError(f"address must be like 192.168.0.10:10940, not {self.address!r}")
        times_s = (self.period_s, self.answer_timeout_s, self.start_up_s, self.silence_s, self.reopen_every_s)
        if min(times_s) <= 0 or self.baud_rate <= 0:
            raise ValueError("baud_rate and all times must be positive")


@dataclass(frozen=True, slots=True)
class DepthCameraConfig:
    """Intel RealSense L515 or one of the D400 family."""

    serial: str = ""  # empty: the first one found
    interpreter: str = ""  # path of a Python with pyrealsense2, run beside the app; empty: the app has it itself
    width: int = 640
    height: int = 480
    rate_hz: int = 30  # the only one of the L515
    latency_s: float = 0.040  # from the middle of the exposure to the arrival: half a sweep and the transfer
    start_up_s: float = 5.0  # the L515's first frame comes after 1.5 s
    silence_s: float = 1.0  # with no frame for so long it counts as lost
    reopen_every_s: float = 2.0

    def __post_init__(self) -> None:
        sizes = (self.width, self.height, self.rate_hz, self.start_up_s, self.silence_s, self.reopen_every_s)
        if min(sizes) <= 0 or self.latency_s < 0:
            raise ValueError("width, height, rate_hz and all times must be positive")
        if self.interpreter and not self.interpreter.startswith("/"):
            raise ValueError(f"interpreter must be a whole path, not {self.interpreter}")


@dataclass(frozen=True, slots=True)
class ImuConfig:
    """LSM9DS1. `axes`: which axis of the chip points forward, left and up; gyroscope and accelerometer apart."""

    bus: int = 1
    address: int = 0x6B  # 0x6A when SDO is tied low
    rate_hz: Literal[119, 238] = 238
    gyro_axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    acceleration_axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    gyro_bias_radps: tuple[float, float, float] = (0.0, 0.0, 0.0)  # at rest, robot axes; the app learns what is left
    acceleration_bias_mps2: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the same, gravity apart

    def __post_init__(self) -> None:
        _check_axes(self.gyro_axes)
        _check_axes(self.acceleration_axes)
        _check_address(self.address)


@dataclass(frozen=True, slots=True)
class MagnetometerConfig:
    """That of the LSM9DS1. The robot does not drive by it: `robot-app check` shows it."""

    bus: int = 1
    address: int = 0x1E  # 0x1C when SDO_M is tied low
    axes: tuple[Axis, Axis, Axis] = ("-x", "y", "z")  # of the chip, forward, left and up; its x is turned round
    offset_ut: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the robot's own magnets, robot axes
    matrix: Symmetric = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)  # xx, yy, zz, xy, xz, yz: against the robot's iron

    def __post_init__(self) -> None:
        _check_axes(self.axes)
        _check_address(self.address)


@dataclass(frozen=True, slots=True)
class PowerConfig:
    """ADS1115 with the battery behind a divider and a current sensor of the motor."""

    bus: int = 1
    address: int = 0x48
    battery_channel: int = 0
    current_channel: int = 1
    battery_divider: float = 3.0  # battery voltage over the voltage at the pin
    current_zero_v: float = 1.65  # at the pin, when no current flows
    current_v_per_a: float = 0.185
    full_scale_v: float = 4.096  # of the converter: one of those below

    def __post_init__(self) -> None:
        if not {self.battery_channel, self.current_channel} <= {0, 1, 2, 3}:
            raise ValueError("battery_channel and current_channel must be from 0 to 3")
        if self.full_scale_v not in FULL_SCALES_V:
            raise ValueError(f"full_scale_v must be one of {', '.join(map(str, FULL_SCALES_V))}")
        if self.battery_divider < 1 or self.current_v_per_a == 0:
            raise ValueError("battery_divider must be at least 1 and current_v_per_a not 0")
        _check_address(self.address)


@dataclass(frozen=True, slots=True)
class EncoderConfig:
    """Quadrature encoders of the rear wheels at GPIO lines of the kernel (BCM numbers)."""

    chip: str = "/dev/gpiochip0"
    left_a: int = 5
    left_b: int = 6
    right_a: int = 16
    right_b: int = 26
    left_reversed: bool = False
    right_reversed: bool = True  # the right motor looks the other way
    pull_up: bool = True  # open-collector outputs need it


@dataclass(frozen=True, slots=True)
class DriveConfig:
    """Servo at hardware PWM 0, H-bridge at hardware PWM 1 and two direction lines."""

    pwm_chip: str = "/sys/class/pwm/pwmchip0"
    servo_channel: int = 0
    motor_channel: int = 1
    motor_hz: float = 20_000.0  # above hearing
    gpio_chip: str = "/dev/gpiochip0"
    forward_line: int = 23
    reverse_line: int = 24
    max_duty: float = 1.0
    motor_reversed: bool = False
    servo_centre_us: float = 1500.0
    servo_trim_us: float = 0.0  # added to the centre until the car runs straight
    servo_us_per_rad: float = 640.0  # of the front wheels; negative when the servo is upside down
    servo_min_us: float = 1100.0  # the linkage ends here
    servo_max_us: float = 1900.0

    def __post_init__(self) -> None:
        if not 0 < self.max_duty <= 1:
            raise ValueError("max_duty must be in (0, 1]")
        if not 0 < self.servo_min_us < self.servo_centre_us + self.servo_trim_us < self.servo_max_us < 20_000:
            raise ValueError("servo_min_us, servo_centre_us + servo_trim_us and servo_max_us must rise")
        if self.servo_us_per_rad == 0 or not 10 <= self.motor_hz <= 100_000:
            raise ValueError("servo_us_per_rad must not be 0, motor_hz must be from 10 to 100000")
        if self.servo_channel == self.motor_channel:
            raise ValueError("servo_channel and motor_channel must differ")


@dataclass(frozen=True, slots=True)
class WheelConfig:
    """One wheel of the omnidirectional robot: an H-bridge and a quadrature encoder (BCM numbers)."""

    pwm_channel: int
    forward_line: int
    reverse_line: int
    encoder_a: int
    encoder_b: int
    motor_reversed: bool = False
    encoder_reversed: bool = False


@dataclass(frozen=True, slots=True)
class OmniWheelsConfig:
    """The three wheels in the order of `OmniGeometry`: front right, front left, back.

    A Pi has two hardware PWM channels, so the three come of a PCA9685, which the kernel shows as a PWM chip too.
    """

    wheels: tuple[WheelConfig, WheelConfig, WheelConfig]
    pwm_chip: str = "/sys/class/pwm/pwmchip2"
    motor_hz: float = 1000.0  # a PCA9685 goes up to 1526, one rate for all its channels
    gpio_chip: str = "/dev/gpiochip0"
    max_duty: float = 1.0
    pull_up: bool = True  # open-collector encoders need it

    def __post_init__(self) -> None:
        if not 0 < self.max_duty <= 1:
            raise ValueError("max_duty must be in (0, 1]")
        if not 10 <= self.motor_hz <= 100_000:
            raise ValueError("motor_hz must be from 10 to 100000")
        if len({wheel.pwm_channel for wheel in self.wheels}) < len(self.wheels):
            raise ValueError("pwm_channel must differ from wheel to wheel")

    def lines(self) -> tuple[int, ...]:
        """All that are used of the GPIO chip."""
        return tuple(line for w in self.wheels for line in (w.forward_line, w.reverse_line, w.encoder_a, w.encoder_b))


@dataclass(frozen=True, slots=True)
class ThermometerConfig:
    zone: str = "/sys/class/thermal/thermal_zone0/temp"
    cooling: str = "/sys/class/thermal"  # where the kernel's fan is found
    throttled: str = "/sys/devices/platform/soc/soc:firmware/get_throttled"  # of Raspberry Pi OS; may be missing


@dataclass(frozen=True, slots=True)
class DeviceConfig:
    scanner: ScannerConfig = field(default_factory=ScannerConfig)
    camera: DepthCameraConfig = field(default_factory=DepthCameraConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    magnetometer: MagnetometerConfig = field(default_factory=MagnetometerConfig)
    power: PowerConfig = field(default_factory=PowerConfig)
    encoders: EncoderConfig = field(default_factory=EncoderConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    thermometer: ThermometerConfig = field(default_factory=ThermometerConfig)
    omni: OmniWheelsConfig | None = None  # in place of encoders and drive

    def __post_init__(self) -> None:
        e, d = self.encoders, self.drive
        if self.omni is not None:
            used = [(self.omni.gpio_chip, line) for line in self.omni.lines()]
        else:
            used = [(e.chip, line) for line in (e.left_a, e.left_b, e.right_a, e.right_b)]
            used += [(d.gpio_chip, line) for line in (d.forward_line, d.reverse_line)]
        beyond = sorted({line for _, line in used if not 0 <= line <= _LAST_LINE})
        if beyond:
            raise ValueError(f"GPIO lines are from 0 to {_LAST_LINE} (BCM numbers), not {', '.join(map(str, beyond))}")
        twice = sorted({line for chip, line in used if used.count((chip, line)) > 1})
        if twice:
            raise ValueError(f"GPIO lines used twice: {', '.join(map(str, twice))}")


def _check_axes(axes: tuple[Axis, Axis, Axis]) -> None:
    if sorted(axis[-1] for axis in axes) != ["x", "y", "z"]:
        raise ValueError(f"axes must name x, y and z once each, not {', '.join(axes)}")


def _check_address(address: int) -> None:
    if not 0x08 <= address <= 0x77:
        raise ValueError(f"address must be from 0x08 to 0x77, not {address:#x}")
