"""Kernels that cut a user's faces into blocks of eight neighbours: place each along a curve, sort, copy."""

import warp as wp

from .blocks import make_set_face, slot_row
from .making import once
from .memory import int_at, vec3d_at
from .rounding import OPTIONS, is_finite, largest, largest_of, smallest_of, unit_roundoff
from .structs import WIDE

PLACE_BITS = 30
"""Of a place along the curve: ten for each axis."""
CHUNK = 1024
"""Faces that one thread adds up."""


@wp.func
def spread_bits(x: wp.uint32):
    """The ten low bits of x, two zeros between each."""
    x = (x | (x << wp.uint32(16))) & wp.uint32(0x030000FF)
    x = (x | (x << wp.uint32(8))) & wp.uint32(0x0300F00F)
    x = (x | (x << wp.uint32(4))) & wp.uint32(0x030C30C3)
    return (x | (x << wp.uint32(2))) & wp.uint32(0x09249249)


@wp.func
def hilbert_code(p: wp.vec3d):
    """Place along the Hilbert curve of a point of [-1, 1]^3, 30 bits (Skilling 2004): neighbours, without leaps."""
    x = wp.uint32(wp.clamp((p[0] + WIDE(1.0)) * WIDE(512.0), WIDE(0.0), WIDE(1023.0)))
    y = wp.uint32(wp.clamp((p[1] + WIDE(1.0)) * WIDE(512.0), WIDE(0.0), WIDE(1023.0)))
    z = wp.uint32(wp.clamp((p[2] + WIDE(1.0)) * WIDE(512.0), WIDE(0.0), WIDE(1023.0)))
    bit = wp.uint32(512)
    while bit > wp.uint32(1):
        low = bit - wp.uint32(1)
        x = wp.where((x & bit) != wp.uint32(0), x ^ low, x)
        t = (x ^ y) & low
        is_set = (y & bit) != wp.uint32(0)
        x = wp.where(is_set, x ^ low, x ^ t)
        y = wp.where(is_set, y, y ^ t)
        t = (x ^ z) & low
        is_set = (z & bit) != wp.uint32(0)
        x = wp.where(is_set, x ^ low, x ^ t)
        z = wp.where(is_set, z, z ^ t)
        bit = bit >> wp.uint32(1)
    y = y ^ x
    z = z ^ y
    # The bits of z, each with all that lie above it.
    gray = z >> wp.uint32(1)
    gray = gray ^ (gray >> wp.uint32(1))
    gray = gray ^ (gray >> wp.uint32(2))
    gray = gray ^ (gray >> wp.uint32(4))
    gray = gray ^ (gray >> wp.uint32(8))
    x = x ^ gray
    y = y ^ gray
    z = z ^ gray
    return int((spread_bits(x) << wp.uint32(2)) | (spread_bits(y) << wp.uint32(1)) | spread_bits(z))


@wp.func
def vertex(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    center: wp.vec3d,
    scale: WIDE,
    face: int,
    j: int,
):
    """Vertex j of a face in canonical space."""
    return (vec3d_at(vertices, int_at(faces, 3 * face + j)) - center) / scale


