"""All hits of one ray put in order, each crossing of a surface once."""

import warp as wp

from .blocks import make_corner, slot_row
from .making import once
from .spec import Spec
from .structs import crossed_struct, hit_struct, scene_struct
from .trace import make_primitive_id


@once
def make_same_place(spec: Spec):
    """Whether two hits of a mesh lie at the same edge or vertex, which their faces share."""
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
        mesh = scene.mesh[scene.shape[scene.instances.shape[one.instance]].mesh]
        if wp.static(has_fine):
            p, q = place(mesh.fine, one.primitive, one.touch)
            r, s = place(mesh.fine, other.primitive, other.touch)
        else:
            p, q = place(mesh.corner, one.primitive, one.touch)
            r, s = place(mesh.corner, other.primitive, other.touch)
        return (p == r and q == s) or (p == s and q == r)

    return same_place


@once
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
    def stands_for(scene: Scene, other: Crossed, hit: Crossed, is_earlier: bool):
        """Whether another hit counts in place of one that only touches its face."""
        if other.instance != hit.instance or (other.touch & 7) == 0:
            return False
        is_one = (other.touch & 16) != 0 or (is_earlier and (other.touch & 8) == (hit.touch & 8))
        return is_one and same_place(scene, hit, other)

    @wp.func
    def is_stood_for(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int, k: int):
        """Looks both ways from the hit: what shares its place has almost its t."""
        hit = crossed[first + k]
        reach = int(1)
        while reach < count:
            if k - reach >= 0:
                if stands_for(scene, crossed[first + k - reach], hit, True):
                    return True
            if k + reach < count:
                if stands_for(scene, crossed[first + k + reach], hit, False):
                    return True
            reach += 1
        return False

    @wp.func
    def counts(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int, k: int):
        hit = crossed[first + k]
        if k > 0:
            last = crossed[first + k - 1]
            if last.t == hit.t and last.instance == hit.instance and last.primitive == hit.primitive:
                return False
        if wp.static(has_mesh):
            if (hit.touch & 7) != 0 and (hit.touch & 16) == 0:
                return not is_stood_for(scene, crossed, first, count, k)
        return True

    @wp.func
    def settle(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int, most: int) -> int:
        sort(scene, crossed, first, count)
        for k in range(count):
            # Marked first, and moved up after all have been looked at.
            if not counts(scene, crossed, first, count, k):
                dropped = crossed[first + k]
                dropped.touch = dropped.touch | 32
                crossed[first + k] = dropped
        kept = int(0)
        for k in range(count):
            hit = crossed[first + k]
            if kept < most and (hit.touch & 32) == 0:
                crossed[first + kept] = hit
                kept += 1
        return kept

    return settle
