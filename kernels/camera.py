"""Primary rays of a pinhole camera."""

import warp as wp

from .structs import camera_struct

Camera = camera_struct()


@wp.func
def primary_direction(camera: Camera, column: wp.float64, row: wp.float64):
    """Direction through a point of the picture; (0.5, 0.5) is the centre of the top left pixel. Not unit."""
    return camera.corner + column * camera.right + row * camera.down


@wp.func
def sample_position(sample: int):
    """Where in its pixel a sample lies, in [0, 1)^2: the additive recurrence R2 (Roberts 2018), from the centre."""
    k = wp.float64(sample)
    half = wp.float64(0.5)
    # 1/g and 1/g^2 for the plastic number g; float32 literals do, since any irrational steps spread evenly.
    x = half + k * wp.float64(0.7548776662)
    y = half + k * wp.float64(0.5698402910)
    return x - wp.floor(x), y - wp.floor(y)
