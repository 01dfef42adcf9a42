"""Ray against a triangle, watertight: Woop, Benthin & Wald 2013 (JCGT 2:1), with exact signs.

The ray is sheared onto the z axis, where a vertex depends on the ray alone; three edge functions then say on
which side of each edge the origin of that plane lies. A filter in the arithmetic at hand rejects a triangle only
when two signs are certain and opposite; what remains is decided and solved with exact products. Two triangles
that share an edge or a vertex therefore never both miss.
"""

import warp as wp

from .generic import Real, Vec3, Wide
from .rounding import difference_of_products


@wp.func
def shear_axes(d: Vec3):
    """(kx, ky, kz): kz is the axis along which the ray runs most, the other two keep the winding."""
    x, y, z = wp.abs(d[0]), wp.abs(d[1]), wp.abs(d[2])
    # Selections, not branches, which would be predicted wrongly half the time.
    kz = wp.where(x >= y and x >= z, 0, wp.where(y >= z, 1, 2))
    after = wp.where(kz == 2, 0, kz + 1)
    before = 3 - kz - after
    is_back = d[kz] < type(d[0])(0.0)
    return wp.where(is_back, before, after), wp.where(is_back, after, before), kz


@wp.func
def is_outside(ax: Real, ay: Real, bx: Real, by: Real, cx: Real, cy: Real):
    """Whether the origin is certainly not in the triangle a b c of the sheared plane. False is no answer.

    Rounding is monotonic, so a rounded product is never on the wrong side of another one: where they differ,
    the sign of the edge function is exact. Comparing products leaves nothing to fuse into a multiply-add.
    """
    u1, u2 = cx * by, cy * bx
    v1, v2 = ax * cy, ay * cx
    w1, w2 = bx * ay, by * ax
    return (u1 < u2 or v1 < v2 or w1 < w2) and (u1 > u2 or v1 > v2 or w1 > w2)


@wp.func
def have_opposite_signs(wa: wp.float64, wb: wp.float64, wc: wp.float64):
    """Whether one is below 0 and another above."""
    zero = wp.float64(0.0)
    return (wa < zero or wb < zero or wc < zero) and (wa > zero or wb > zero or wc > zero)


@wp.func
def have_opposite_signs(wa: wp.float32, wb: wp.float32, wc: wp.float32):
    """Never: the filter has decided, and weights in float32, which round otherwise, could only leak."""
    return False


@wp.func
def edge_weights(ax: Real, ay: Real, bx: Real, by: Real, cx: Real, cy: Real, like: Wide):
    """(is_hit, wa, wb, wc): unnormalised barycentric weights in the type of `like`; edges count.

    In float64, whatever the coordinates are, their signs are exact.
    """
    wa = difference_of_products(cx, by, cy, bx, like)
    wb = difference_of_products(ax, cy, ay, cx, like)
    wc = difference_of_products(bx, ay, by, ax, like)
    # A sum of 0 with equal signs means that all are 0: the triangle is seen edge on, or has no area.
    return not have_opposite_signs(wa, wb, wc) and wa + wb + wc != type(like)(0.0), wa, wb, wc


@wp.func
def solve_sheared(ax: Real, ay: Real, az: Real, bx: Real, by: Real, bz: Real, cx: Real, cy: Real, cz: Real, dz: Wide):
    """(is_hit, t, u, v) of sheared corners, in the type of dz, the ray's component along z, which is unscaled."""
    is_hit, wa, wb, wc = edge_weights(ax, ay, bx, by, cx, cy, dz)
    zero = type(dz)(0.0)
    if not is_hit:
        return False, zero, zero, zero
    total = wa + wb + wc
    t = (wa * type(dz)(az) + wb * type(dz)(bz) + wc * type(dz)(cz)) / (total * dz)
    return True, t, wb / total, wc / total


@wp.func
def side_beside(w: Wide, px: Real, py: Real, qx: Real, qy: Real):
    """Sign of an edge function for a ray moved aside by an infinitesimal (e, e^2): never 0 for an edge of some length.

    w is that of the ray as it is, q x p; both faces at an edge see opposite signs.
    """
    if w != type(w)(0.0):
        return wp.where(w > type(w)(0.0), 1, -1)
    if py != qy:
        return wp.where(qy > py, 1, -1)
    return wp.where(px > qx, 1, wp.where(px < qx, -1, 0))


@wp.func
def touch_sheared(ax: Real, ay: Real, az: Real, bx: Real, by: Real, bz: Real, cx: Real, cy: Real, cz: Real, dz: Wide):
    """At which edges a hit lies: bit 0 for the one opposite a, 1 for b, 2 for c. Bit 3: the triangle faces away.

    Bit 4: a ray infinitesimally beside this one hits it too; of the faces round an edge or vertex, those are as many as
    cross the ray. A vertex lies at the two edges that meet there. Exact where the weights are in float64.
    """
    _is_hit, wa, wb, wc = edge_weights(ax, ay, bx, by, cx, cy, dz)
    zero = type(dz)(0.0)
    edges = wp.where(wa == zero, 1, 0) + wp.where(wb == zero, 2, 0) + wp.where(wc == zero, 4, 0)
    beside_a, beside_b, beside_c = (
        side_beside(wa, bx, by, cx, cy),
        side_beside(wb, cx, cy, ax, ay),
        side_beside(wc, ax, ay, bx, by),
    )
    is_crossed = beside_a == beside_b and beside_b == beside_c
    return edges + wp.where(wa + wb + wc < zero, 8, 0) + wp.where(is_crossed, 16, 0)


@wp.func
def hit_triangle(o: Vec3, d: Vec3, p0: Vec3, p1: Vec3, p2: Vec3):
    """(is_hit, t, u, v): the point o + t d = (1 - u - v) p0 + u p1 + v p2, all three in float64.

    Two-sided. A triangle seen edge on is never hit.
    """
    kx, ky, kz = shear_axes(d)
    sx, sy = d[kx] / d[kz], d[ky] / d[kz]
    az, bz, cz = p0[kz] - o[kz], p1[kz] - o[kz], p2[kz] - o[kz]
    ax, ay = (p0[kx] - o[kx]) - sx * az, (p0[ky] - o[ky]) - sy * az
    bx, by = (p1[kx] - o[kx]) - sx * bz, (p1[ky] - o[ky]) - sy * bz
    cx, cy = (p2[kx] - o[kx]) - sx * cz, (p2[ky] - o[ky]) - sy * cz
    if is_outside(ax, ay, bx, by, cx, cy):
        zero = wp.float64(0.0)
        return False, zero, zero, zero
    return solve_sheared(ax, ay, az, bx, by, bz, cx, cy, cz, wp.float64(d[kz]))
