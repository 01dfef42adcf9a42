"""Eight rays taken into the canonical space of a mesh at once: `enter`, `face_ray` and the first cell, lane by lane.

On a CPU, where a ray that sees one mesh would spend a third of its time here, the lanes are vectors; on a GPU a packet
is one ray. Each operation is rounded as in instance.py, faces.py and grid.py, so the bits are theirs.
"""

import warp as wp

from .blocks import lowest_lane, make_face_at, native_code
from .faces import make_hit_walk
from .making import once
from .memory import int_at, make_at
from .spec import Search, Spec, Tier
from .structs import (
    face_hit_struct,
    face_ray_struct,
    grid_struct,
    hit_arrays_struct,
    hit_struct,
    make_struct,
    mat33,
    rays_struct,
    scene_struct,
    vec3,
)
from .trace import make_closer
from .tree_walk import walk_struct

PACKET = 8
"""Rays in a packet on a CPU."""

LOAD = """
#if !defined(__CUDA_ARCH__)
    typedef WIDE D __attribute__((ext_vector_type(8), aligned(4)));
    typedef double E __attribute__((ext_vector_type(8), aligned(8)));
    typedef float F __attribute__((ext_vector_type(8), aligned(4)));
    typedef int I __attribute__((ext_vector_type(8), aligned(4)));
    typedef decltype(D{} < D{}) L;
    // Eight vectors of three, as three vectors of eight.
    const auto split = [](auto a, auto b, auto c, D* v) {
        v[0] = __builtin_convertvector(__builtin_shufflevector(
            __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0), c, 0, 1, 2, 3, 4, 5, 10, 13), D);
        v[1] = __builtin_convertvector(__builtin_shufflevector(
            __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0), c, 0, 1, 2, 3, 4, 8, 11, 14), D);
        v[2] = __builtin_convertvector(__builtin_shufflevector(
            __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0), c, 0, 1, 2, 3, 4, 9, 12, 15), D);
    };
    double rest[24];
    const auto read = [&](const auto* narrow, const auto* wide, D* v) {
        if (count < 8) {
            for (int i = 0; i < 24; ++i) {
                const int k = i < 3 * count ? i : 0;
                rest[i] = rays.is_wide ? ((const double*)(wide + first))[k] : ((const float*)(narrow + first))[k];
            }
            const E* p = (const E*)rest;
            split(p[0], p[1], p[2], v);
        } else if (rays.is_wide) {
            const E* p = (const E*)(wide + first);
            split(p[0], p[1], p[2], v);
        } else {
            const F* p = (const F*)(narrow + first);
            split(p[0], p[1], p[2], v);
        }
    };
    const auto limit = [&](const double* t, int step) -> D {
        if (step == 0) return D{} + (WIDE)t[0];
        if (count == 8) return __builtin_convertvector(*(const E*)(t + first), D);
        D v = {};
        for (int lane = 0; lane < count; ++lane) v[lane] = t[first + lane];
        return v;
    };
    D o[3], d[3];
    read(rays.origin.data, rays.origin_wide.data, o);
    read(rays.direction.data, rays.direction_wide.data, d);
    const D t_min = limit(rays.t_min.data, rays.t_min_step), t_max = limit(rays.t_max.data, rays.t_max_step);
    const L lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const auto is_lane = lane < L{} + count;
    const D no_number = D{} + (WIDE)NAN;
#else
    typedef WIDE D;
    typedef int I;
    D o[3], d[3];
    for (int axis = 0; axis < 3; ++axis) {
        o[axis] = rays.is_wide ? (D)rays.origin_wide.data[first][axis] : (D)rays.origin.data[first][axis];
        d[axis] = rays.is_wide ? (D)rays.direction_wide.data[first][axis] : (D)rays.direction.data[first][axis];
    }
    const D t_min = rays.t_min.data[first * rays.t_min_step], t_max = rays.t_max.data[first * rays.t_max_step];
    const bool is_lane = true;
    const D no_number = NAN;
#endif
    const D zero = {};
    D nothing = {};
    auto moves = zero < zero;
    for (int axis = 0; axis < 3; ++axis) {
        nothing += (o[axis] - o[axis]) + (d[axis] - d[axis]);
        moves |= d[axis] != zero;
        *(D*)&packet.world[8 * axis] = o[axis];
        *(D*)&packet.world[24 + 8 * axis] = d[axis];
    }
    const auto is_ray = is_lane & (nothing == zero) & moves & (t_min <= t_max);
    // Nothing is below NaN: what is not a ray enters nothing.
    *(D*)&packet.t[0] = is_ray ? t_max + (WIDE)2.384185791015625e-07 * (t_max < zero ? -t_max : t_max) : no_number;
    *(D*)&packet.t_min[0] = t_min;
    *(D*)&packet.t_max[0] = t_max;
    *(I*)&packet.instance[0] = I{} - 1;
    *(I*)&packet.primitive[0] = I{} - 1;
"""

