"""Where a path goes on from a surface, and with how much of the light."""

import warp as wp

from .chance import chance
from .generic import Vec3
from .glass import through_glass
from .making import once
from .point import make_seen_normal
from .smooth import make_above
from .spec import Choice, Look
from .sphere import reflected
from .structs import look_struct, path_struct, point_struct, vec3
from .surface import leave

FEWEST_BOUNCES = wp.constant(3)
"""A path ends by chance only after these."""


@once
def make_number(look: Look):
    """The number in [0, 1) by which a path makes a choice at the surface where it is."""
    Path, dimensions = path_struct(look), look.dimensions

    @wp.func
    def number(path: Path, choice: int) -> wp.float64:
        return chance(path.pixel, path.sample, wp.static(dimensions) * path.bounce + choice, 0)

    return number


@once
def make_clear(look: Look):
    """The share of light that goes on as by a mirror or through glass; a material is one or the other."""
    Lights, Point, has_mirrors, has_glass = look_struct(look), point_struct(look), look.mirrors, look.glass
    has_tint = look.has_tint

    @wp.func
    def clear(lights: Lights, p: Point) -> wp.vec3f:
        share = wp.vec3f()
        if wp.static(has_mirrors):
            share = lights.mirror[p.material]
        if wp.static(has_glass):
            share = wp.where(wp.max(lights.glass[p.material]) > 0.0, lights.glass[p.material], share)
        if wp.static(has_tint):
            share = wp.cw_mul(p.shade, share)
        return share

    return clear


@once
def make_onwards(look: Look):
    """The path after a mirror or glass, whose share of the light is already taken."""
    Lights, Path, Point = look_struct(look), path_struct(look), point_struct(look)
    has_glass, is_smooth, tells_apart = look.glass, look.smooth_normals, look.paths and look.shown_lamps
    seen_normal, above = make_seen_normal(look), make_above(look.spec.tier.wide) if is_smooth else None
    number, fresnel = make_number(look) if has_glass else None, int(Choice.FRESNEL)
    wide, vec = look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def onwards(lights: Lights, path: Path, p: Point) -> Path:
        n = seen_normal(p)
        d, side = reflected(path.d, n), vec(p.normal)
        if wp.static(has_glass):
            if wp.max(lights.glass[p.material]) > 0.0:
                ior = wide(lights.ior[p.material])
                ratio = wp.where(p.is_inside, ior, wide(1.0) / ior)
                d = through_glass(path.d / wp.length(path.d), n, ratio, wide(number(path, wp.static(fresnel))))
                if wp.dot(d, n) < wide(0.0):
                    side = -p.normal
                    path.medium = wp.where(p.is_inside, wp.vec3f(), lights.absorption[p.material])
        if wp.static(is_smooth):
            d = above(d, side)
        path.d = d
        if wp.static(tells_apart):
            path.is_scattered = False
        return path

    return onwards


@wp.func
def cosine_direction(n: Vec3, x: wp.float64, y: wp.float64):
    """A unit direction about n, as often as its cosine says, for x and y in [0, 1).

    A point of the unit sphere that n touches from within (Shirley & Morley 2003, "Realistic Ray Tracing", 2.10).
    """
    one, two = wp.float64(1.0), wp.float64(2.0)
    z = one - two * x
    r = wp.sqrt(wp.max(one - z * z, wp.float64(0.0)))
    phi = two * wp.float64(wp.pi) * y
    d = wp.vec3d(n) + wp.vec3d(r * wp.cos(phi), r * wp.sin(phi), z)
    size = wp.length(d)
    if size < wp.float64(1e-6):
        return n
    return type(n)(d / size)


@once
def make_scatter(look: Look):
    """The path after a surface that scatters evenly, whose share is already taken."""
    Path, Point, number, seen_normal = path_struct(look), point_struct(look), make_number(look), make_seen_normal(look)
    u, v = int(Choice.DIRECTION_U), int(Choice.DIRECTION_V)
    shows_lamps, is_smooth = look.shown_lamps, look.smooth_normals
    above = make_above(look.spec.tier.wide) if is_smooth else None

    @wp.func
    def scatter(path: Path, p: Point) -> Path:
        d = cosine_direction(seen_normal(p), number(path, wp.static(u)), number(path, wp.static(v)))
        if wp.static(is_smooth):
            d = above(d, p.normal)
        path.d = d
        if wp.static(shows_lamps):
            path.is_scattered = True
        return path

    return scatter


@once
def make_bounce(look: Look):
    """The path at its next surface; its throughput is 0 where it ends."""
    Lights, Path, Point = look_struct(look), path_struct(look), point_struct(look)
    follows_all, is_clear, has_tint = look.paths, look.mirrors or look.glass, look.has_tint
    clear, onwards = (make_clear(look), make_onwards(look)) if is_clear else (None, None)
    scatter, number = (make_scatter(look), make_number(look)) if follows_all else (None, None)
    layer, survival = int(Choice.LAYER), int(Choice.SURVIVAL)

    @wp.func
    def one_of_both(lights: Lights, path: Path, p: Point) -> Path:
        """Scattered evenly or not, as often as the shares say."""
        scattered = lights.diffuse[p.material]
        if wp.static(has_tint):
            scattered = wp.cw_mul(p.shade, scattered)
        often = wp.float32(1.0)
        if wp.static(is_clear):
            share = clear(lights, p)
            most = wp.max(scattered) + wp.max(share)
            if most > 0.0:
                often = wp.max(scattered) / most
            # In float64, where the number is less than 1.
            if not number(path, wp.static(layer)) < wp.float64(often):
                path.throughput = wp.cw_mul(path.throughput, share / (1.0 - often))
                return onwards(lights, path, p)
        path.throughput = wp.cw_mul(path.throughput, scattered / often)
        return scatter(path, p)

    @wp.func
    def survivor(path: Path) -> Path:
        """Ends the path as often as it carries little (Arvo & Kirk 1990), and else makes up for those that end."""
        most = wp.max(path.throughput)
        if path.bounce >= FEWEST_BOUNCES and most < 1.0:
            if number(path, wp.static(survival)) < wp.float64(most):
                path.throughput = path.throughput / most
            else:
                path.throughput = wp.vec3f()
        return path

    @wp.func
    def bounce(lights: Lights, path: Path, p: Point) -> Path:
        if wp.static(follows_all):
            path = survivor(one_of_both(lights, path, p))
        else:
            path.throughput = wp.cw_mul(path.throughput, clear(lights, p))
            if wp.max(path.throughput) > 0.0:
                path = onwards(lights, path, p)
        path.o = leave(p.position, p.normal, p.offset, path.d)
        path.bounce += 1
        return path

    return bounce
