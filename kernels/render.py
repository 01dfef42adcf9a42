"""The kernel that makes pictures."""

from functools import cache

import warp as wp

from .camera import primary_direction, sample_position
from .shade import make_radiance
from .spec import Look
from .structs import camera_struct, look_struct, scene_struct, vec3

Camera = camera_struct()


@cache
def make_render(look: Look):
    """Mean colour of each pixel over its samples, row by row from the top."""
    Scene, Lights = scene_struct(look.spec), look_struct(look)
    radiance, vec = make_radiance(look), vec3(look.spec.tier.wide)

    @wp.kernel(module="unique", enable_backward=False, module_options=look.spec.tier.options)
    def render(
        scene: Scene,
        lights: Lights,
        camera: Camera,
        samples: int,
        max_bounces: int,
        color: wp.array(dtype=wp.vec3f),
        first: int,
    ):
        pixel = first + wp.tid()
        row, column = wp.float64(pixel / camera.width), wp.float64(pixel % camera.width)
        total = wp.vec3f()
        for k in range(samples):
            x, y = sample_position(k)
            d = primary_direction(camera, column + x, row + y)
            total += radiance(scene, lights, vec(camera.position), vec(d), max_bounces)
        color[pixel] = total / wp.float32(samples)

    return render
