"""The type of nearly all arrays, and how what is given becomes one."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def real_numbers(values: ArrayLike) -> Array:
    """A copy of the values, which are NaN where a mask hides them.

    Raises:
        TypeError, ValueError: they are no real numbers.
    """
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    if np.iscomplexobj(values) or kind in ("m", "M"):  # numpy drops the half, or counts from 1970
        raise TypeError
    if isinstance(values, np.ma.MaskedArray):  # numpy takes what is under the mask
        values = np.ma.filled(values.astype(np.float64), np.nan)
    return np.array(values, dtype=np.float64)
