"""The real pyrealsense2, whose cameras are the recording that the environment names."""

import os
import sys
from pathlib import Path

sys.path.remove(str(Path(__file__).parent))
del sys.modules["pyrealsense2"]
import pyrealsense2 as real  # noqa: E402 - the next one on the path


class Recording:
    """Stands for `config`; the pipeline wants the library's own object."""

    def __new__(cls):
        request = _config()
        request.enable_device_from_file(os.environ["RECORDING"], repeat_playback=True)
        return request


_config, real.config = real.config, Recording