@wp.func
def has_no_area(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether the cross product of two edges is no larger than its rounding error.

    That is eight roundings of a product of the longest components: of two edges, the products and their difference.
    """
    e1, e2 = b - a, c - a
    return largest(wp.cross(e1, e2)) <= WIDE(8.0) * unit_roundoff(WIDE(1.0)) * largest(e1) * largest(e2)


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def place_faces(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),  # [3 faces]
    center: wp.vec3d,
    scale: WIDE,
    key: wp.array(dtype=wp.int32),
    face: wp.array(dtype=wp.int32),
    first: int,
):
    """Places each face along the curve, so that blocks will hold neighbours."""
    k = first + wp.tid()
    a = vertex(vertices, faces, center, scale, k, 0)
    b = vertex(vertices, faces, center, scale, k, 1)
    c = vertex(vertices, faces, center, scale, k, 2)
    key[k] = hilbert_code((a + b + c) / WIDE(3.0))
    face[k] = k


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_extents(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    scale: WIDE,
    sums: wp.array2d(dtype=WIDE),  # [chunks, 7]
    first: int,
):
    """Sums over the faces of a chunk of their extents x, y, z, xy, yz, zx, xyz: they tell how many cells faces span."""
    chunk = first + wp.tid()
    total, pairs, volume = wp.vec3d(), wp.vec3d(), WIDE(0.0)
    end = wp.min((chunk + 1) * CHUNK, faces.shape[0] / 3)
    for face in range(chunk * CHUNK, end):
        a = vec3d_at(vertices, int_at(faces, 3 * face))
        b = vec3d_at(vertices, int_at(faces, 3 * face + 1))
        c = vec3d_at(vertices, int_at(faces, 3 * face + 2))
        size = (largest_of(a, b, c) - smallest_of(a, b, c)) / scale
        total += size
        pairs += wp.vec3d(size[0] * size[1], size[1] * size[2], size[2] * size[0])
        volume += size[0] * size[1] * size[2]
    for axis in range(3):
        sums[chunk, axis] = total[axis]
        sums[chunk, 3 + axis] = pairs[axis]
    sums[chunk, 6] = volume


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def bound_faces(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    bounds: wp.array2d(dtype=WIDE),  # [chunks, 6]
    first: int,
):
    """Least and largest coordinates of the vertices of a chunk of faces; NaN where one is not finite."""
    chunk = first + wp.tid()
    least, most, nothing = wp.vec3d(WIDE(wp.inf)), wp.vec3d(WIDE(-wp.inf)), wp.vec3d()
    end = wp.min((chunk + 1) * CHUNK, faces.shape[0] / 3)
    for k in range(3 * chunk * CHUNK, 3 * end):
        p = vec3d_at(vertices, int_at(faces, k))
        least, most = smallest_of(least, p, p), largest_of(most, p, p)
        nothing += p - p
    for axis in range(3):
        bounds[chunk, axis] = least[axis] + nothing[axis]
        bounds[chunk, 3 + axis] = most[axis] + nothing[axis]


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def find_not_finite(
    vertices: wp.array(dtype=wp.vec3d),
    found: wp.array(dtype=wp.int32),  # [chunks]
    first: int,
):
    """Which vertex of a chunk is the first that is not finite, -1 where all are."""
    chunk = first + wp.tid()
    bad = int(-1)
    k = chunk * CHUNK
    end = wp.min(k + CHUNK, vertices.shape[0])
    while k < end and bad < 0:
        if not is_finite(vec3d_at(vertices, k)):
            bad = k
        k += 1
    found[chunk] = bad


@once
def make_fill_blocks(real):
    """Kernel that copies faces, in sorted order, into the lanes of blocks. A face without area becomes a point."""
    set_face = make_set_face(real)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def fill_blocks(
        vertices: wp.array(dtype=wp.vec3d),
        faces: wp.array(dtype=wp.int32),
        center: wp.vec3d,
        scale: WIDE,
        sorted_face: wp.array(dtype=wp.int32),
        corner: wp.array(dtype=real),
        first: int,
    ):
        slot = first + wp.tid()
        row = slot_row(slot)
        a, b, c, face = wp.vec3d(), wp.vec3d(), wp.vec3d(), int(-1)
        if slot < faces.shape[0] / 3:
            face = sorted_face[slot]
            a = vertex(vertices, faces, center, scale, face, 0)
            b = vertex(vertices, faces, center, scale, face, 1)
            c = vertex(vertices, faces, center, scale, face, 2)
            # Of the vertices as they were given: in the canonical space they may have left a common line by a rounding.
            nowhere = wp.vec3d()
            if has_no_area(
                vertex(vertices, faces, nowhere, scale, face, 0),
                vertex(vertices, faces, nowhere, scale, face, 1),
                vertex(vertices, faces, nowhere, scale, face, 2),
            ):
                b = a
                c = a
        set_face(corner, slot, face)
        for axis in range(3):
            corner[row + 8 * axis] = real(a[axis])
            corner[row + 24 + 8 * axis] = real(b[axis])
            corner[row + 48 + 8 * axis] = real(c[axis])

    return fill_blocks
