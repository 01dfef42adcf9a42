"""Types of what lies on the device. A field exists only where the spec needs it."""

from dataclasses import replace

import warp as wp

from .making import once
from .spec import Look, Projection, Search, Spec, Tier

WIDE = wp.float64
"""Arithmetic in which structures are built, cameras aim and limits are stored, whatever the tier."""


def make_struct(name: str, fields: dict) -> type:
    """A Warp struct from a dictionary of its fields."""
    return wp.struct(type(name, (), {"__annotations__": fields, "__module__": __name__, "__qualname__": name}))


def vec3(real):
    """The vector of three reals."""
    return wp.types.vector(3, real)


def mat33(real):
    """The matrix of three rows of three reals."""
    return wp.types.matrix((3, 3), real)


@once
def grid_struct(real):
    """Uniform grid over lo .. lo + count * cell. Its cells hold ranges in CSR form."""
    return make_struct(
        "Grid",
        {
            "lo": vec3(real),
            "cell": vec3(real),  # edge lengths of one cell
            "inv_cell": vec3(real),
            "count": wp.vec3i,  # cells along x, y, z
            "start": wp.array(dtype=wp.int32),  # [cells + 1]  cell c has start[c] .. start[c + 1] - 1
        },
    )


@once
def trees_struct(real):
    """A grid whose cells list items, each cell's under a tree of boxes; see tree.py."""
    return make_struct(
        "Trees",
        {
            "grid": grid_struct(real),  # of nodes, those of a cell from its root on
            "gap": wp.array(dtype=wp.uint8),  # [cells]  how many cells it is to one that lists anything
            "node": wp.array(dtype=wp.int32),  # [32 nodes]
            "frame_lo": vec3(real),  # lower corner of the frame of cell 0; frames are as far apart as cells
            "frame_step": vec3(real),  # a frame is STEPS of these long
        },
    )


@once
def mesh_struct(tier: Tier, has_grid: bool):
    """A triangle mesh in its canonical space: centred, longest half extent in [1/2, 1], by a power of two."""
    fields = {
        "block_count": wp.int32,
        "corner": wp.array(dtype=tier.real),  # [80 blocks]  see blocks.py; a face without area is three equal points
    }
    if tier.has_fine:
        fields["fine"] = wp.array(dtype=tier.result)  # [80 blocks]  the same corners, with which faces are tested
    if has_grid:
        fields["trees"] = trees_struct(tier.real)  # of blocks
    return make_struct("Mesh", fields)


@once
def shape_struct(wide, has_mesh: bool):
    """A shape in its canonical space, with the bounds to which a ray is advanced."""
    fields = {
        "kind": wp.int32,
        "lower": vec3(wide),
        # sphere: r in each component; plane, which has no bounds: its normal; capsule: |z| of the centres of its ends
        "upper": vec3(wide),
        "pad": wide,  # added to the bounds on all sides before a ray is held against them
    }
    if has_mesh:
        fields["mesh"] = wp.int32
    return make_struct("Shape", fields)


@once
def instances_struct(wide, has_grid: bool):
    """Placements x_world = A x_canonical + origin."""
    fields = {
        "count": wp.int32,
        "shape": wp.array(dtype=wp.int32),
        "local_from_world": wp.array(dtype=mat33(wide)),  # W, the inverse of A
        "world_from_local": wp.array(dtype=mat33(wide)),  # A
        "inverse_error": wp.array(dtype=wp.float32),  # of each element of W, relative
        "origin": wp.array(dtype=vec3(wide)),
        "origin_error": wp.array(dtype=wp.vec3f),  # of each component: the shape's centre has been folded in
        "order": wp.array(dtype=wp.int32),  # instances that no grid lists come first
        "loose_count": wp.int32,  # how many those are
    }
    if has_grid:
        fields |= {
            "trees": trees_struct(wide),  # of instances
            "center": vec3(wide),  # the grid is relative to it
            "reach": wide,  # rays from farther away, whose rounding may exceed the padding, test every instance
        }
    return make_struct("Instances", fields)


