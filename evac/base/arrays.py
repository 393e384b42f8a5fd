"""Types of arrays, and views that plugins cannot write to."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: Remedy for a plugin that has written to an array that it may only read.
COPY = "its arguments are read-only: change a copy"


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a view of an array that cannot be written to."""
    view = values.view()
    view.flags.writeable = False
    return view


def pairs_of(values: FloatArray) -> NDArray[np.complex128]:
    """Return a view (n,) of pairs (n, 2), which NumPy copies ten times faster where each is one number."""
    pairs: NDArray[np.complex128] = values.view(np.complex128)[:, 0]
    return pairs


def as_floats(values: Any) -> FloatArray:
    """Return what a plugin has returned as float64; NumPy would drop the imaginary part of complex numbers."""
    if np.iscomplexobj(values):
        raise TypeError("complex numbers were returned, not real ones")
    return np.asarray(values, np.float64)
