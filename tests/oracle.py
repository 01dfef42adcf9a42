"""What kernels should answer, in exact rationals and by other methods than theirs.

Floats become fractions without rounding, so a test sees the error of a kernel alone. Vectors are sequences of three
fractions, as `exact` makes them.
"""

from fractions import Fraction
from itertools import product
from math import inf, isqrt

import numpy as np


def exact(values) -> np.ndarray:
    """An array of fractions, each equal to its float."""
    array = np.asarray(values, dtype=np.float64)
    return np.array([Fraction(float(x)) for x in array.ravel()], dtype=object).reshape(array.shape)


def error(value, truth: Fraction) -> float:
    """Distance of a float from the truth; NaN and infinity are infinitely far."""
    return float(abs(Fraction(float(value)) - truth)) if np.isfinite(value) else inf


def square_root(x: Fraction) -> Fraction:
    """To 2^-200 of its size, which no test can tell from exact."""
    numerator = isqrt((x.numerator * x.denominator) << 400)
    return Fraction(numerator, x.denominator << 200)


def dot(a, b) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b) -> np.ndarray:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], dtype=object)


def sign(x) -> int:
    return int(x > 0) - int(x < 0)


# ---------------------------------------------------------------------------------------------- transforms


def inverse(a) -> np.ndarray:
    """Of a 3 x 3 matrix of fractions, by cofactors."""
    cofactors = np.array([cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])], dtype=object)
    return cofactors.T / dot(a[0], cofactors[0])


def normal_to_world(a, n) -> np.ndarray:
    """Inverse transpose times n, unit, for x_world = A x_local."""
    turned = inverse(a).T @ n
    return turned / square_root(dot(turned, turned))


def reflection(d, n) -> np.ndarray:
    """D with its part along n turned round; n may have any length."""
    along = dot(d, n) / dot(n, n) * n
    return (d - along) - along


# ---------------------------------------------------------------------------------------------- analytic shapes


def roots_sphere(o, d, r):
    """(near, far) of the sphere about the origin, or None; by the textbook's quadratic."""
    a, half_b, c = dot(d, d), dot(o, d), dot(o, o) - r * r
    quarter = half_b * half_b - a * c
    if quarter < 0:
        return None
    return (-half_b - square_root(quarter)) / a, (-half_b + square_root(quarter)) / a


def line_in_box(o, d, lower, upper):
    """(near, far): where a line is in each of the three closed slabs; in none of them if near > far. None: never."""
    near, far = -inf, inf
    for axis in range(3):
        if d[axis] == 0:
            if not lower[axis] <= o[axis] <= upper[axis]:
                return None
        else:
            ends = sorted(((lower[axis] - o[axis]) / d[axis], (upper[axis] - o[axis]) / d[axis]))
            near, far = max(near, ends[0]), min(far, ends[1])
    return near, far


def hit_box(o, d, lower, upper, t_min=0, t_max=inf):
    """(t, axis) of the first point on any of the six faces, each a closed rectangle, or None.

    Where faces meet, the lowest axis.
    """
    found = []
    for axis, end in product(range(3), (lower, upper)):
        low, high = np.array(lower, dtype=object), np.array(upper, dtype=object)
        low[axis] = high[axis] = end[axis]
        span = line_in_box(o, d, low, high)
        # A ray in the plane of a face is on it for a while.
        if span is not None and span[0] <= span[1]:
            t = max(span[0], t_min)
            if t <= span[1] and t < t_max:
                found.append((t, axis))
    return min(found, default=None)


def roots_of(a, b, c):
    """Both t with a t^2 - 2 b t + c = 0, or the one there is, or none: by the textbook."""
    if a == 0:
        return [c / (2 * b)] if b else []
    quarter = b * b - a * c
    if quarter < 0:
        return []
    return sorted([(b - square_root(quarter)) / a, (b + square_root(quarter)) / a])


def roots_side(o, d, r):
    """All t at which a line is at distance r from the z axis."""
    o, d = o[:2], d[:2]
    return roots_of(d @ d, -(o @ d), o @ o - r * r)


