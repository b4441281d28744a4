"""The camera's driver with the camera in a process of its own: a real child, a real memory, a stand-in library."""

from __future__ import annotations

import ast
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from robot_app.drivers.base import DepthImage, DeviceError
from robot_app.drivers.camera_process import program
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.l515 import RealSenseCamera
from shared.runtime.clock import Clock, ManualClock, MonotonicClock

LIBRARY = Path(__file__).with_name("camera_library")
WIDTH, HEIGHT = 64, 48
READ_S = 5.0
OTHERS: set[int] = set()  # the test run's own, as its display
Open = Callable[..., RealSenseCamera]

GARBAGE = {
    "nothing known": "b'garbage'",
    "another kind": "p.STARTED.pack(7, 64, 48, 45, 45, 32, 24, 1e-3)",
    "another size": "p.STARTED.pack(1, 1 << 31, 48, 45, 45, 32, 24, 1e-3)",
    "no number": "p.STARTED.pack(1, 64, 48, float('nan'), 45, 32, 24, 1e-3)",
    "no scale": "p.STARTED.pack(1, 64, 48, 45, 45, 32, 24, -1.0)",
    "too much": "bytes(4096)",
}
FRAME_GARBAGE = {
    "a frame of another request": "p.FRAME.pack(2, number + 1, 1, 1.0, 6144)",
    "a frame too long": "p.FRAME.pack(2, number, 1, 1.0, 1 << 31)",
    "a time that is none": "p.FRAME.pack(2, number, 1, float('inf'), 6144)",
    "nothing for another request": "p.NOTHING.pack(3, number + 1)",
    "a cut message": "p.NOTHING.pack(3, number)[:4]",
}


def config(interpreter: str = sys.executable) -> DepthCameraConfig:
    return DepthCameraConfig(interpreter=interpreter, width=WIDTH, height=HEIGHT, silence_s=0.2, start_up_s=0.3)


