"""Launching a leaf on its own: a kernel of a test calls it once for each row of its inputs."""

import inspect

import numpy as np
import warp as wp

OPTIONS = {"fast_math": False, "fuse_fp": False}
"""Those of the kernels that are shipped."""


def leaf_kernel(function):
    """Decorator of a test's kernel: its array arguments have one row per thread, outputs come last."""
    return wp.kernel(function, module="unique", enable_backward=False, module_options=OPTIONS)


def scalar_of(dtype) -> np.dtype:
    """NumPy's name of a Warp type, or of the components of one."""
    return np.dtype(wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype)))


def rounded(values, real) -> np.ndarray:
    """Values as a kernel will see them, so that a test measures the kernel's error and not that of its input."""
    return np.asarray(values, dtype=scalar_of(real))


def roundoff(real) -> float:
    """Half the distance from 1 to the next number."""
    return float(np.finfo(scalar_of(real)).eps) / 2


def launch(kernel, *inputs, device):
    """Calls a kernel for each row and returns its outputs, which are the arguments after the inputs.

    Inputs are rounded to the types that the kernel declares; one without rows is the same for all of them.
    What the kernel does not declare as an array is handed over as it is.
    """
    types = [parameter.annotation for parameter in inspect.signature(kernel.func).parameters.values()]
    arrays = [
        np.asarray(value, dtype=scalar_of(kind.dtype)) if isinstance(kind, wp.array) else None
        for value, kind in zip(inputs, types, strict=False)
    ]
    count = 1
    for array, kind in zip(arrays, types, strict=False):
        if array is not None and array.ndim > len(row_of(kind)):
            count = len(array)
    arguments = [
        value
        if array is None
        else wp.array(
            np.ascontiguousarray(np.broadcast_to(array, (count, *row_of(kind)))), dtype=kind.dtype, device=device
        )
        for value, array, kind in zip(inputs, arrays, types, strict=False)
    ]
    outputs = [wp.zeros(count, dtype=kind.dtype, device=device) for kind in types[len(inputs) :]]
    wp.launch(kernel, dim=count, inputs=arguments, outputs=outputs, device=device)
    results = [output.numpy() for output in outputs]
    return results[0] if len(results) == 1 else results


def row_of(kind) -> tuple[int, ...]:
    """Shape of one element of an array."""
    return tuple(getattr(kind.dtype, "_shape_", ()))
