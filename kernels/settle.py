"""All hits of one ray put in order, each crossing of a surface once."""

from functools import cache

import warp as wp

from .blocks import make_corner, slot_row
from .spec import Spec
from .structs import crossed_struct, hit_struct, scene_struct
from .trace import make_primitive_id


@cache
def make_same_place(spec: Spec):
    """Whether two hits are one: at an edge or vertex that their faces share, where both face the ray the same way."""
    result = spec.tier.result
    Scene, Crossed, corner = scene_struct(spec), crossed_struct(spec.tier.wide), make_corner(result)
    has_fine = spec.tier.has_fine

    @wp.func
    def place(corners: wp.array(dtype=result), slot: int, touch: int):
        """The ends of the edge at which a hit lies; both are the vertex if it lies at one."""
        row = slot_row(slot)
        a, b, c = corner(corners, row, 0), corner(corners, row, 1), corner(corners, row, 2)
        edges = touch & 7
        if edges == 1:
            return b, c
        if edges == 2:
            return a, c
        if edges == 4:
            return a, b
        vertex = wp.where(edges == 6, a, wp.where(edges == 5, b, c))
        return vertex, vertex

    @wp.func
    def same_place(scene: Scene, one: Crossed, other: Crossed):
        if one.instance != other.instance or (one.touch & 8) != (other.touch & 8):
            return False
        mesh = scene.mesh[scene.shape[scene.instances.shape[one.instance]].mesh]
        if wp.static(has_fine):
            p, q = place(mesh.fine, one.primitive, one.touch)
            r, s = place(mesh.fine, other.primitive, other.touch)
        else:
            p, q = place(mesh.corner, one.primitive, one.touch)
            r, s = place(mesh.corner, other.primitive, other.touch)
        return (p == r and q == s) or (p == s and q == r)

    return same_place


@cache
def make_settle(spec: Spec):
    """Sorts hits by t, instance and primitive, and keeps each crossing of a surface once, `most` of them; how many."""
    wide = spec.tier.wide
    Scene, Crossed, Hit = scene_struct(spec), crossed_struct(wide), hit_struct(wide)
    primitive_id, has_mesh = make_primitive_id(spec), spec.has_mesh
    same_place = make_same_place(spec) if has_mesh else None

    @wp.func
    def face(scene: Scene, crossed: Crossed) -> int:
        hit = Hit()
        hit.instance = crossed.instance
        hit.primitive = crossed.primitive
        return primitive_id(scene, hit)

    @wp.func
    def is_before(scene: Scene, one: Crossed, other: Crossed):
        if one.t != other.t:
            return one.t < other.t
        if one.instance != other.instance:
            return one.instance < other.instance
        return face(scene, one) < face(scene, other)

    @wp.func
    def sort(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int):
        """Shell's sort, with gaps that shrink by 4/9: for the few hits of most rays it is a sort by insertion."""
        gap = int(1)
        while gap * 9 < count * 4:
            gap = (gap * 9 + 4) / 4
        while gap >= 1:
            for i in range(gap, count):
                moved = crossed[first + i]
                j = int(i)
                while j >= gap and is_before(scene, moved, crossed[first + j - gap]):
                    crossed[first + j] = crossed[first + j - gap]
                    j -= gap
                crossed[first + j] = moved
            gap = wp.where(gap == 1, 0, wp.max(gap * 4 / 9, 1))

    @wp.func
    def is_known(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, kept: int, new: Crossed):
        if kept > 0:
            last = crossed[first + kept - 1]
            if last.t == new.t and last.instance == new.instance and last.primitive == new.primitive:
                return True
        if wp.static(has_mesh):
            if (new.touch & 7) != 0:
                for k in range(kept):
                    other = crossed[first + k]
                    if (other.touch & 7) != 0 and same_place(scene, new, other):
                        return True
        return False

    @wp.func
    def settle(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int, most: int) -> int:
        sort(scene, crossed, first, count)
        kept = int(0)
        for k in range(count):
            new = crossed[first + k]
            if kept < most and not is_known(scene, crossed, first, kept, new):
                crossed[first + kept] = new
                kept += 1
        return kept

    return settle
