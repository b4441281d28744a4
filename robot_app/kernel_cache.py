"""Compiled kernels are kept on the card; a robot that is switched off meanwhile leaves files of nothing there.

numba writes a file and puts it in its place, but does not force it to the disk, and stumbles over what is left: without
this the app would never start again.
"""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Callable
from pathlib import Path

_log = logging.getLogger(__name__)
# What unpickling raises (Python's documentation of the module pickle).
_SPOILT = (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError)
_KINDS = ("nbi", "nbc")


def compile_all(warm_up: Callable[[], None], folder: str | None) -> None:
    """Call `warm_up`; where kept kernels are spoilt, again without them. `folder`: NUMBA_CACHE_DIR, None without it.

    What was compiled is on the card when this returns.
    """
    before = _files(folder)
    try:
        warm_up()
    except _SPOILT as error:
        if not before:
            raise
        _log.warning("the compiled kernels in %s are spoilt (%r): compiling anew", folder, error)
        for file in _files(folder):
            file.unlink(missing_ok=True)
        warm_up()
    if _files(folder) != before:
        os.sync()


def _files(folder: str | None) -> set[Path]:
    return {file for kind in _KINDS for file in Path(folder).rglob(f"*.{kind}")} if folder else set()