@once
def scene_struct(spec: Spec):
    """All geometry."""
    fields = {
        "instances": instances_struct(spec.tier.wide, spec.instance_grid),
        "shape": wp.array(dtype=shape_struct(spec.tier.wide, spec.has_mesh)),
    }
    if spec.has_mesh:
        fields["mesh"] = wp.array(dtype=mesh_struct(spec.tier, spec.mesh_grid))
    return make_struct("Scene", fields)


@once
def local_ray_struct(wide):
    """A ray in canonical space: the world parameter is scale * (start + t)."""
    return make_struct(
        "LocalRay",
        {
            "is_hit": wp.bool,  # whether it meets the bounds
            "o": vec3(wide),  # already at the bounds
            "d": vec3(wide),  # largest component in [1, 2)
            "start": wide,
            "scale": wide,
            "inv_scale": wide,  # 1 / scale, exact
        },
    )


@once
def world_ray_struct(wide):
    """A ray as the user gave it, with what the grid over instances needs."""
    return make_struct(
        "WorldRay",
        {
            "o": vec3(wide),  # relative to the centre of the grid, where the ray enters it
            "d": vec3(wide),
            "inv_d": vec3(wide),
            "o_world": vec3(wide),
            "t_start": wide,  # where that is
            "t_min": wide,
            "t_max": wide,
        },
    )


@once
def sheared_struct(real):
    """What shears a ray onto its main axis: the origin along each axis, and the slopes."""
    return make_struct("Sheared", {"ox": real, "oy": real, "oz": real, "sx": real, "sy": real})


@once
def face_ray_struct(tier: Tier):
    """A local ray sheared onto its main axis, with the limits a hit must keep."""
    real, wide = tier.real, tier.wide
    fields = {
        "o": vec3(real),
        "d": vec3(real),
        "inv_d": vec3(real),
        "kx": wp.int32,
        "ky": wp.int32,
        "kz": wp.int32,
        "ox": real,
        "oy": real,
        "oz": real,
        "sx": real,
        "sy": real,
        "dz": wide,
        "start": wide,
        "scale": wide,
        "t_min": wide,
        "t_max": wide,
    }
    if tier.has_fine:
        fields["fine"] = sheared_struct(tier.result)
    return make_struct("FaceRay", fields)


@once
def face_hit_struct(tier: Tier, search: Search):
    """Best hit within one mesh; in a search for all hits, those found so far."""
    fields = {"t": tier.real}  # local parameter beyond which nothing counts, or can be as near
    if search is Search.ALL:
        fields |= {"instance": wp.int32, "gathered": gathered_struct(tier.wide)}
    else:
        fields |= {"t_world": tier.wide, "slot": wp.int32}
        if search is Search.COUNTED:
            fields["effort"] = effort_struct()
    return make_struct("FaceHit", fields)


@once
def hit_struct(wide):
    """Best hit over all instances. A miss has instance -1; on a mesh, the primitive is a slot of its blocks."""
    return make_struct("Hit", {"t": wide, "instance": wp.int32, "primitive": wp.int32})


@once
def effort_struct():
    """What a search has looked at so far."""
    return make_struct("Effort", {"cells": wp.int32, "tests": wp.int32})


@once
def counted_struct(wide):
    """A hit, and what it took to find it."""
    fields = {"t": wide, "instance": wp.int32, "primitive": wp.int32, "effort": effort_struct()}
    return make_struct("Counted", fields)


@once
def crossed_struct(wide):
    """One of all hits of a ray."""
    return make_struct(
        "Crossed",
        {
            "t": wide,
            "instance": wp.int32,
            "primitive": wp.int32,  # as in Hit
            "touch": wp.int32,  # on a mesh: see triangle.touch_sheared; bit 5: does not count
        },
    )


