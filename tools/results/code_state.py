"""Which state of the mapping a figure was measured with."""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
_MAPPING = ("station_gui/mapping", "station_gui/build.py", "station_gui/config.py", "station_gui/station.toml")
_TIMEOUT_S = 20


def mapping_code(root: Path = _ROOT) -> str:
    """A short hash of everything that decides on a map."""
    digest = hashlib.sha256()
    for path in sorted(_files(root)):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:12]


def measured_at(root: Path = _ROOT) -> dict[str, str | float]:
    """`load`: how many tasks wanted a core in the last minute, ours not yet among them."""
    commit = _git(root, "rev-parse", "--short", "HEAD")
    changed = "+" if _git(root, "status", "--porcelain", "--", *_MAPPING) else ""
    return {"code": mapping_code(root), "commit": commit + changed, "load": round(os.getloadavg()[0], 1)}


def _files(root: Path) -> list[Path]:
    found: list[Path] = []
    for name in _MAPPING:
        path = root / name
        found += path.rglob("*.py") if path.is_dir() else [path]
    return found


def _git(root: Path, *words: str) -> str:
    """Empty where there is no repository."""
    try:
        done = subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
        )
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
