"""The kernel that makes pictures."""

import warp as wp

from .camera import PRIMARY_RAY, sample_position
from .film import spread_after
from .making import once
from .shade import make_radiance
from .spec import Look, Projection
from .structs import camera_struct, film_struct, look_struct, path_struct, scene_struct, vec3


@once
def make_sample(look: Look, projection: Projection, is_measured: bool):
    """Colour of one sample of a pixel; of one projection, no other is there."""
    Scene, Lights, Camera = scene_struct(look.spec), look_struct(look), camera_struct(projection)
    Film = film_struct(is_measured, look.goes_on)
    primary_ray, is_round = PRIMARY_RAY[projection], projection is Projection.FISHEYE
    radiance, vec, Path, has_chance = make_radiance(look), vec3(look.spec.tier.wide), path_struct(look), look.has_chance
    goes_on = look.goes_on

    @wp.func
    def sample(scene: Scene, lights: Lights, camera: Camera, film: Film, at: int, k: int) -> wp.vec3d:
        pixel = film.first + at
        row, column = wp.float64(pixel / camera.width), wp.float64(pixel % camera.width)
        x, y = sample_position(k)
        o, d = primary_ray(camera, column + x, row + y)
        if wp.static(is_round):
            # Outside the circle nothing is seen, not even the background.
            if not wp.length_sq(d) > wp.float64(0.0):
                return wp.vec3d()
        path = Path()
        path.o = vec(o)
        path.d = vec(d)
        if wp.static(has_chance):
            path.pixel = pixel
            path.sample = k
        if wp.static(goes_on):
            return wp.vec3d(radiance(scene, lights, path, film.max_bounces))
        else:
            return wp.vec3d(radiance(scene, lights, path))

    return sample


@once
def make_render(look: Look, projection: Projection = Projection.PINHOLE, is_measured: bool = False):
    """Adds samples to pixels, row by row from the top, until each has `samples` of them.

    is_measured: how far samples spread is kept too, and pixels that are done take no more.
    """
    Scene, Lights, Camera = scene_struct(look.spec), look_struct(look), camera_struct(projection)
    Film, sample = film_struct(is_measured, look.goes_on), make_sample(look, projection, is_measured)

    @wp.kernel(module="unique", enable_backward=False, module_options=look.spec.tier.options)
    def render(scene: Scene, lights: Lights, camera: Camera, film: Film, samples: int, first: int):
        at = first + wp.tid()
        total = wp.vec3d(film.total[at])
        for k in range(film.count, samples):
            total += sample(scene, lights, camera, film, at, k)
        film.total[at] = total

    @wp.kernel(module="unique", enable_backward=False, module_options=look.spec.tier.options)
    def measure(scene: Scene, lights: Lights, camera: Camera, film: Film, samples: int, first: int):
        at = first + wp.tid()
        if not film.is_active[at]:
            return
        total, spread = wp.vec3d(film.total[at]), wp.vec3d(film.spread[at])
        for k in range(film.count[at], samples):
            value = sample(scene, lights, camera, film, at, k)
            spread = spread_after(spread, total, k, value)
            total += value
        film.total[at] = total
        film.spread[at] = spread
        film.count[at] = samples

    return measure if is_measured else render