@once
def gathered_struct(wide):
    """All hits of a ray so far."""
    return make_struct(
        "Gathered",
        {
            "t": wide,  # the end of the ray
            "met": wp.int32,  # how many, some of them twice
            "count": wp.int32,  # how many are held; room + 1 if there were more
            "room": wp.int32,  # for how many of them there is
            "room_at": wp.uint64,  # an address, not an array: this struct is handed from function to function
        },
    )


def found_struct(wide, search: Search):
    """What a search carries along."""
    if search is Search.COUNTED:
        return counted_struct(wide)
    return gathered_struct(wide) if search is Search.ALL else hit_struct(wide)


@once
def trail_struct():
    """Where the cells that a ray pierces are written; while they are only counted, the arrays are empty."""
    return make_struct(
        "Trail",
        {
            "cell": wp.array(dtype=wp.vec3i),
            "t_enter": wp.array(dtype=WIDE),
            "t_exit": wp.array(dtype=WIDE),
            "candidates": wp.array(dtype=wp.int32),  # triangles that are tested there
            "visited": wp.array(dtype=wp.bool),  # whether the traversal looks at the cell, or jumps over it
            "found": wp.array(dtype=wp.bool),  # whether the hit is found there
            "looked": wp.array(dtype=wp.int32),  # the cells that the traversal looks at
            "tested": wp.array(dtype=wp.int32),  # triangles in each of them
            "hit_instance": wp.int32,  # the closest hit, -1 for none
            "hit_face": wp.int32,
        },
    )


@once
def trail_end_struct(real):
    """Where a walk enters the grid and is to end, how many cells are written, which looked at come next, and more."""
    numbers = ("count", "next", "last", "found")  # found: of those looked at, the one with the hit, or -1
    return make_struct("TrailEnd", {"t_enter": real, "t": real, **dict.fromkeys(numbers, wp.int32)})


@once
def surface_struct(wide):
    """What is known of a surface point, in world space."""
    return make_struct(
        "Surface",
        {
            "position": vec3(wide),  # on the surface
            "normal": vec3(wide),  # unit, outward
            "u": wide,
            "v": wide,
            "axis": wp.int32,  # of a box: which wall, and whether the upper one
            "is_upper": wp.bool,
            "part": wp.int32,  # of a cylinder, cone or capsule; see capped.py
            "offset": wide,  # how far along the normal a ray must start so as not to meet this surface
        },
    )


@once
def rays_struct():
    """Rays as they came: float32 or float64, limits for each ray or one for all (step 0)."""
    return make_struct(
        "Rays",
        {
            "is_wide": wp.bool,
            "origin": wp.array(dtype=wp.vec3f),
            "direction": wp.array(dtype=wp.vec3f),
            "origin_wide": wp.array(dtype=wp.vec3d),
            "direction_wide": wp.array(dtype=wp.vec3d),
            "t_min": wp.array(dtype=WIDE),
            "t_max": wp.array(dtype=WIDE),
            "t_min_step": wp.int32,
            "t_max_step": wp.int32,
        },
    )


def _hit_arrays(real) -> dict:
    return {
        "hit": wp.array(dtype=wp.bool),
        "t": wp.array(dtype=real),
        "instance_id": wp.array(dtype=wp.int32),
        "primitive_id": wp.array(dtype=wp.int32),
        "position": wp.array(dtype=vec3(real)),
        "normal": wp.array(dtype=vec3(real)),
        "uv": wp.array(dtype=wp.types.vector(2, real)),
        "t_error": wp.array(dtype=real),
    }


@once
def hit_arrays_struct(real):
    """Where hits are stored. A field nobody asked for is an empty array."""
    return make_struct("HitArrays", _hit_arrays(real))


@once
def bounded_arrays_struct(real):
    """The same where the bound of the point is stored too."""
    return make_struct("BoundedArrays", {**_hit_arrays(real), "position_error": wp.array(dtype=real)})


