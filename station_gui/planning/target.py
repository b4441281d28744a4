"""Where a path is to end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """`pose`: (3,), map frame; its heading does not matter where it is free.

    `headings_rad`: (K,), some with which the car has room there.
    """

    pose: NDArray[np.float64]
    free_heading: bool
    headings_rad: NDArray[np.float64]