STORE = """
#if !defined(__CUDA_ARCH__)
    typedef WIDE D __attribute__((ext_vector_type(8), aligned(4)));
    typedef REAL R __attribute__((ext_vector_type(8), aligned(4)));
    typedef int I __attribute__((ext_vector_type(8), aligned(4)));
    typedef decltype(R{} < R{}) S;
    typedef bool B8 __attribute__((ext_vector_type(8)));
    const I instance = *(const I*)&packet.instance[0];
    const S is_hit = __builtin_convertvector(instance >= 0, S);
    const R t = is_hit ? __builtin_convertvector(*(const D*)&packet.t[0], R) : R{} + (REAL)INFINITY;
    if (count == 8) {
        if (hits.t.shape[0] > 0) *(R*)(hits.t.data + first) = t;
        if (hits.instance_id.shape[0] > 0) *(I*)(hits.instance_id.data + first) = instance;
        if (hits.primitive_id.shape[0] > 0) *(I*)(hits.primitive_id.data + first) = *(const I*)&packet.primitive[0];
        for (int lane = 0; lane < 8 && hits.hit.shape[0] > 0; ++lane) hits.hit.data[first + lane] = instance[lane] >= 0;
        return;
    }
#else
    const REAL t[1] = {packet.instance[0] >= 0 ? (REAL)packet.t[0] : (REAL)INFINITY};
#endif
    for (int lane = 0; lane < count; ++lane) {
        if (hits.t.shape[0] > 0) hits.t.data[first + lane] = t[lane];
        if (hits.instance_id.shape[0] > 0) hits.instance_id.data[first + lane] = packet.instance[lane];
        if (hits.primitive_id.shape[0] > 0) hits.primitive_id.data[first + lane] = packet.primitive[lane];
        if (hits.hit.shape[0] > 0) hits.hit.data[first + lane] = packet.instance[lane] >= 0;
    }
"""

