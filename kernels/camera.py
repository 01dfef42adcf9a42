"""Primary rays: (origin, direction) through a point of the picture. (0.5, 0.5) is the centre of the top left pixel."""

import warp as wp

from .spec import Projection
from .structs import camera_struct

Pinhole = camera_struct(Projection.PINHOLE)
Orthographic = camera_struct(Projection.ORTHOGRAPHIC)
Fisheye = camera_struct(Projection.FISHEYE)
Equirectangular = camera_struct(Projection.EQUIRECTANGULAR)


@wp.func
def ray_pinhole(camera: Pinhole, column: wp.float64, row: wp.float64):
    """The picture is a plane of directions, not unit, before a point."""
    return camera.position, camera.corner + column * camera.right + row * camera.down


@wp.func
def ray_orthographic(camera: Orthographic, column: wp.float64, row: wp.float64):
    """The picture is a plane of origins."""
    return camera.corner + column * camera.right + row * camera.down, camera.forward


@wp.func
def ray_fisheye(camera: Fisheye, column: wp.float64, row: wp.float64):
    """The distance from the picture's centre is the angle from `forward`; outside the circle the direction is 0."""
    half = wp.float64(0.5)
    x, y = column - half * wp.float64(camera.width), half * wp.float64(camera.height) - row
    # Without rounding under the root, so that pixels alike to the circle are all inside, or none.
    r = wp.sqrt(x * x + y * y)
    if r > half * wp.float64(camera.height):
        return camera.position, wp.vec3d()
    theta, ratio = r * camera.along, wp.float64(0.0)
    if r > wp.float64(0.0):
        ratio = wp.sin(theta) / r
    return camera.position, wp.cos(theta) * camera.forward + ratio * (x * camera.right + y * camera.up)


@wp.func
def ray_equirectangular(camera: Equirectangular, column: wp.float64, row: wp.float64):
    """Columns are longitudes and rows latitudes, both 0 in the middle."""
    half = wp.float64(0.5)
    longitude = (column - half * wp.float64(camera.width)) * camera.across
    latitude = (half * wp.float64(camera.height) - row) * camera.along
    level = wp.sin(longitude) * camera.right + wp.cos(longitude) * camera.forward
    return camera.position, wp.cos(latitude) * level + wp.sin(latitude) * camera.up


PRIMARY_RAY = {
    Projection.PINHOLE: ray_pinhole,
    Projection.ORTHOGRAPHIC: ray_orthographic,
    Projection.FISHEYE: ray_fisheye,
    Projection.EQUIRECTANGULAR: ray_equirectangular,
}


@wp.func
def sample_position(sample: int):
    """Where in its pixel a sample lies, in [0, 1)^2: the additive recurrence R2 (Roberts 2018), from the centre."""
    k = wp.float64(sample)
    half = wp.float64(0.5)
    # 1/g and 1/g^2 for the plastic number g; float32 literals do, since any irrational steps spread evenly.
    x = half + k * wp.float64(0.7548776662)
    y = half + k * wp.float64(0.5698402910)
    return x - wp.floor(x), y - wp.floor(y)
