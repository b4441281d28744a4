"""Tells the operator when one of our radios fails, and when it is back."""

from __future__ import annotations

import math

from shared.link.base import Link
from station_gui.comms.state import Severity

_EVERY_S = 0.5
_OPERATES, _SILENT = "operates", "the module does not answer"


class RadioWatch:
    """Of one link."""

    def __init__(self) -> None:
        self._looked_s = -math.inf
        self._states: dict[str, str] = {}  # as the operator was told

    def news(self, link: Link, now_s: float) -> list[tuple[Severity, str]]:
        """What has changed since it was last told."""
        if not link.mends_itself or now_s < self._looked_s + _EVERY_S:
            return []
        self._looked_s = now_s
        told: list[tuple[Severity, str]] = []
        for name, radio in zip("AB", link.health.radios, strict=False):
            before = self._states.get(name, "")
            now = radio.fault or (_OPERATES if radio.operates else _SILENT)
            if now == before or (now == _SILENT and not before):  # not yet brought up is no news
                continue
            self._states[name] = now
            told.append((Severity.INFO if now == _OPERATES else Severity.WARNING, f"radio {name}: {now}"))
        return told