@pytest.fixture
def open_camera(monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """A driver whose camera does as told; nothing of it is left behind."""
    monkeypatch.setenv("PYTHONPATH", str(LIBRARY))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    OTHERS.update(children())
    before = open_files()
    with ExitStack() as opened:

        def plug(does: str, clock: Clock | None = None, interpreter: str = sys.executable) -> RealSenseCamera:
            monkeypatch.setenv("CAMERA", does)
            driver = RealSenseCamera(config(interpreter), clock or MonotonicClock())
            opened.callback(driver.close)
            return driver

        yield plug
    assert children() == []
    assert open_files() == before


@pytest.fixture
def impostor(tmp_path: Path) -> Callable[[str], str]:
    """An interpreter that says something else than the camera process does."""

    def write(words: str) -> str:
        path = tmp_path / "python"
        path.write_text(
            f"#!{sys.executable}\nimport socket, sys\nsys.path.insert(0, {str(Path(program.__file__).parent)!r})\n"
            f"import program as p\nchannel = socket.socket(fileno=int(sys.argv[3]))\n{words}\n",
            encoding="utf-8",
        )
        path.chmod(0o755)
        return str(path)

    return write


def children() -> list[int]:
    words = Path(f"/proc/self/task/{os.getpid()}/children").read_text("ascii").split()
    return [pid for pid in map(int, words) if pid not in OTHERS]


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def next_image(driver: RealSenseCamera) -> DepthImage:
    image = driver.read(READ_S)
    assert image is not None
    return image


def test_frames_come_whole_and_in_order(open_camera: Open) -> None:
    driver = open_camera("frames")
    images = [next_image(driver) for _ in range(5)]
    for number, image in enumerate(images, 1):  # none was fetched before it was asked for
        assert image.depth.shape == (HEIGHT, WIDTH)
        assert not image.depth.flags.writeable
        np.testing.assert_array_equal(image.depth, number)
    assert images[0].unit_m == 0.00025
    assert (driver.intrinsics.width, driver.intrinsics.fx, driver.intrinsics.cx) == (WIDTH, 45.0, 32.0)
    assert driver.model == "L515  [2J"
    assert driver.where == f"a process of {sys.executable}"


def test_a_killed_process_is_an_error_and_is_started_again(open_camera: Open) -> None:
    clock = ManualClock()
    driver = open_camera("frames", clock)
    assert next_image(driver).depth[0, 0] == 1
    (child,) = children()
    os.kill(child, signal.SIGKILL)
    with pytest.raises(DeviceError, match="its process has ended"):
        driver.read(READ_S)
    assert children() == []
    with pytest.raises(DeviceError, match="its process has ended"):  # too early
        driver.read(READ_S)
    clock.advance(2.1)
    assert next_image(driver).depth[0, 0] == 1


def test_a_start_is_waited_for_no_longer_than_the_reader_says(open_camera: Open) -> None:
    clock = ManualClock()
    driver = open_camera("frames", clock)
    os.kill(children()[0], signal.SIGKILL)
    with pytest.raises(DeviceError):
        driver.read(READ_S)
    clock.advance(2.1)
    with pytest.raises(DeviceError, match="has ended"):  # starting: the fault stands until a frame has come
        driver.read(0.001)
    assert len(children()) == 1
    assert next_image(driver).depth[0, 0] == 1


def test_a_lost_camera_ends_its_process(open_camera: Open) -> None:
    driver = open_camera("lost")
    next_image(driver)
    with pytest.raises(DeviceError, match="lost: Device disconnected"):
        driver.read(READ_S)
    assert children() == []


def test_a_process_that_hangs_is_killed(open_camera: Open) -> None:
    driver = open_camera("hangs")
    next_image(driver)
    with pytest.raises(DeviceError, match="its process hangs"):
        for _ in range(100):
            assert driver.read(0.05) is None
    assert children() == []


def test_a_start_that_hangs_is_given_up(open_camera: Open) -> None:
    class Hasty(MonotonicClock):
        def now_s(self) -> float:
            return super().now_s() * 50

    with pytest.raises(DeviceError, match="its process does not start"):
        open_camera("hangs_at_start", Hasty())
    assert children() == []


def test_an_answer_that_comes_late_is_not_handed_out(open_camera: Open) -> None:
    driver = open_camera("late")
    assert driver.read(0.01) is None
    assert next_image(driver).depth[0, 0] == 2


def test_a_camera_that_sends_nothing_is_reset(open_camera: Open, capfd: pytest.CaptureFixture[str]) -> None:
    driver = open_camera("silent")
    with pytest.raises(DeviceError, match="sends no frames"):
        for _ in range(100):
            driver.read(0.05)
    assert "camera is reset" in capfd.readouterr().err


def test_a_frame_of_another_time_is_not_handed_out(open_camera: Open, impostor: Callable[[str], str]) -> None:
    """The camera's clock jumped back: what it sends cannot be told from old frames."""
    script = (
        "channel.send(p.STARTED.pack(1, 64, 48, 45, 45, 32, 24, 1e-3) + b'jumps')\n"
        "for time_ms in (90e3, 10e3):\n    number, _ = p.REQUEST.unpack(channel.recv(100))\n"
        "    channel.send(p.FRAME.pack(2, number, 1, time_ms, 6144))\nchannel.recv(1)"
    )
    driver = open_camera("frames", interpreter=impostor(script))
    next_image(driver)
    assert driver.read(READ_S) is None


def test_what_hinders_the_start_is_explained(open_camera: Open) -> None:
    with pytest.raises(DeviceError, match="is it plugged into a blue USB 3 port"):
        open_camera("absent")
    with pytest.raises(
        DeviceError, match=r"devices\.camera\.interpreter /nowhere/python3\.9 cannot be started: .*install\.sh"
    ):
        open_camera("frames", interpreter="/nowhere/python3.9")
    with pytest.raises(DeviceError, match="its process has ended"):
        open_camera("frames", interpreter="/bin/true")


def test_an_interpreter_without_the_library_is_named(open_camera: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONPATH")
    with pytest.raises(DeviceError, match=f"{sys.executable}: No module named 'pyrealsense2'"):
        open_camera("frames", interpreter=sys.executable)


@pytest.mark.parametrize("words", GARBAGE.values(), ids=GARBAGE.keys())
def test_garbage_at_the_start_is_an_error(open_camera: Open, impostor: Callable[[str], str], words: str) -> None:
    with pytest.raises(DeviceError, match="garbage"):
        open_camera("frames", interpreter=impostor(f"channel.send({words})\nchannel.recv(1)"))


@pytest.mark.parametrize("words", FRAME_GARBAGE.values(), ids=FRAME_GARBAGE.keys())
def test_garbage_for_a_frame_is_an_error(open_camera: Open, impostor: Callable[[str], str], words: str) -> None:
    script = (
        "channel.send(p.STARTED.pack(1, 64, 48, 45, 45, 32, 24, 1e-3) + b'impostor')\n"
        f"number, _ = p.REQUEST.unpack(channel.recv(100))\nchannel.send({words})\nchannel.recv(1)"
    )
    driver = open_camera("frames", interpreter=impostor(script))
    with pytest.raises(DeviceError, match="garbage"):
        driver.read(READ_S)


def test_the_process_cannot_shrink_the_memory(open_camera: Open, impostor: Callable[[str], str]) -> None:
    script = (
        "import os\ntry:\n    os.ftruncate(int(sys.argv[4]), 0)\nexcept OSError as error:\n"
        "    channel.send(bytes([4]) + str(error).encode())"
    )
    with pytest.raises(DeviceError, match="Operation not permitted"):
        open_camera("frames", interpreter=impostor(script))


def test_the_process_ends_with_the_app(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{LIBRARY}:{Path.cwd()}")
    monkeypatch.setenv("CAMERA", "frames")
    app = (
        "import os, signal, sys\nfrom pathlib import Path\n"
        "from robot_app.drivers.config import DepthCameraConfig\nfrom robot_app.drivers.l515 import RealSenseCamera\n"
        "from shared.runtime.clock import MonotonicClock\n"
        "camera = RealSenseCamera(DepthCameraConfig(interpreter=sys.executable, width=64, height=48), MonotonicClock())"
        "\nassert camera.read(5.0) is not None\n"
        "sys.stdout.write(Path(f'/proc/self/task/{os.getpid()}/children').read_text())\nsys.stdout.flush()\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", app], stdout=subprocess.PIPE, timeout=30, check=False)
    child = int(done.stdout)
    assert done.returncode == -signal.SIGKILL
    try:
        waiting = os.pidfd_open(child)
    except ProcessLookupError:
        return
    with open(waiting, "rb") as handle:  # noqa: PTH123 - a descriptor
        assert select.select([handle], [], [], 5.0)[0], "it still runs"


def test_the_program_is_python_3_9_and_needs_nothing_of_the_project() -> None:
    tree = ast.parse(Path(program.__file__).read_text("utf-8"), feature_version=(3, 9))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported - set(sys.stdlib_module_names) == {"pyrealsense2"}


def test_a_relative_interpreter_is_refused() -> None:
    with pytest.raises(ValueError, match="whole path"):
        config("python3.9")
