"""The walk of a ray through a grid of trees, as native code: it returns, one by one, what may be hit.

The 3D-DDA of grid.py, the tree of boxes in each cell and, in a mesh, the filter of triangles, with all that they know
held in registers; Warp's code decides what it returns. On a CPU eight boxes or triangles are one vector, on a GPU a
loop.
"""

import warp as wp

from .blocks import candidates_code, native_code
from .generic import Struct
from .grid import cell_of, step_of, wall_t
from .making import once
from .spec import Search, Tier
from .structs import (
    effort_struct,
    face_ray_struct,
    grid_struct,
    instances_struct,
    make_struct,
    mesh_struct,
    world_ray_struct,
)
from .tree import BOXES_MET, MOST_ENTRIES

JUMP = 4
"""An empty cell this far from any other kind is jumped off; nearer ones are cheaper to step through (measured)."""

NEXT = """
    const auto& o = ray.o;
    const auto& inv_d = ray.inv_d;
    const auto& lo = trees.grid.lo;
    const auto& size = trees.grid.cell;
    const int ny = trees.grid.count[1], nz = trees.grid.count[2];
    const int ahead_x = !(inv_d[0] < 0), ahead_y = !(inv_d[1] < 0), ahead_z = !(inv_d[2] < 0);
    const REAL dq[3] = {
        trees.frame_step[0] * inv_d[0], trees.frame_step[1] * inv_d[1], trees.frame_step[2] * inv_d[2]
    };
    const auto& node = trees.node;
    REAL base[3];
    const auto boxes_met = [&](int k, float* entered) -> int { BOXES_MET };
    const auto wall_t = [&](int axis, int k) { return ((lo[axis] + (REAL)k * size[axis]) - o[axis]) * inv_d[axis]; };
    const auto set_base = [&](int x, int y, int z) {
        base[0] = ((trees.frame_lo[0] + (REAL)x * size[0]) - o[0]) * inv_d[0];
        base[1] = ((trees.frame_lo[1] + (REAL)y * size[1]) - o[1]) * inv_d[1];
        base[2] = ((trees.frame_lo[2] + (REAL)z * size[2]) - o[2]) * inv_d[2];
    };
    const auto lowest = [](int mask) {
#if !defined(__CUDA_ARCH__)
        return __builtin_ctz(mask);
#else
        return __ffs(mask) - 1;
#endif
    };

    SETUP
    int x = walk.x, y = walk.y, z = walk.z, block = walk.block, left = walk.left, depth = walk.depth;
    REAL tx = walk.tx, ty = walk.ty, tz = walk.tz;
    const auto keep = [&](int depth, int left) {
        walk.x = x, walk.y = y, walk.z = z, walk.block = block, walk.depth = depth, walk.left = left;
        walk.tx = tx, walk.ty = ty, walk.tz = tz;
    };
    if (depth > 0) set_base(x, y, z);
    for (;;) {
        // What is left of the present cell.
        while (left == 0 && depth > 0) {
            const wp::int64 top = walk.entry[--depth];
            const int bits = (int)(top >> 32), item = (int)top;
            float near;
            memcpy(&near, &bits, 4);
            if (near > t_max) continue;
            if (item >= 0) {
                FOUND
            }
            float entered[8];
            const int* child = node.data + 32 * (size_t)(-2 - item) + 24;
            const int first = depth;
            for (int met = boxes_met(-2 - item, entered); met != 0; met &= met - 1) {
                const int lane = lowest(met);
                int key;
                memcpy(&key, entered + lane, 4);
                // Not beyond the entry, also where float32 rounds it up.
                key -= sizeof(REAL) > 4 && key > 0;
                const wp::int64 entry = ((wp::int64)key << 32) | (unsigned int)child[lane];
                AHEAD
                PLACE
            }
        }
        if (left != 0) {
            keep(depth, left & (left - 1));
            return 8 * block + lowest(left);
        }
        // The next cell that lists anything.
        int cell, gap = 0;
        do {
            if (gap >= JUMP) {
                // Everything fewer than `gap` cells away is empty: on to the far wall of that.
                const int ahead[3] = {ahead_x, ahead_y, ahead_z};
                const int from[3] = {x, y, z};
                int to[3];
                REAL t_wall[3];
                for (int axis = 0; axis < 3; ++axis) {
                    const int most = trees.grid.count[axis] - 1;
                    const int far = from[axis] + (ahead[axis] ? gap - 1 : 1 - gap);
                    to[axis] = far < 0 ? 0 : far > most ? most : far;
                    t_wall[axis] = wall_t(axis, to[axis] + ahead[axis]);
                }
                const REAL t_out = t_wall[0] < t_wall[1] ? (t_wall[0] < t_wall[2] ? t_wall[0] : t_wall[2])
                                                         : (t_wall[1] < t_wall[2] ? t_wall[1] : t_wall[2]);
                if (t_max <= t_out) return -1;
                const int exit = t_wall[0] == t_out ? 0 : t_wall[1] == t_out ? 1 : 2;
                for (int axis = 0; axis < 3; ++axis) {
                    if (axis == exit) {
                        to[axis] += 2 * ahead[axis] - 1;
                        if ((unsigned int)to[axis] >= (unsigned int)trees.grid.count[axis]) return -1;
                    } else {
                        // Never backwards, nor beyond what is known to be empty, however the position is rounded.
                        const REAL at = ((o[axis] + t_out * ray.d[axis]) - lo[axis]) * trees.grid.inv_cell[axis];
                        const int least = from[axis] < to[axis] ? from[axis] : to[axis];
                        const int most = from[axis] < to[axis] ? to[axis] : from[axis];
                        to[axis] = at < (REAL)least ? least : at >= (REAL)most ? most : (int)at;
                    }
                }
                x = to[0], y = to[1], z = to[2];
                tx = wall_t(0, x + ahead_x), ty = wall_t(1, y + ahead_y), tz = wall_t(2, z + ahead_z);
            } else if (block != -2) {
                const REAL t_out = tx < ty ? (tx < tz ? tx : tz) : (ty < tz ? ty : tz);
                if (t_max <= t_out) return -1;
                if (tx == t_out) {
                    x += 2 * ahead_x - 1;
                    if ((unsigned int)x >= (unsigned int)trees.grid.count[0]) return -1;
                    tx = wall_t(0, x + ahead_x);
                } else if (ty == t_out) {
                    y += 2 * ahead_y - 1;
                    if ((unsigned int)y >= (unsigned int)ny) return -1;
                    ty = wall_t(1, y + ahead_y);
                } else {
                    z += 2 * ahead_z - 1;
                    if ((unsigned int)z >= (unsigned int)nz) return -1;
                    tz = wall_t(2, z + ahead_z);
                }
            }
            block = -1;
            cell = (x * ny + y) * nz + z;
            gap = trees.gap.data[cell];
            LOOKED
        } while (gap > 0);
        set_base(x, y, z);
        walk.entry[0] = (wp::int64)(unsigned int)(-2 - trees.grid.start.data[cell]);
        depth = 1;
    }
"""