def roots_cone(o, d, r, half):
    """All t at which a line is on the endless double cone through the rim in z = -half with its apex in z = half."""
    slant = np.array([4 * half * half, 4 * half * half, -r * r], dtype=object)
    p = o - np.array([0, 0, half], dtype=object)
    return roots_of((slant * d) @ d, -((slant * p) @ d), (slant * p) @ p)


def ends_of(o, d, z, r):
    """The t at which a line passes through the disk of radius r in the plane z, as a list."""
    if d[2] == 0:
        return []
    t = (z - o[2]) / d[2]
    x, y, _ = o + t * d
    return [t] if x * x + y * y <= r * r else []


def points_solid(kind, o, d, r, half):
    """All t, in ascending order, at which a line meets a surface of a cylinder, cone or capsule, piece by piece.

    Of a piece on which it runs for a while, only what other pieces share with it.
    """

    def is_on_side(t):
        # Where the root is irrational, it is known to 2^-200.
        return abs(o[2] + t * d[2]) <= half + Fraction(1, 2**150)

    if kind == "cylinder":
        found = [t for t in roots_side(o, d, r) if is_on_side(t)]
        found += ends_of(o, d, half, r) + ends_of(o, d, -half, r)
    elif kind == "capsule":
        found = [t for t in roots_side(o, d, r) if is_on_side(t)]
        for end in (-half, half):
            roots = roots_sphere(o - np.array([0, 0, end]), d, r) or ()
            found += [t for t in roots if (o[2] + t * d[2] - end) * end >= 0]
    else:
        found = [t for t in roots_cone(o, d, r, half) if is_on_side(t)]
        found += ends_of(o, d, half, 0) + ends_of(o, d, -half, r)
    return sorted(found)


def root_plane(o, d, n):
    """T on the plane through the origin, or None."""
    speed = dot(n, d)
    return None if speed == 0 else -dot(n, o) / speed


# ---------------------------------------------------------------------------------------------- triangles


def root_supporting_plane(o, d, p0, p1, p2):
    """T on the plane of a triangle, or None."""
    return root_plane(o - p0, d, cross(p1 - p0, p2 - p0))


def hit_triangle(o, d, p0, p1, p2):
    """(t, u, v) or None: supporting plane, then areas."""
    t = root_supporting_plane(o, d, p0, p1, p2)
    if t is None:
        return None
    n = cross(p1 - p0, p2 - p0)
    q = o + t * d - p0
    u, v = dot(cross(q, p2 - p0), n) / dot(n, n), dot(cross(p1 - p0, q), n) / dot(n, n)
    return (t, u, v) if u >= 0 and v >= 0 and u + v <= 1 else None


def closest_hit(o, d, triangles, t_min=0, t_max=inf):
    """(t, index) over all triangles, the lower index where t is equal, or None."""
    hits = [(hit[0], k) for k, corners in enumerate(triangles) if (hit := hit_triangle(o, d, *corners))]
    return min(((t, k) for t, k in hits if t_min <= t < t_max), default=None)


def edge_functions(a, b, c):
    """Signs of (b x c, c x a, a x b) in the plane, times -1: as the origin sees the edges of a triangle a b c."""
    return (
        sign(c[0] * b[1] - c[1] * b[0]),
        sign(a[0] * c[1] - a[1] * c[0]),
        sign(b[0] * a[1] - b[1] * a[0]),
    )


def holds_origin(a, b, c) -> bool:
    """Whether the origin is in the closed triangle a b c of the plane. One without area holds nothing."""
    signs = set(edge_functions(a, b, c))
    return signs not in ({0}, {-1, 1}, {-1, 0, 1})


# ---------------------------------------------------------------------------------------------- grids