ENTER = """
#if !defined(__CUDA_ARCH__)
    typedef WIDE D __attribute__((ext_vector_type(8), aligned(4)));
    typedef LONG L __attribute__((ext_vector_type(8), aligned(4)));
    typedef REAL R __attribute__((ext_vector_type(8), aligned(4)));
    typedef decltype(R{} < R{}) S;
    typedef int I __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool B8 __attribute__((ext_vector_type(8)));
    const auto bits = [](D x) { return __builtin_bit_cast(L, x); };
    const auto number = [](L x) { return __builtin_bit_cast(D, x); };
    const auto floored = [](D x) { return __builtin_elementwise_floor(x); };
    const auto wide = [](R x) { return __builtin_convertvector(x, D); };
    const auto narrow = [](D x) { return __builtin_convertvector(x, R); };
    const auto whole = [](R x) { return __builtin_convertvector(x, I); };
    const auto real = [](I x) { return __builtin_convertvector(x, R); };
    const auto choice = [](S x) { return __builtin_convertvector(x, I); };
#else
    typedef WIDE D;
    typedef LONG L;
    typedef REAL R;
    typedef int S;
    typedef int I;
    const auto bits = [](D x) { return WIDE_AS_LONG(x); };
    const auto number = [](L x) { return LONG_AS_WIDE(x); };
    const auto floored = [](D x) { return floor(x); };
    const auto wide = [](R x) { return (D)x; };
    const auto narrow = [](D x) { return (R)x; };
    const auto whole = [](R x) { return (I)x; };
    const auto real = [](I x) { return (R)x; };
    const auto choice = [](S x) { return x; };
#endif
    const D zero = {};
    const R none = {};
    // instance.py: enter
    D o[3], d[3], near[3], far[3];
    for (int axis = 0; axis < 3; ++axis) o[axis] = *(const D*)&packet.world[8 * axis] - b[axis];
    const D x = o[0], y = o[1], z = o[2];
    const D dx = *(const D*)&packet.world[24], dy = *(const D*)&packet.world[32], dz = *(const D*)&packet.world[40];
    for (int axis = 0; axis < 3; ++axis) {
        o[axis] = w.data[axis][0] * x + w.data[axis][1] * y + w.data[axis][2] * z;
        d[axis] = w.data[axis][0] * dx + w.data[axis][1] * dy + w.data[axis][2] * dz;
    }
    const D ax = d[0] < zero ? -d[0] : d[0], ay = d[1] < zero ? -d[1] : d[1], az = d[2] < zero ? -d[2] : d[2];
    D size = ay > ax ? ay : ax;
    size = az > size ? az : size;
    const L exponent = (bits(size) >> DIGITS) & (2 * BIAS + 1);
    const L half = L{} + ((LONG)1 << (DIGITS - 1));
    const D scale = number(exponent == 2 * BIAS ? half : (2 * BIAS - exponent) << DIGITS);
    const D inv_scale = (WIDE)1.0 / scale;
    for (int axis = 0; axis < 3; ++axis) {
        d[axis] = scale * d[axis];
        const D tiny = zero + (WIDE)LEAST_SLOPE, size = d[axis] < zero ? -d[axis] : d[axis];
        const D inv = (WIDE)1.0 / (size < tiny ? (d[axis] < zero ? -tiny : tiny) : d[axis]);
        const D first = ((lower[axis] - pad) - o[axis]) * inv, second = ((upper[axis] + pad) - o[axis]) * inv;
        near[axis] = second < first ? second : first;
        far[axis] = second > first ? second : first;
    }
    D enters = near[1] > near[0] ? near[1] : near[0], leaves = far[1] < far[0] ? far[1] : far[0];
    enters = near[2] > enters ? near[2] : enters;
    leaves = far[2] < leaves ? far[2] : leaves;
    const D best = *(const D*)&packet.t[0];
    const D t_min = *(const D*)&packet.t_min[0];
    const D first = (t_min - (WIDE)1.1920928955078125e-07 * (t_min < zero ? -t_min : t_min)) * inv_scale;
    D start = ((t_min < zero) | (enters > zero)) ? enters : zero;
    const D far_off = start < zero ? -start : start;
    start = far_off > (WIDE)1.0e7 ? start - (WIDE)FAR_ROUNDINGS * far_off
                                  : floored(start * (WIDE)1024.0) * (WIDE)0.0009765625;
    auto is_met = (enters <= leaves) & (first <= leaves) & (scale * start <= best);
#if !defined(__CUDA_ARCH__)
    const int met = __builtin_bit_cast(unsigned char, __builtin_convertvector(is_met, B8));
#else
    const int met = is_met;
#endif
    if (met == 0) return 0;
    *(D*)&packet.start[0] = start;
    *(D*)&packet.scale[0] = scale;
    KEEP
    const D reach = best * inv_scale;
    const D terms = (reach < zero ? -reach : reach) + (start < zero ? -start : start);
    const R limit = narrow((reach - start) + (WIDE)SUM_ROUNDINGS * terms);
    *(R*)&packet.limit[0] = limit + (R)((REAL)ROUNDINGS * (limit < none ? -limit : limit));
    // faces.py: face_ray
    R ro[3], rd[3], inv[3], magnitude[3];
    for (int axis = 0; axis < 3; ++axis) {
        ro[axis] = narrow(o[axis] + start * d[axis]);
        rd[axis] = narrow(d[axis]);
        const R tiny = none + (REAL)LEAST_REAL_SLOPE;
        magnitude[axis] = rd[axis] < none ? -rd[axis] : rd[axis];
        inv[axis] = (REAL)1.0 / (magnitude[axis] < tiny ? (rd[axis] < none ? -tiny : tiny) : rd[axis]);
        *(R*)&packet.ray[8 * axis] = ro[axis];
        *(R*)&packet.ray[24 + 8 * axis] = rd[axis];
        *(R*)&packet.ray[48 + 8 * axis] = inv[axis];
    }
    const S is_x = (magnitude[0] >= magnitude[1]) & (magnitude[0] >= magnitude[2]);
    const S is_y = (magnitude[1] >= magnitude[2]);
    const R along = is_x ? rd[0] : (is_y ? rd[1] : rd[2]);
    const R next = is_x ? rd[1] : (is_y ? rd[2] : rd[0]), last = is_x ? rd[2] : (is_y ? rd[0] : rd[1]);
    const R o_next = is_x ? ro[1] : (is_y ? ro[2] : ro[0]), o_last = is_x ? ro[2] : (is_y ? ro[0] : ro[1]);
    const S is_back = along < none;
    *(R*)&packet.ray[72] = is_back ? o_last : o_next;
    *(R*)&packet.ray[80] = is_back ? o_next : o_last;
    *(R*)&packet.ray[88] = is_x ? ro[0] : (is_y ? ro[1] : ro[2]);
    *(R*)&packet.ray[96] = (is_back ? last : next) / along;
    *(R*)&packet.ray[104] = (is_back ? next : last) / along;
    const I kz = choice(is_x) ? I{} : (choice(is_y) ? I{} + 1 : I{} + 2);
    const I after = kz == 2 ? I{} : kz + 1, before = 3 - kz - after;
    *(I*)&packet.axis[0] = choice(is_back) ? before : after;
    *(I*)&packet.axis[8] = choice(is_back) ? after : before;
    *(I*)&packet.axis[16] = kz;
    // grid.py: cell_of and wall_t
    for (int axis = 0; axis < 3; ++axis) {
        R at = (ro[axis] - grid.lo[axis]) * grid.inv_cell[axis];
        at = at < none ? none : at;
        at = at > (REAL)2147483520.0 ? none + (REAL)2147483520.0 : at;
        const I index = whole(at), most = I{} + (grid.count[axis] - 1);
        const I cell = index > most ? most : index;
        *(I*)&packet.axis[24 + 8 * axis] = cell;
        const I ahead = choice(inv[axis] < none) ? cell : cell + 1;
        *(R*)&packet.ray[112 + 8 * axis] = ((grid.lo[axis] + real(ahead) * grid.cell[axis]) - ro[axis]) * inv[axis];
    }
    return met;
"""

