"""Exact answers, in rational arithmetic: the truth that `t_error` is about. Shares nothing with the kernels."""

from fractions import Fraction

import numpy as np

Vector = list[Fraction]


def exactly(values):
    """The same numbers as nested lists of fractions, without a rounding."""
    if np.ndim(values) == 0:
        return Fraction(float(values))
    return [exactly(value) for value in values]


def dot(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def minus(a: Vector, b: Vector) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


class Placement:
    """x_world = A x + b, of a (4, 4) matrix, both ways."""

    def __init__(self, matrix):
        rows = exactly(matrix)
        self.linear, self.origin = [row[:3] for row in rows[:3]], [row[3] for row in rows[:3]]
        columns = [cross(self.linear[(i + 1) % 3], self.linear[(i + 2) % 3]) for i in range(3)]
        determinant = dot(self.linear[0], columns[0])
        self.inverse = [[columns[j][i] / determinant for j in range(3)] for i in range(3)]

    def to_world(self, p: Vector) -> Vector:
        return [dot(row, p) + b for row, b in zip(self.linear, self.origin, strict=True)]

    def ray_to_local(self, o: Vector, d: Vector) -> tuple[Vector, Vector]:
        from_b = minus(o, self.origin)
        return [dot(row, from_b) for row in self.inverse], [dot(row, d) for row in self.inverse]


def plane_parameter(o: Vector, d: Vector, point: Vector, normal: Vector) -> Fraction | None:
    """Where a ray meets a plane; None if it is parallel."""
    speed = dot(normal, d)
    return dot(normal, minus(point, o)) / speed if speed else None


def face_parameter(o: Vector, d: Vector, corners: list[Vector]) -> Fraction | None:
    """Where a ray meets the plane of a triangle."""
    p, q, r = corners
    return plane_parameter(o, d, p, cross(minus(q, p), minus(r, p)))


def round_values(kind: str, o: Vector, d: Vector, radius: Fraction, half: Fraction) -> list:
    """Of each surface that bounds a cylinder, cone, capsule or disk about the origin: a polynomial (c, -b, a) in t.

    It is c - 2 b t + a t^2, and 0 where the ray is on the surface; b and a for planes are such that this is linear.
    """

    def quadric(weights, center, constant):
        x = minus(o, center)
        return [
            sum(w * p * q for w, p, q in zip(weights, *pair, strict=True)) - end
            for pair, end in (((x, x), constant), ((x, d), 0), ((d, d), 0))
        ]

    def plane(z):
        return [o[2] - z, d[2] / 2, Fraction(0)]

    zero, one = Fraction(0), Fraction(1)
    if kind == "disk":
        return [plane(zero)]
    if kind == "cone":
        return [quadric([4 * half**2, 4 * half**2, -(radius**2)], [zero, zero, half], 0), plane(-half)]
    side = quadric([one, one, zero], [zero] * 3, radius**2)
    if kind == "cylinder":
        return [side, plane(-half), plane(half)]
    return [side, *(quadric([one] * 3, [zero, zero, z], radius**2) for z in (-half, half))]


def has_root(polynomial: list, low: Fraction, high: Fraction) -> bool:
    """Whether c - 2 b t + a t^2, as round_values gives it, is 0 between two parameters."""

    def value(t):
        return polynomial[0] + t * (2 * polynomial[1] + t * polynomial[2])

    if value(low) * value(high) <= 0:
        return True
    if polynomial[2] == 0:
        return False
    turn = -polynomial[1] / polynomial[2]
    return low <= turn <= high and value(low) * value(turn) <= 0


def sphere_value(o: Vector, d: Vector, center: Vector, radius: Fraction, t: Fraction) -> Fraction:
    """|o + t d - center|^2 - radius^2: it changes its sign at a root."""
    x = [a + t * b - c for a, b, c in zip(o, d, center, strict=True)]
    return dot(x, x) - radius * radius