def touches(triangle, lower, upper) -> bool:
    """Whether a closed triangle, also one without area, and a closed box have a point in common, by clipping."""
    polygon = list(triangle)
    for axis, (wall, outward) in product(range(3), ((lower, -1), (upper, 1))):
        heights = [outward * (p[axis] - wall[axis]) for p in polygon]
        clipped = []
        for k, (p, h) in enumerate(zip(polygon, heights, strict=True)):
            q, g = polygon[k - 1], heights[k - 1]
            if h < 0 < g or g < 0 < h:
                clipped.append(p + (q - p) * (h / (h - g)))
            if h <= 0:
                clipped.append(p)
        polygon = clipped
    return bool(polygon)


def cells_of_triangle(walls, triangle, pad=Fraction(0)) -> set:
    """Cells, each widened by pad on all sides, that a triangle touches; walls[axis] are fractions, ascending."""
    ranges = []
    for axis in range(3):
        low, high = min(p[axis] for p in triangle) - pad, max(p[axis] for p in triangle) + pad
        wall = walls[axis]
        ranges.append([k for k in range(len(wall) - 1) if wall[k] <= high and wall[k + 1] >= low])
    return {
        cell
        for cell in product(*ranges)
        if touches(
            triangle,
            [walls[axis][cell[axis]] - pad for axis in range(3)],
            [walls[axis][cell[axis] + 1] + pad for axis in range(3)],
        )
    }


def cells_of_ray(walls, o, d, t_start) -> dict:
    """{cell: (t_enter, t_exit)} of each closed cell that the ray from t_start on has a point in common with."""
    spans = []
    for axis in range(3):
        spans.append({})
        for k in range(len(walls[axis]) - 1):
            low, high = walls[axis][k], walls[axis][k + 1]
            if d[axis] == 0:
                if low <= o[axis] <= high:
                    spans[axis][k] = (t_start, inf)
            else:
                ends = sorted(((low - o[axis]) / d[axis], (high - o[axis]) / d[axis]))
                if ends[1] >= t_start:
                    spans[axis][k] = (max(ends[0], t_start), ends[1])
    cells = {}
    for (x, (x_in, x_out)), (y, (y_in, y_out)) in product(spans[0].items(), spans[1].items()):
        if max(x_in, y_in) <= min(x_out, y_out):
            for z, (z_in, z_out) in spans[2].items():
                enter, leave = max(x_in, y_in, z_in), min(x_out, y_out, z_out)
                if enter <= leave:
                    cells[x, y, z] = (enter, leave)
    return cells


def long_double(values) -> np.ndarray:
    """Fractions rounded to long double, for arithmetic on many at once."""
    high = np.vectorize(float, otypes=[float])(values)
    low = np.vectorize(lambda x, h: float(x - Fraction(h)), otypes=[float])(values, high)
    return high.astype(np.longdouble) + low.astype(np.longdouble)


def closest_triangles(o, d, vertices, faces):
    """(t, face, clearance) of many rays, in long double, by the textbook: solve p0 + u e1 + v e2 = o + t d.

    The clearance of a ray is how far it passes from any edge, in barycentric weights, or the sine at which it meets
    any plane, whichever is least: where it is small, an answer in floating point may rightly differ.
    """
    o, d, corners = (np.asarray(x, np.longdouble) for x in (o, d, np.asarray(vertices)[faces]))
    p0, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    s = o[:, None] - p0
    speed = -np.einsum("rk,fk->rf", d, normal)
    across = np.cross(s, d[:, None])
    u = np.einsum("rfk,fk->rf", across, e2) / speed
    v = -np.einsum("rfk,fk->rf", across, e1) / speed
    t = np.einsum("rfk,fk->rf", s, normal) / speed
    margin = np.minimum(np.minimum(u, v), 1 - u - v)
    sine = np.abs(speed) / (
        np.linalg.norm(d.astype(float), axis=1)[:, None] * np.linalg.norm(normal.astype(float), axis=1)
    )
    t = np.where((margin >= 0) & (t >= 0), t, np.inf)
    face = np.where(np.isfinite(t.min(axis=1)), t.argmin(axis=1), -1)
    return t.min(axis=1).astype(float), face, np.minimum(np.abs(margin), sine).min(axis=1).astype(float)
