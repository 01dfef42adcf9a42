"""The blocks of one cell, under a tree of boxes.

A node holds the boxes of eight children: blocks of triangles, or nodes. Blocks come in the order of a space-filling
curve, and each eight neighbours make a node, so a sparse cell has one and a crowded one as many levels as it takes.

A node is 128 bytes: rows of eight 16-bit numbers, lower x y z and upper x y z, in steps from the lower corner of the
cell's frame; then the eight children, a block b as b, a node n as -2 - n, none as -1. Boxes are rounded outwards, so
what a ray meets never depends on them; they only say where it need not look.
"""

import warp as wp

NODE_WORDS = 32
"""int32 words in a node."""
STEPS = 65535
"""Steps across a frame."""
MOST_LEVELS = 8
"""Above 2^24 blocks, in one cell."""
MOST_ENTRIES = 60
"""On the stack: seven for each level and the root. More would no longer be cleared in a few instructions."""

BOXES_MET = """
    const int x3 = dq[0] < 0 ? 3 : 0, y3 = dq[1] < 0 ? 3 : 0, z3 = dq[2] < 0 ? 3 : 0;
    const int* child = node.data + 32 * (size_t)k + 24;
#if !defined(__CUDA_ARCH__)
    typedef unsigned short H __attribute__((ext_vector_type(8), aligned(4)));
    typedef REAL V __attribute__((ext_vector_type(8)));
    typedef int I __attribute__((ext_vector_type(8), aligned(4)));
    typedef float F __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool B8 __attribute__((ext_vector_type(8)));
    const H* row = (const H*)(node.data + 32 * (size_t)k);
    V near_x = base[0] + __builtin_convertvector(row[x3], V) * dq[0];
    V far_x = base[0] + __builtin_convertvector(row[3 - x3], V) * dq[0];
    V near_y = base[1] + __builtin_convertvector(row[y3 + 1], V) * dq[1];
    V far_y = base[1] + __builtin_convertvector(row[4 - y3], V) * dq[1];
    V near_z = base[2] + __builtin_convertvector(row[z3 + 2], V) * dq[2];
    V far_z = base[2] + __builtin_convertvector(row[5 - z3], V) * dq[2];
    V near = near_x > near_y ? near_x : near_y;
    near = near > near_z ? near : near_z;
    near = near > 0 ? near : V{};
    V far = far_x < far_y ? far_x : far_y;
    far = far < far_z ? far : far_z;
    *(F*)entered = __builtin_convertvector(near, F);
    return __builtin_bit_cast(unsigned char, __builtin_convertvector((near <= far) & (near <= t_max), B8))
        & ~__builtin_bit_cast(unsigned char, __builtin_convertvector(*(const I*)child == -1, B8));
#else
    const unsigned short* row = (const unsigned short*)(node.data + 32 * (size_t)k);
    int met = 0;
    for (int lane = 0; lane < 8; ++lane) {
        REAL near_x = base[0] + row[8 * x3 + lane] * dq[0], far_x = base[0] + row[24 - 8 * x3 + lane] * dq[0];
        REAL near_y = base[1] + row[8 * y3 + 8 + lane] * dq[1], far_y = base[1] + row[32 - 8 * y3 + lane] * dq[1];
        REAL near_z = base[2] + row[8 * z3 + 16 + lane] * dq[2], far_z = base[2] + row[40 - 8 * z3 + lane] * dq[2];
        REAL near = near_x > near_y ? near_x : near_y;
        near = near > near_z ? near : near_z;
        near = near > 0 ? near : 0;
        REAL far = far_x < far_y ? far_x : far_y;
        far = far < far_z ? far : far_z;
        entered[lane] = (float)near;
        met |= (near <= far && near <= t_max && child[lane] != -1 ? 1 : 0) << lane;
    }
    return met;
#endif
"""


@wp.func_native("""
    return ((const unsigned short*)node.data)[64 * (size_t)k + 8 * side + lane];
""")
def bound_at(node: wp.array(dtype=wp.int32), k: int, side: int, lane: int) -> int:
    """One side of one child's box in steps: 0 1 2 lower x y z, 3 4 5 upper."""
    ...


@wp.func_native("""
    ((unsigned short*)node.data)[64 * (size_t)k + 8 * side + lane] = (unsigned short)steps;
""")
def set_bound(node: wp.array(dtype=wp.int32), k: int, side: int, lane: int, steps: int):
    """Stores what `bound_at` reads."""
    ...
