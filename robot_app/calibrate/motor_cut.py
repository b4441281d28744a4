"""A process that cuts the motor when this one ends, however it ends: a kernel's PWM outlives its writer."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import TracebackType

from robot_app.calibrate.guide import CalibrationError

_ENDS_WITHIN_S = 2.0
# It reads from a pipe that this process holds open and never writes: the end of the pipe is the end of this process.
_SCRIPT = 'trap "" HUP INT TERM; cat >/dev/null; for duty; do echo 0 >"$duty"; done'


class MotorCut:
    """While it is entered somebody watches. Not needed under systemd, which does the same by ExecStopPost."""

    def __init__(self, pwm_chip: str, channel: int) -> None:
        self._duty = Path(pwm_chip) / f"pwm{channel}" / "duty_cycle"

    def __enter__(self) -> MotorCut:
        try:
            self._process = subprocess.Popen(
                ["/bin/sh", "-c", _SCRIPT, "motor-cut", str(self._duty)], stdin=subprocess.PIPE, start_new_session=True
            )
        except OSError as error:
            raise CalibrationError(f"nothing may move: the watch over the motor cannot be started: {error}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(_ENDS_WITHIN_S)
