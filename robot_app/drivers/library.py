"""The libraries of the devices are loaded when a device is opened: the commands and their help work without them."""

from __future__ import annotations

import importlib
from typing import Any

from robot_app.drivers.base import DeviceError


def load_library(name: str, device: str) -> Any:
    """The module `name`, of a library or of ours that imports one.

    Raises `DeviceError` that names the missing package and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = (error.name or name).partition(".")[0]
        raise DeviceError(
            f"{device}: the Python package {package} is not installed; run: pip install '.[robot]'"
        ) from error
    except ImportError as error:
        raise DeviceError(f"{device}: {name} does not load, a system library may be missing: {error}") from error
