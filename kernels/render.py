"""The kernel that makes pictures."""

from functools import cache

import warp as wp

from .camera import PRIMARY_RAY, sample_position
from .shade import make_radiance
from .spec import Look, Projection
from .structs import camera_struct, look_struct, path_struct, scene_struct, vec3


@cache
def make_render(look: Look, projection: Projection = Projection.PINHOLE):
    """Mean colour of each pixel over its samples, row by row from the top; of one projection, no other is there."""
    Scene, Lights, Camera = scene_struct(look.spec), look_struct(look), camera_struct(projection)
    primary_ray, is_round = PRIMARY_RAY[projection], projection is Projection.FISHEYE
    radiance, vec, Path, has_chance = make_radiance(look), vec3(look.spec.tier.wide), path_struct(look), look.has_chance

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
            o, d = primary_ray(camera, column + x, row + y)
            path = Path()
            path.o = vec(o)
            path.d = vec(d)
            if wp.static(has_chance):
                path.pixel = pixel
                path.sample = k
            if wp.static(is_round):
                # Outside the circle nothing is seen, not even the background.
                if wp.length_sq(d) > wp.float64(0.0):
                    total += radiance(scene, lights, path, max_bounces)
            else:
                total += radiance(scene, lights, path, max_bounces)
        color[pixel] = total / wp.float32(samples)

    return render
