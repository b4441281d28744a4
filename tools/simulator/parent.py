"""A program that ends when who started it does: its standard input comes to its end then."""

from __future__ import annotations

import os
import sys
import threading


def wait_for_parent() -> None:
    """Until the standard input has ended."""
    while os.read(sys.stdin.fileno(), 4096):  # a thread in `read` of a buffer would break the end of the process
        pass


def stop_with_parent(stop: threading.Event) -> None:
    """Set `stop` then, from a thread of its own."""

    def watch() -> None:
        wait_for_parent()
        stop.set()

    threading.Thread(target=watch, name="parent", daemon=True).start()