@once
def camera_struct(projection: Projection):
    """A camera for pictures of one size. What a column and a row mean is said in camera.py."""
    plane = {
        "corner": wp.vec3d,  # the top left corner of the picture
        "right": wp.vec3d,  # one pixel to the right
        "down": wp.vec3d,  # one pixel down
    }
    frame = {"position": wp.vec3d, "right": wp.vec3d, "up": wp.vec3d, "forward": wp.vec3d}  # vectors of length 1
    fields = {
        Projection.PINHOLE: {"position": wp.vec3d, **plane},
        Projection.ORTHOGRAPHIC: {"forward": wp.vec3d, **plane},
        Projection.FISHEYE: {**frame, "along": WIDE},  # radians that one pixel spans
        Projection.EQUIRECTANGULAR: {**frame, "across": WIDE, "along": WIDE},  # to the right, and down
    }
    return make_struct("Camera", {**fields[projection], "width": wp.int32, "height": wp.int32})


@once
def texture_struct():
    """A picture among the texels of all; see texture.py."""
    return make_struct(
        "Texture",
        {
            "first": wp.int32,  # where its words begin, row by row from the top
            "width": wp.int32,
            "height": wp.int32,
            "wrap": wp.int32,
            "is_nearest": wp.bool,  # whether a texel is one colour throughout
            "table": wp.int32,  # where the levels of its 8-bit channels begin, -1 for floats
        },
    )


@once
def attributes_struct(look: Look):
    """What a mesh has at its vertices."""
    fields = {"face": wp.array(dtype=wp.int32)}  # [3 faces]  vertices, as the user gave them
    if look.textures:
        fields["uv"] = wp.array(dtype=wp.types.vector(2, look.spec.tier.result))  # [vertices]
    if look.vertex_colors:
        fields["color"] = wp.array(dtype=wp.vec3f)  # [vertices], or none
    if look.smooth_normals:
        fields["normal"] = wp.array(dtype=vec3(look.spec.tier.result))  # [vertices], or none
    return make_struct("Attributes", fields)


@once
def point_struct(look: Look):
    """A surface point that is to be lit, in world space."""
    wide = look.spec.tier.wide
    fields = {
        "position": vec3(wide),
        "normal": vec3(wide),  # unit, of the side that is seen
        "offset": wide,  # as in Surface
        "material": wp.int32,
    }
    if look.has_tint:
        fields["shade"] = wp.vec3f  # multiplies the material's shares
    if look.glass:
        fields["is_inside"] = wp.bool
    if look.smooth_normals:
        fields["shading_normal"] = vec3(wide)
    if look.highlights:
        fields |= {
            "to_eye": vec3(wide),  # unit
            "shininess": wp.float32,
        }
    if look.rectangle_lights:
        fields |= {"pixel": wp.int32, "sample": wp.int32, "bounce": wp.int32}  # of the path
    return make_struct("Point", fields)


@once
def path_struct(look: Look):
    """A ray on its way from a camera, and which one it is."""
    fields = {
        "o": vec3(look.spec.tier.wide),
        "d": vec3(look.spec.tier.wide),
    }
    if look.goes_on:
        # The share of the light along the ray that reaches the camera, 0 at its end; and how often it has gone on.
        fields |= {"throughput": wp.vec3f, "bounce": wp.int32}
    if look.has_chance:
        fields |= {"pixel": wp.int32, "sample": wp.int32}
    if look.paths and look.shown_lamps:
        fields["is_scattered"] = wp.bool  # at the last surface
    if look.glass:
        fields["medium"] = wp.vec3f  # the absorption of what the ray is in
    return make_struct("Path", fields)


@once
def lit_struct(look: Look):
    """Direct light at a point, before the point's own colours."""
    fields = {"light": wp.vec3f}  # scattered evenly
    if look.highlights:
        fields["highlight"] = wp.vec3f
    return make_struct("Lit", fields)


