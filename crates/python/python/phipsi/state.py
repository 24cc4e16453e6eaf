"""The state of a simulator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["State"]


class State(NamedTuple):
    """Time (s), configuration (nq,) and velocity (nv,)."""

    t: float
    q: NDArray[np.float64]
    v: NDArray[np.float64]
