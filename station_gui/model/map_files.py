"""Maps kept in files, beside the mapping, which goes on meanwhile; the journal tells the outcome."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from station_gui.export.bundle import export_map
from station_gui.export.files import ExportError
from station_gui.mapping.pipeline import MappingPipeline, OpenedMap
from station_gui.mapping.saved_map import SavedMap, read_map, write_map
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import MapSnapshot, Tracking
from station_gui.model.journal import Journal
from station_gui.model.view import Severity

_WAITING = 8  # the oldest wish gives way
_EXPORTS = 2  # that may wait

_TOLD = {
    Tracking.LOCATED: (Severity.INFO, "the robot's place in the map is known"),
    Tracking.SEARCHING: (Severity.WARNING, "the robot's place is not known: it is looked for in the map"),
    Tracking.LOST: (Severity.WARNING, "lost: no place of the map fits what the robot sees"),
    Tracking.APART: (
        Severity.WARNING,
        "the robot is in a piece of map that is not joined to the rest, and may lie wrong",
    ),
}


@dataclass(frozen=True, slots=True)
class _Wish:
    path: Path
    save: bool
    fixed: bool = False


@dataclass(slots=True)
class _Job:
    """A wish on its way: `saved` is to be written, or `opened` was read."""

    wish: _Wish
    saved: SavedMap | None = None
    opened: OpenedMap | None = None


class MapFiles:
    """One wish after the other. Wishes come from any thread.

    `step` and `tell` are called by the mapping's thread, `work` by one that may take its time: it writes what was
    mapped until then, and reads and draws what the mapping is to go on with.
    """

    def __init__(self, journal: Journal, pipeline: MappingPipeline) -> None:
        self._journal = journal
        self._pipeline = pipeline
        self._wishes: deque[_Wish] = deque(maxlen=_WAITING)
        self._lock = threading.Lock()
        self._job: _Job | None = None
        self._told = Tracking.LOCATED
        self._exports: deque[tuple[MapSnapshot, Path]] = deque(maxlen=_EXPORTS)

    def export(self, snapshot: MapSnapshot | None, folder: Path) -> None:
        """Write the map as it is now in the formats that other programs read."""
        if snapshot is None:
            self._journal.add(Severity.WARNING, "there is no map yet to export")
            return
        with self._lock:
            self._exports.append((snapshot, folder))

    def save(self, path: Path) -> None:
        with self._lock:
            self._wishes.append(_Wish(path, save=True))

    def open(self, path: Path, *, fixed: bool) -> None:
        with self._lock:
            self._wishes.append(_Wish(path, save=False, fixed=fixed))

    def step(self) -> bool:
        """Hand on what is wished, take over what was read; True when another map is in use."""
        job = self._job
        if job is not None and job.opened is None:
            return False
        if job is not None and job.opened is not None:
            self._pipeline.adopt(job.opened)
            purpose = "to localise in, it is not changed" if job.wish.fixed else "to go on with"
            self._tell_of("map opened " + purpose, job.wish, f"{len(job.opened.given.keyframes)} scans")
            self._job = None
            return True
        self._begin_job()
        return False

    def work(self) -> None:
        """Write or read, if there is anything to."""
        self._export()
        job = self._job
        if job is None or job.opened is not None:
            return
        try:
            if job.saved is not None:
                self._write(job.saved, job.wish)
            else:
                job.opened = self._pipeline.prepare(read_map(job.wish.path), fixed=job.wish.fixed)
        except MappingError as error:
            self._journal.add(Severity.ERROR, str(error))
        finally:
            if job.opened is None:
                self._job = None

    def finish(self) -> None:
        """Write what is still to be saved; call it after the tasks have ended."""
        if self._job is not None and self._job.saved is not None:
            self.work()
        self._job = None
        with self._lock:
            waiting = [wish for wish in self._wishes if wish.save]
            self._wishes = deque(waiting, _WAITING)
        for _ in waiting:
            self._begin_job()
            self.work()
        for _ in range(_EXPORTS):
            self._export()

    def tell(self, tracking: Tracking) -> None:
        """When it has changed."""
        if tracking is not self._told:
            self._told = tracking
            self._journal.add(*_TOLD[tracking])

    def _export(self) -> None:
        with self._lock:
            wish = self._exports.popleft() if self._exports else None
        if wish is None:
            return
        snapshot, folder = wish
        try:
            written = export_map(snapshot, folder)
        except ExportError as error:
            self._journal.add(Severity.ERROR, str(error))
            return
        names = ", ".join(path.name for path in written)
        self._journal.add(Severity.INFO, f"map exported to {folder}: {names}")

    def _begin_job(self) -> None:
        with self._lock:
            wish = self._wishes.popleft() if self._wishes else None
        if wish is None:
            return
        try:
            self._job = _Job(wish, self._pipeline.saved_map() if wish.save else None)
        except MappingError as error:
            self._journal.add(Severity.ERROR, str(error))

    def _write(self, saved: SavedMap, wish: _Wish) -> None:
        write_map(saved, wish.path)
        size_kb = wish.path.stat().st_size / 1000
        self._tell_of("map saved", wish, f"{len(saved.keyframes)} scans, {size_kb:.0f} kB")

    def _tell_of(self, done: str, wish: _Wish, what: str) -> None:
        self._journal.add(Severity.INFO, f"{done}: {wish.path}, {what}")
