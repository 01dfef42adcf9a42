"""Names for the kinds of values that the public functions take."""

from typing import TYPE_CHECKING, TypeAlias, Union

import numpy as np
import numpy.typing as npt
import warp as wp

if TYPE_CHECKING:
    from .transform import Transform

ArrayLike: TypeAlias = npt.ArrayLike
Placement: TypeAlias = Union["Transform", npt.ArrayLike, None]
"""A Transform, an affine (4, 4) matrix, or None for the identity."""
Array: TypeAlias = np.ndarray | wp.array
