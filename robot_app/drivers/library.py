"""The libraries of the devices are loaded when a device is opened: the commands and their help work without them."""

from __future__ import annotations

import importlib
from typing import Any

from robot_app.drivers.base import DeviceError


def load_library(name: str, device: str) -> Any:
    """The module `name`. Raises `DeviceError` that names the missing package and how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        reason = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be loaded ({error})"
        raise DeviceError(f"{device}: the Python package {package} {reason}; run: pip install '.[robot]'") from error