@once
def film_struct(is_measured: bool, goes_on: bool):
    """What pixels have received so far, from `first` on. Sums are in float64: samples may be a million."""
    fields = {"first": wp.int32, "total": wp.array(dtype=wp.vec3d)}  # sums over the samples of a pixel
    if goes_on:
        fields["max_bounces"] = wp.int32  # surfaces at which a path may go on
    if is_measured:
        fields |= {
            "spread": wp.array(dtype=wp.vec3d),  # sums of the squares of what samples are off their mean
            "count": wp.array(dtype=wp.int32),
            "is_active": wp.array(dtype=wp.bool),  # whether a pixel needs more samples
            "noise": wp.float64,  # of one that does not
        }
    else:
        fields["count"] = wp.int32  # samples of every pixel
    return make_struct("Film", fields)


@once
def look_struct(look: Look):
    """Materials, lights and sky: the same for all ways to follow light."""
    if look.paths:
        return look_struct(replace(look, paths=False))
    fields = {
        "material": wp.array(dtype=wp.int32),  # [instances]
        "diffuse": wp.array(dtype=wp.vec3f),  # [materials]
        "sky": wp.vec3f,  # at the horizon; a factor of a picture
    }
    if look.ambient:
        fields["ambient"] = wp.vec3f
    if look.mirrors:
        fields["mirror"] = wp.array(dtype=wp.vec3f)  # [materials]
    if look.emission:
        fields["emission"] = wp.array(dtype=wp.vec3f)  # [materials]
    if look.shown_lamps:
        fields["shines"] = wp.array(dtype=wp.bool)  # [materials]  whether others are lit by it
    if look.highlights:
        fields |= {
            "specular": wp.array(dtype=wp.vec3f),  # [materials]  times what makes a lobe of shininess reflect all
            "shininess": wp.array(dtype=wp.float32),  # [materials]
        }
    if look.glass:
        fields |= {
            "glass": wp.array(dtype=wp.vec3f),  # [materials]
            "absorption": wp.array(dtype=wp.vec3f),  # [materials]
            "ior": wp.array(dtype=WIDE),  # [materials]
        }
    if look.gradient_sky:
        fields["zenith"] = wp.vec3f
    if look.point_lights:
        fields |= {
            "point_position": wp.array(dtype=wp.vec3d),
            "point_color": wp.array(dtype=wp.vec3f),
            "point_falloff": wp.array(dtype=wp.bool),
        }
    if look.spot_lights:
        fields |= {
            "spot_position": wp.array(dtype=wp.vec3d),
            "spot_direction": wp.array(dtype=wp.vec3d),  # unit
            "spot_color": wp.array(dtype=wp.vec3f),
            "spot_cone": wp.array(dtype=wp.vec2d),  # cosines of the inner and the outer angle
            "spot_falloff": wp.array(dtype=wp.bool),
        }
    if look.rectangle_lights:
        fields |= {
            "rectangle_corner": wp.array(dtype=wp.vec3d),
            "rectangle_u": wp.array(dtype=wp.vec3d),  # the edges that meet there
            "rectangle_v": wp.array(dtype=wp.vec3d),
            "rectangle_color": wp.array(dtype=wp.vec3f),
        }
    if look.directional_lights:
        fields |= {"sun_direction": wp.array(dtype=wp.vec3d), "sun_color": wp.array(dtype=wp.vec3f)}
    if look.has_attributes:
        fields["attributes"] = wp.array(dtype=attributes_struct(look))  # [meshes]
    if look.image_sky:
        fields |= {
            "sky_texture": texture_struct(),
            "sky_turn": WIDE,  # of a full turn
        }
    if look.textures:
        fields |= {
            "texture_number": wp.array(dtype=wp.int32),  # [materials]  -1 for none
            "texture": wp.array(dtype=texture_struct()),
        }
    if look.has_texels:
        fields |= {
            "texel": wp.array(dtype=wp.uint32),
            "level": wp.array(dtype=wp.float32),
        }
    return make_struct("Look", fields)