TAKE = """
    ray.o = wp::vec_t<3, REAL>(packet.ray[lane], packet.ray[8 + lane], packet.ray[16 + lane]);
    ray.d = wp::vec_t<3, REAL>(packet.ray[24 + lane], packet.ray[32 + lane], packet.ray[40 + lane]);
    ray.inv_d = wp::vec_t<3, REAL>(packet.ray[48 + lane], packet.ray[56 + lane], packet.ray[64 + lane]);
    ray.ox = packet.ray[72 + lane], ray.oy = packet.ray[80 + lane], ray.oz = packet.ray[88 + lane];
    ray.sx = packet.ray[96 + lane], ray.sy = packet.ray[104 + lane];
    ray.kx = packet.axis[lane], ray.ky = packet.axis[8 + lane], ray.kz = packet.axis[16 + lane];
    TAKE_SHEAR
    ray.start = packet.start[lane], ray.scale = packet.scale[lane];
    ray.t_min = packet.t_min[lane], ray.t_max = packet.t_max[lane];
    walk.x = packet.axis[24 + lane], walk.y = packet.axis[32 + lane], walk.z = packet.axis[40 + lane];
    walk.tx = packet.ray[112 + lane], walk.ty = packet.ray[120 + lane], walk.tz = packet.ray[128 + lane];
    walk.block = -2, walk.left = 0, walk.depth = 0;
"""

