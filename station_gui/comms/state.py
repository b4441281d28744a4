"""Words for what happens on the link."""

from __future__ import annotations

from enum import IntEnum


class LinkState(IntEnum):
    DISCONNECTED = 0
    CONNECTING = 1
    CONNECTED = 2
    LOST = 3  # was connected; the session tries again by itself


class Severity(IntEnum):
    INFO = 0
    WARNING = 1
    ERROR = 2