@once
def walk_struct(real):
    """Where a walk is: the cell, the parameters of the walls ahead, what is left of the cell and of a block."""
    return make_struct(
        "Walk",
        {
            "x": wp.int32,
            "y": wp.int32,
            "z": wp.int32,
            "tx": real,
            "ty": real,
            "tz": real,
            "block": wp.int32,  # -2 before the first cell has been looked at
            "left": wp.int32,  # lanes of the block
            "depth": wp.int32,
            "looked": wp.int32,  # cells recorded so far, in the variant that records
            "entry": wp.types.vector(MOST_ENTRIES, wp.int64),  # entry parameters, as float32 bits, above items
        },
    )


NEAREST_FIRST = """
                int i = depth++;
                for (; i > first && walk.entry[i - 1] < entry; --i) walk.entry[i] = walk.entry[i - 1];
                walk.entry[i] = entry;
"""

AS_THEY_COME = "walk.entry[depth++] = entry;"
"""For all hits, which are sorted at the end."""

SETUP_SLOT = """
    const int kx = ray.kx, ky = ray.ky, kz = ray.kz;
    const REAL ox = ray.ox, oy = ray.oy, oz = ray.oz, sx = ray.sx, sy = ray.sy;
    const auto& corner = meshes.data[m].corner;
    const auto candidates = [&](int block) -> int { CANDIDATES };
"""

FOUND_SLOT = """
                block = item;
                left = candidates(block);
                TESTED
                continue;
"""

AHEAD_SLOT = """
#if !defined(__CUDA_ARCH__)
                const char* ahead = child[lane] >= 0 ? (const char*)(corner.data + 80 * (size_t)child[lane])
                                                     : (const char*)(node.data + 32 * (size_t)(-2 - child[lane]));
                for (int line = 0; line < (child[lane] >= 0 ? 5 : 2); ++line) __builtin_prefetch(ahead + 64 * line);
#endif
"""

FOUND_ITEM = """
                keep(depth, 0);
                return item;
"""