KEEP_FINE = """
    for (int axis = 0; axis < 3; ++axis) {
        *(D*)&packet.fine[8 * axis] = o[axis] + start * d[axis];
        *(D*)&packet.fine[24 + 8 * axis] = d[axis];
    }
"""

TAKE_FINE = """
    ray.fine.ox = packet.fine[8 * ray.kx + lane];
    ray.fine.oy = packet.fine[8 * ray.ky + lane];
    ray.fine.oz = packet.fine[8 * ray.kz + lane];
    ray.dz = packet.fine[24 + 8 * ray.kz + lane];
    ray.fine.sx = packet.fine[24 + 8 * ray.kx + lane] / ray.dz;
    ray.fine.sy = packet.fine[24 + 8 * ray.ky + lane] / ray.dz;
"""


def packet_code(code: str, tier: Tier, real: type | None = None) -> str:
    """The code for a tier; REAL is the arithmetic of its walks unless another is named."""
    is_double, is_real_double = tier.wide is wp.float64, tier.real is wp.float64
    tokens = {
        "KEEP": KEEP_FINE if tier.has_fine else "",
        "TAKE_SHEAR": TAKE_FINE if tier.has_fine else "ray.dz = packet.ray[24 + 8 * ray.kz + lane];",
        "LEAST_SLOPE": "0x1p-500" if is_double else "0x1p-100",
        "LEAST_REAL_SLOPE": "0x1p-500" if is_real_double else "0x1p-100",
        "FAR_ROUNDINGS": "3.5527136788005009e-15" if is_double else "1.9073486328125e-06",
        "SUM_ROUNDINGS": "4.440892098500626e-16" if is_double else "2.384185791015625e-07",
        "ROUNDINGS": "2.220446049250313e-16" if is_real_double else "1.1920928955078125e-07",
        "WIDE_AS_LONG": "__double_as_longlong" if is_double else "__float_as_int",
        "LONG_AS_WIDE": "__longlong_as_double" if is_double else "__int_as_float",
        "WIDE": "double" if is_double else "float",
        "LONG": "long long" if is_double else "int",
        "DIGITS": "52" if is_double else "23",
        "BIAS": "1023" if is_double else "127",
    }
    for token, text in tokens.items():
        code = code.replace(token, text)
    return native_code(code, real or tier.real)


@once
def packet_struct(tier: Tier):
    """Eight rays and their best hits; in the space of a mesh, what `face_ray_struct` and `walk_struct` hold of each."""
    wide, narrow, whole = (wp.types.vector(8, dtype) for dtype in (tier.wide, tier.real, wp.int32))
    fields = {
        "world": wp.types.vector(48, tier.wide),  # origin x y z, direction x y z
        "t_min": wide,
        "t_max": wide,
        "t": wide,  # nothing beyond it counts; NaN for what is not a ray
        "instance": whole,
        "primitive": whole,
        "start": wide,
        "scale": wide,
        "limit": narrow,  # t as a parameter of the local ray
        "ray": wp.types.vector(136, tier.real),  # o d inv_d; ox oy oz sx sy; tx ty tz
        "axis": wp.types.vector(48, wp.int32),  # kx ky kz; x y z
    }
    if tier.has_fine:
        fields["fine"] = wp.types.vector(48, tier.result)  # o d of the local ray
    return make_struct("Packet", fields)


@once
def make_load_packet(tier: Tier):
    """Fills a packet with rays first .. first + count - 1 that have hit nothing yet."""
    Packet, Rays = packet_struct(tier), rays_struct()

    @wp.func_native(packet_code(LOAD, tier))
    def load_packet(packet: wp.ref[Packet], rays: wp.ref[Rays], first: int, count: int): ...

    return load_packet


