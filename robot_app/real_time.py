"""Memory that stays in RAM and tasks that go before everything else, as far as the limits of the process permit it.

systemd/robot-app.service sets the limits. Without them, in a test or in a shell, nothing is asked for, whatever the
user might be allowed: a task that never ends would take the machine with it.
"""

from __future__ import annotations

import ctypes
import logging
import os
import resource

from shared.runtime.runner import Row

_log = logging.getLogger(__name__)
_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8  # malloc.h
_ARENAS, _LARGE_BYTES = 2, 128 * 1024
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # linux/mman.h


def _is_unlimited(limit: int) -> bool:
    return resource.getrlimit(limit)[0] == resource.RLIM_INFINITY


def lock_memory() -> bool:
    """Whether every page stays in RAM once it was touched.

    Pages that are not touched are not fetched: a thread's stack of 8 MB would else be in RAM as a whole. Under a limit
    nothing is locked, since memory asked for beyond it would be refused later, while driving.
    """
    if not _is_unlimited(resource.RLIMIT_MEMLOCK):
        return False
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0:
        return True
    _log.warning("memory cannot be locked: %s", os.strerror(ctypes.get_errno()))
    return False


def steady_memory() -> None:
    """Give back what is freed, so that the memory in use says something: call it before the tasks' threads begin.

    glibc gives each thread an arena of its own, which keeps what was the largest ever needed: they grow for minutes.
    Large arrays, as depth images are, are mapped and given back instead.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):  # glibc
        library.mallopt(_M_ARENA_MAX, _ARENAS)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        library.malloc_trim(0)


def highest_priority() -> int:
    """The FIFO priority that a thread may take; 0 for none."""
    if _is_unlimited(resource.RLIMIT_RTPRIO):
        return os.sched_get_priority_max(os.SCHED_FIFO)
    return resource.getrlimit(resource.RLIMIT_RTPRIO)[0]


def take_priority(row: Row) -> None:
    """For the calling thread; called at the start of each task. What a task starts, as a process, does not inherit."""
    if not 0 < row.priority <= highest_priority():
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(row.priority))
    except OSError as error:  # a container may forbid it whatever the limit
        _log.warning("%s runs without priority: %s", row.name, error)


def ask_for_real_time() -> None:
    """Lock the memory and say in one line what the system permits."""
    memory = "memory is locked" if lock_memory() else "memory is not locked"
    highest = highest_priority()
    _log.info("real time: %s, %s", memory, f"FIFO priority up to {highest}" if highest else "no FIFO priority")
