"""Eight triangles against one ray, at once.

A block is eight triangles stored by component: row 3 j + k holds coordinate k of vertex j, a lane for each triangle; in
a tenth row lie the numbers of the user's faces, -1 in unused lanes. On a CPU the lanes are one vector register; on a
GPU they are a loop. Both round the same operations, so they answer the same.
"""

import warp as wp

from .making import once
from .memory import make_at
from .spec import Tier

LANES = 8
BLOCK_SIZE = 10 * LANES
"""Reals in a block: with float32, five lines of 64 bytes."""

CANDIDATES = """
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(CONTRACTED)
    typedef REAL V __attribute__((vector_size(8 * sizeof(REAL)), aligned(sizeof(REAL))));
    typedef bool B8 __attribute__((ext_vector_type(8)));
    const V* row = (const V*)(corner.data + 80 * (size_t)block);
    V az = row[kz] - oz, bz = row[kz + 3] - oz, cz = row[kz + 6] - oz;
    V ax = (row[kx] - ox) - sx * az, bx = (row[kx + 3] - ox) - sx * bz, cx = (row[kx + 6] - ox) - sx * cz;
    V ay = (row[ky] - oy) - sy * az, by = (row[ky + 3] - oy) - sy * bz, cy = (row[ky + 6] - oy) - sy * cz;
    V u1 = cx * by, u2 = cy * bx, v1 = ax * cy, v2 = ay * cx, w1 = bx * ay, w2 = by * ax;
    OUTSIDE
    return 255 ^ __builtin_bit_cast(unsigned char, __builtin_convertvector(outside, B8));
#else
    const REAL* row = corner.data + 80 * (size_t)block;
    int rejected = 0;
    for (int lane = 0; lane < 8; ++lane) {
        const REAL* p = row + lane;
        REAL az = p[8 * kz] - oz, bz = p[8 * kz + 24] - oz, cz = p[8 * kz + 48] - oz;
        REAL ax = (p[8 * kx] - ox) - sx * az, ay = (p[8 * ky] - oy) - sy * az;
        REAL bx = (p[8 * kx + 24] - ox) - sx * bz, by = (p[8 * ky + 24] - oy) - sy * bz;
        REAL cx = (p[8 * kx + 48] - ox) - sx * cz, cy = (p[8 * ky + 48] - oy) - sy * cz;
        REAL u1 = cx * by, u2 = cy * bx, v1 = ax * cy, v2 = ay * cx, w1 = bx * ay, w2 = by * ax;
        OUTSIDE
        rejected |= (outside ? 1 : 0) << lane;
    }
    return 255 ^ rejected;
#endif
"""

OUTSIDE = """
    const auto outside = ((u1 < u2) | (v1 < v2) | (w1 < w2)) & ((u1 > u2) | (v1 > v2) | (w1 > w2));
"""
"""Two signs that are certain and opposite: see `triangle.is_outside`."""

CERTAINLY_OUTSIDE = """
    const auto larger = [](auto a, auto b) { a = a < 0 ? -a : a, b = b < 0 ? -b : b; return a > b ? a : b; };
    const auto m = larger(larger(larger(ax, ay), larger(bx, by)), larger(cx, cy));
    const auto slack = (m * 5.0f + 3.0f * SHEAR_ERROR) * SHEAR_ERROR;
    const auto u = u1 - u2, v = v1 - v2, w = w1 - w2;
    const auto outside = ((u < -slack) | (v < -slack) | (w < -slack)) & ((u > slack) | (v > slack) | (w > slack));
"""
"""The same, of the triangle and the ray that these float32 numbers are roundings of.

Each sheared coordinate, at most m in size, is off by at most an error E; a difference of two products, then, by
4 m E + 2 E^2 and the rounding of the products and of itself, 3 u m^2, which is less than m E, since m <= 4.
"""
SHEAR_ERROR = 24.0 * 2.0**-24
"""In canonical space, where o and p are at most 1 (plus padding) in size and slopes at most 1, with u = 2^-24: p is off
by u / 2, o by u, their difference of at most 2 by 2 u more; a slope by 3 u, its product with a difference, of at most
2, by 6 u + 3.5 u + 2 u, the difference of that and 3.5 u by 4 u more. In all 19 u."""


def candidates_code(tier: Tier, is_vector: bool = True) -> str:
    """Code for the lanes of a block that a tier does not reject."""
    outside = CERTAINLY_OUTSIDE.replace("SHEAR_ERROR", f"{SHEAR_ERROR!r}f") if tier.has_fine else OUTSIDE
    code = CANDIDATES.replace("OUTSIDE", outside).replace("CONTRACTED", "fast" if tier is Tier.FAST else "off")
    return native_code(code, tier.real, is_vector)


def native_code(code: str, real: type, is_vector: bool = True) -> str:
    """The code for one type of reals; without vectors, the loop of the GPU on any device."""
    code = code.replace("REAL", "float" if real is wp.float32 else "double")
    return code if is_vector else code.replace("#if !defined(__CUDA_ARCH__)", "#if 0")


@once
def make_candidates(tier: Tier):
    """Which triangles of a block a ray may hit, lane by lane in the bits of an int.

    All that the exact test accepts; in `robust` and `double` those that `triangle.is_outside` does not reject.
    """
    real = tier.real

    @wp.func_native(candidates_code(tier))
    def candidates(
        corner: wp.array(dtype=real),
        block: int,
        kx: int,
        ky: int,
        kz: int,
        ox: real,
        oy: real,
        oz: real,
        sx: real,
        sy: real,
    ) -> int: ...

    return candidates


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    return __builtin_ctz(mask);
#else
    return __ffs(mask) - 1;
#endif
""")
def lowest_lane(mask: int) -> int:
    """Number of the lowest bit that is set; the mask must not be 0."""
    ...


@once
def make_corner(real):
    """Vertex j of the triangle whose first row begins at `row`, in float64."""
    at = make_at(real)

    @wp.func
    def corner(corners: wp.array(dtype=real), row: int, j: int) -> wp.vec3d:
        k = row + 24 * j
        return wp.vec3d(wp.float64(at(corners, k)), wp.float64(at(corners, k + 8)), wp.float64(at(corners, k + 16)))

    return corner


@wp.func
def slot_row(slot: int):
    """Where in the corners of all blocks the first row of a slot lies; rows are 8 apart. Slot s is lane s % 8."""
    return (slot >> 3) * 80 + (slot & 7)


@once
def make_face_at(real):
    """The user's number of the face in a slot, -1 if it is unused."""

    @wp.func_native("return ((const int*)(corner.data + 80 * (size_t)(slot >> 3) + 72))[slot & 7];")
    def face_at(corner: wp.array(dtype=real), slot: int) -> int: ...

    return face_at


@once
def make_set_face(real):
    """Stores what `face_at` reads."""

    @wp.func_native("((int*)(corner.data + 80 * (size_t)(slot >> 3) + 72))[slot & 7] = face;")
    def set_face(corner: wp.array(dtype=real), slot: int, face: int): ...

    return set_face