@once
def make_enter_packet(tier: Tier):
    """Takes a packet to a mesh: the lanes, as bits of an int, of the rays that meet its bounds within their limits."""
    Packet, Grid, vec, mat = packet_struct(tier), grid_struct(tier.real), vec3(tier.wide), mat33(tier.wide)

    @wp.func_native(packet_code(ENTER, tier))
    def enter_packet(
        packet: wp.ref[Packet],
        w: mat,
        b: vec,
        lower: vec,
        upper: vec,
        pad: tier.wide,
        grid: wp.ref[Grid],
    ) -> int: ...

    return enter_packet


@once
def make_take_lane(tier: Tier):
    """One ray of a packet, as the walk through a mesh wants it."""
    Packet, FaceRay, Walk = packet_struct(tier), face_ray_struct(tier), walk_struct(tier.real)

    @wp.func_native(packet_code(TAKE, tier))
    def take_lane(packet: wp.ref[Packet], lane: int, ray: wp.ref[FaceRay], walk: wp.ref[Walk]): ...

    return take_lane


@once
def make_store_packet(tier: Tier):
    """Stores t, ids and whether anything was hit of rays first .. first + count - 1, those that are asked for."""
    Packet, Arrays = packet_struct(tier), hit_arrays_struct(tier.result)

    @wp.func_native(packet_code(STORE, tier, tier.result))
    def store_packet(packet: wp.ref[Packet], hits: wp.ref[Arrays], first: int, count: int): ...

    return store_packet


@once
def make_trace_packet(spec: Spec, search: Search):
    """Closest (or any) hits of rays first .. first + count - 1, in a scene of which `spec.in_packets` is true.

    What `make_trace` finds for each ray, but that the primitive is the user's number of the face.
    """
    tier, wide = spec.tier, spec.tier.wide
    Scene, Packet, Rays, Hit = scene_struct(spec), packet_struct(tier), rays_struct(), hit_struct(wide)
    FaceRay, FaceHit, Walk = face_ray_struct(tier), face_hit_struct(tier, search), walk_struct(tier.real)
    load_packet, enter_packet, take_lane = make_load_packet(tier), make_enter_packet(tier), make_take_lane(tier)
    hit_walk, closer, face_at = make_hit_walk(spec, search), make_closer(spec, search), make_face_at(tier.real)
    vec_at, mat_at, is_closest = make_at(vec3(wide)), make_at(mat33(wide)), search is Search.CLOSEST

    @wp.func
    def hit_lane(scene: Scene, packet: wp.ref[Packet], lane: int, i: int, m: int):
        ray, walk, face = FaceRay(), Walk(), FaceHit()
        take_lane(packet, lane, ray, walk)
        face.slot = -1
        face.t = packet.limit[lane]
        face = hit_walk(scene.mesh, m, ray, walk, face)
        if face.slot >= 0:
            best = Hit()
            best.t = packet.t[lane]
            best.instance = packet.instance[lane]
            best.primitive = packet.primitive[lane]
            best = closer(face.t_world, i, face.slot, ray.t_min, ray.t_max, best)
            packet.t[lane] = best.t
            packet.instance[lane] = best.instance
            packet.primitive[lane] = best.primitive

    @wp.func
    def trace_packet(scene: Scene, rays: wp.ref[Rays], first: int, count: int, packet: wp.ref[Packet]):
        load_packet(packet, rays, first, count)
        k = int(0)
        while k < scene.instances.count:
            i = int_at(scene.instances.order, k)
            shape = scene.shape[int_at(scene.instances.shape, i)]
            w, b = mat_at(scene.instances.local_from_world, i), vec_at(scene.instances.origin, i)
            grid = scene.mesh[shape.mesh].trees.grid
            left = enter_packet(packet, w, b, shape.lower, shape.upper, shape.pad, grid)
            while left != 0:
                hit_lane(scene, packet, lowest_lane(left), i, shape.mesh)
                left = left & (left - 1)
            k += 1
        if wp.static(is_closest):
            lane = int(0)
            while lane < count:
                if packet.instance[lane] >= 0:
                    m = scene.shape[int_at(scene.instances.shape, packet.instance[lane])].mesh
                    packet.primitive[lane] = face_at(scene.mesh[m].corner, packet.primitive[lane])
                lane += 1

    return trace_packet
