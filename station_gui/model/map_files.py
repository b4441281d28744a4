"""Maps kept in files: the mapping's thread does what the operator asks, and the journal tells the outcome."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import read_map, write_map
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import Tracking
from station_gui.model.journal import Journal
from station_gui.model.view import Severity

_WAITING = 8  # the oldest wish gives way

_TOLD = {
    Tracking.LOCATED: (Severity.INFO, "the robot's place in the map is known"),
    Tracking.SEARCHING: (Severity.WARNING, "the robot's place is not known: it is looked for in the map"),
    Tracking.LOST: (Severity.WARNING, "lost: no place of the map fits what the robot sees"),
    Tracking.APART: (
        Severity.WARNING,
        "the robot was not found again: a new piece of map begins, where it may be wrong",
    ),
}


@dataclass(frozen=True, slots=True)
class _Wish:
    path: Path
    save: bool
    fixed: bool = False


class MapFiles:
    """Wishes come from any thread; `step` and `tell` are called by the mapping's."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._wishes: deque[_Wish] = deque(maxlen=_WAITING)
        self._lock = threading.Lock()
        self._told = Tracking.LOCATED

    def save(self, path: Path) -> None:
        with self._lock:
            self._wishes.append(_Wish(path, save=True))

    def open(self, path: Path, *, fixed: bool) -> None:
        with self._lock:
            self._wishes.append(_Wish(path, save=False, fixed=fixed))

    def step(self, pipeline: MappingPipeline) -> bool:
        """Do what is wished; True when another map is in use."""
        opened = False
        while (wish := self._next()) is not None:
            try:
                if wish.save:
                    self._write(pipeline, wish)
                else:
                    self._read(pipeline, wish)
                    opened = True
            except MappingError as error:
                self._journal.add(Severity.ERROR, str(error))
        return opened

    def tell(self, tracking: Tracking) -> None:
        """When it has changed."""
        if tracking is not self._told:
            self._told = tracking
            self._journal.add(*_TOLD[tracking])

    def _next(self) -> _Wish | None:
        with self._lock:
            return self._wishes.popleft() if self._wishes else None

    def _write(self, pipeline: MappingPipeline, wish: _Wish) -> None:
        saved = pipeline.saved_map()
        write_map(saved, wish.path)
        size_kb = wish.path.stat().st_size / 1000
        self._journal.add(Severity.INFO, f"map saved: {wish.path}, {len(saved.keyframes)} scans, {size_kb:.0f} kB")

    def _read(self, pipeline: MappingPipeline, wish: _Wish) -> None:
        saved = read_map(wish.path)
        pipeline.open_map(saved, fixed=wish.fixed)
        purpose = "to localise in, it is not changed" if wish.fixed else "to go on with"
        self._journal.add(Severity.INFO, f"map opened {purpose}: {wish.path}, {len(saved.keyframes)} scans")