def _code(real, trees: str, parts: dict[str, str]) -> str:
    """The walk through `trees`, with the parts that depend on what is listed."""
    code = f"    const auto& trees = {trees};\n" + NEXT
    for name, part in parts.items():
        code = code.replace(name, part)
    return native_code(code.replace("BOXES_MET", BOXES_MET).replace("JUMP", str(JUMP)), real)


def _slot_code(tier: Tier, looked: str = "", tested: str = "", place: str = NEAREST_FIRST) -> str:
    setup, found = SETUP_SLOT.replace("CANDIDATES", candidates_code(tier)), FOUND_SLOT.replace("TESTED", tested)
    parts = {"SETUP": setup, "FOUND": found, "AHEAD": AHEAD_SLOT, "LOOKED": looked, "PLACE": place}
    return _code(tier.real, "meshes.data[m].trees", parts)


@once
def make_start_walk(real):
    """A walk through a grid that begins where the ray does."""
    Grid, Walk = grid_struct(real), walk_struct(real)

    @wp.func
    def start_walk(grid: Grid, ray: Struct) -> Walk:
        at = cell_of(ray.o, grid.lo, grid.inv_cell, grid.count)
        walk = Walk()
        walk.x = at[0]
        walk.y = at[1]
        walk.z = at[2]
        _step_x, ahead_x = step_of(ray.inv_d[0])
        _step_y, ahead_y = step_of(ray.inv_d[1])
        _step_z, ahead_z = step_of(ray.inv_d[2])
        walk.tx = wall_t(grid.lo[0], grid.cell[0], at[0] + ahead_x, ray.o[0], ray.inv_d[0])
        walk.ty = wall_t(grid.lo[1], grid.cell[1], at[1] + ahead_y, ray.o[1], ray.inv_d[1])
        walk.tz = wall_t(grid.lo[2], grid.cell[2], at[2] + ahead_z, ray.o[2], ray.inv_d[2])
        walk.block = -2
        return walk

    return start_walk


@once
def make_next_instance(wide):
    """The next instance whose box the ray meets with t <= t_max, or -1: once for each cell that lists it."""
    Walk, Instances, Ray = walk_struct(wide), instances_struct(wide, True), world_ray_struct(wide)
    parts = {"SETUP": "", "FOUND": FOUND_ITEM, "AHEAD": "", "LOOKED": "", "PLACE": NEAREST_FIRST}

    @wp.func_native(_code(wide, "instances.trees", parts))
    def next_instance(walk: wp.ref[Walk], instances: wp.ref[Instances], ray: wp.ref[Ray], t_max: wide) -> int: ...

    return next_instance


@once
def make_next_slot(tier: Tier, search: Search):
    """The next triangle, by its slot, that the ray may hit with t <= t_max, or -1: roughly front to back."""
    real, place = tier.real, AS_THEY_COME if search is Search.ALL else NEAREST_FIRST
    Walk, Mesh, FaceRay = walk_struct(real), mesh_struct(tier, True), face_ray_struct(tier)

    @wp.func_native(_slot_code(tier, place=place))
    def next_slot(
        walk: wp.ref[Walk], meshes: wp.array(dtype=Mesh), m: int, ray: wp.ref[FaceRay], t_max: real
    ) -> int: ...

    return next_slot


@once
def make_recorded_slot(tier: Tier):
    """As `next_slot`, but that it writes down which cells it looks at, and how many triangles it tests in each."""
    real = tier.real
    Walk, Mesh, FaceRay = walk_struct(real), mesh_struct(tier, True), face_ray_struct(tier)
    looked = "looked.data[walk.looked] = cell; tested.data[walk.looked++] = 0;"

    @wp.func_native(_slot_code(tier, looked, "tested.data[walk.looked - 1] += 8;"))
    def recorded_slot(
        walk: wp.ref[Walk],
        meshes: wp.array(dtype=Mesh),
        m: int,
        ray: wp.ref[FaceRay],
        t_max: real,
        looked: wp.array(dtype=wp.int32),
        tested: wp.array(dtype=wp.int32),
    ) -> int: ...

    return recorded_slot


@once
def make_counted_slot(tier: Tier):
    """As `next_slot`, but that it counts the cells it looks at, and the triangles it tests."""
    real = tier.real
    Walk, Mesh, FaceRay, Effort = walk_struct(real), mesh_struct(tier, True), face_ray_struct(tier), effort_struct()

    @wp.func_native(_slot_code(tier, "++effort.cells;", "effort.tests += 8;"))
    def counted_slot(
        walk: wp.ref[Walk],
        meshes: wp.array(dtype=Mesh),
        m: int,
        ray: wp.ref[FaceRay],
        t_max: real,
        effort: wp.ref[Effort],
    ) -> int: ...

    return counted_slot
