"""Ray queries of trimesh answered by warprt: a class that stands in for `trimesh.ray.ray_pyembree.RayMeshIntersector`.

- `mesh.ray = warprt.trimesh.RayMeshIntersector(mesh)`: for one mesh.
- `warprt.trimesh.install()`: for every mesh made from now on, until `uninstall()`.
- `with warprt.trimesh.install(accuracy="double"): ...`: for every mesh made within.
"""

import copy
import copyreg
import importlib
import sys
import warnings

import numpy as np
import trimesh
import warp as wp
from trimesh.ray.ray_util import contains_points

from warprt.kernels.making import lock
from warprt.kernels.points import find_points

from . import checks
from .all_hits import MOST_HITS
from .launch import launch
from .mesh import Mesh
from .scene import Scene
from .tracer import TIERS, Tracer, as_device, choice
from .typing import ArrayLike

Ids = np.ndarray


class RayMeshIntersector:
    """Rays against a trimesh.Trimesh; methods, their arguments and their results are those of trimesh's own class.

    accuracy, device, threads: as for `warprt.Tracer`. scale_to_box, and what else the methods of either of trimesh's
    classes may be given, is accepted, and not needed. The mesh is followed when it changes. Deep copies and pickles
    take their mesh along, and leave behind what lies on the device. Threads may share an intersector. Points are
    float64 in every accuracy.

    Results come hit by hit: all first hits by ray, then all second hits, and so on. A surface that a ray crosses at an
    edge or a vertex counts once. `max_hits` limits what `intersects_id` and `intersects_location` return to their
    callers, and warns once where it cuts; no limit applies to `contains_points`, nor where trimesh itself calls them
    (thickness, reach, voxels).
    """

    def __init__(
        self,
        geometry: trimesh.Trimesh | None = None,
        scale_to_box: bool = True,
        accuracy: str = "robust",
        device: str | wp.Device | None = None,
        threads: int | None = None,
        *,
        mesh: trimesh.Trimesh | None = None,
    ):
        geometry = mesh if geometry is None else geometry
        if not isinstance(geometry, trimesh.Trimesh):
            raise ValueError(f"RayMeshIntersector needs a trimesh.Trimesh; got {type(geometry).__name__}")
        self.mesh = geometry
        self._options = _checked(accuracy, device, threads)
        self._made: tuple[int, Tracer | None] | None = None
        """The hash of the mesh, and the tracer made for it."""
        self._has_warned = False

    def __repr__(self) -> str:
        return f"RayMeshIntersector({len(self.mesh.faces)} faces, {self._options['accuracy']})"

    def __getstate__(self):
        return {**self.__dict__, "_made": None}

    def __setstate__(self, state):
        # One of trimesh's own, pickled elsewhere, has no options.
        kept = {"_options": _checked("robust", None, None), "_has_warned": False} | state
        self.__dict__.update(kept, _made=None)

    def __copy__(self):
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, _made=None)
        return other

    def __deepcopy__(self, memo):
        other = object.__new__(type(self))
        memo[id(self)] = other
        other.__dict__.update(copy.deepcopy(self.__getstate__(), memo))
        return other

    @property
    def _tracer(self) -> Tracer | None:
        """None for a mesh without faces, which no ray meets."""
        key, made = hash(self.mesh), self._made
        if made is None or made[0] != key:
            with lock:
                made = self._made
                if made is None or made[0] != key:
                    self._made = made = key, self._new_tracer()
        return made[1]

    def _new_tracer(self) -> Tracer | None:
        if len(self.mesh.faces) == 0:
            return None
        return Tracer(Scene([Mesh(self.mesh.vertices, self.mesh.faces)]), **self._options)

    def intersects_id(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
        **others,
    ) -> tuple[Ids, Ids] | tuple[Ids, Ids, np.ndarray]:
        """(index_tri, index_ray), (m,) int64 each, and, if they are asked for, points (m, 3) float64.

        ray_origins, ray_directions: (n, 3) each. multiple_hits: all hits, at most max_hits of a ray; else the first.
        Warns once if max_hits, above 1, cuts hits off, and says how many. Raises ValueError for other shapes.
        """
        most = _most_hits(multiple_hits, max_hits)
        index_tri, index_ray, *points = self._intersections(ray_origins, ray_directions, most, return_locations)
        return index_tri, index_ray, *points

    def intersects_location(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = 100,
        **others,
    ) -> tuple[np.ndarray, Ids, Ids]:
        """(points (m, 3) float64, index_ray (m,), index_tri (m,)); arguments as for `intersects_id`."""
        most = _most_hits(multiple_hits, max_hits)
        index_tri, index_ray, points = self._intersections(ray_origins, ray_directions, most, True)
        return points, index_ray, index_tri

    def intersects_first(self, ray_origins: ArrayLike, ray_directions: ArrayLike, **others) -> Ids:
        """(n,) int32: the face that each ray hits first, -1 where it misses."""
        origins, directions = _rays(ray_origins, ray_directions)
        if self._tracer is None:
            return np.full(len(origins), -1, dtype=np.int32)
        return self._tracer.cast(origins, directions, outputs="primitive_id").primitive_id

    def intersects_any(self, ray_origins: ArrayLike, ray_directions: ArrayLike, **others) -> np.ndarray:
        """(n,) bool: whether each ray hits anything."""
        origins, directions = _rays(ray_origins, ray_directions)
        if self._tracer is None:
            return np.zeros(len(origins), dtype=bool)
        return self._tracer.occluded(origins, directions)

    def contains_points(self, points: ArrayLike) -> np.ndarray:
        """(n,) bool: whether points (n, 3) lie within the mesh, by the parity of all hits; undefined on the surface."""
        points = checks.wide(checks.real_numbers(points, "points"))
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points must have shape (n, 3); got {points.shape}")
        if self._tracer is None:
            return np.zeros(len(points), dtype=bool)
        return contains_points(_Crossings(self.mesh, self._tracer), points)

    def _intersections(self, origins: ArrayLike, directions: ArrayLike, most: int, with_points: bool) -> tuple:
        """(face, ray), and points if they are wanted, of at most so many hits of each ray."""
        origins, directions = _rays(origins, directions)
        ray, face, t = self._hits(origins, directions, most)
        if 1 < most < MOST_HITS and not self._has_warned:
            self._warn_of_cuts(origins, directions, ray, most)
        if not with_points:
            return face, ray
        return face, ray, self._points(origins, directions, ray, face, t)

    def _warn_of_cuts(self, origins: np.ndarray, directions: np.ndarray, ray: Ids, most: int) -> None:
        """Counts what rays that reach the limit have beyond it."""
        full = np.flatnonzero(np.bincount(ray, minlength=1) == most)
        cut = self._tracer.count(origins[full], directions[full]).astype(np.int64) - most if len(full) else full
        if cut.any():
            self._has_warned = True
            warnings.warn(
                f"max_hits={most} cuts off {cut.sum():,} hits, on {np.count_nonzero(cut):,} of {len(origins):,} rays; "
                "name a larger max_hits if all hits count",
                stacklevel=4,
            )

    def _hits(self, origins: np.ndarray, directions: np.ndarray, most: int) -> tuple[Ids, Ids, np.ndarray]:
        """(ray, face, t) of all hits, first hits first."""
        if self._tracer is None:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
        if most == 1:
            hits = self._tracer.cast(origins, directions, outputs=("hit", "t", "primitive_id"))
            ray = np.flatnonzero(hits.hit)
            return ray, hits.primitive_id[ray].astype(np.int64), hits.t[ray]
        hits = self._tracer.cast_all(origins, directions, outputs=("t", "primitive_id"), max_hits=most)
        ray, row = _hit_by_hit(hits.offsets)
        return ray, hits.primitive_id[row].astype(np.int64), hits.t[row]

    def _points(self, origins: np.ndarray, directions: np.ndarray, ray: Ids, face: Ids, t: np.ndarray) -> np.ndarray:
        """(m, 3) where rays meet the planes of faces, in float64 whatever the accuracy."""
        if len(ray) == 0:
            return np.zeros((0, 3))
        device = self._tracer.device

        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device, copy=False)

        vertices, faces = np.asarray(self.mesh.vertices, np.float64), np.asarray(self.mesh.faces, np.int32)
        points = wp.empty(len(ray), dtype=wp.vec3d, device=device)
        inputs = [array(origins, wp.vec3d), array(directions, wp.vec3d), array(vertices, wp.vec3d)]
        inputs += [array(faces, wp.vec3i), array(ray, wp.int64), array(face, wp.int64)]
        inputs += [array(t.astype(np.float64), wp.float64), points]
        launch(find_points, len(ray), inputs, device, self._tracer.threads)
        return points.numpy()


class _Crossings:
    """What `trimesh.ray.ray_util.contains_points` asks of an intersector: which rays are hit, as often as they are."""

    def __init__(self, mesh: trimesh.Trimesh, tracer: Tracer):
        self.mesh = mesh
        self._tracer = tracer

    def intersects_location(self, origins: np.ndarray, directions: np.ndarray, **others) -> tuple[None, Ids, None]:
        """(None, index_ray (m,), None): neither points nor faces are looked at."""
        counts = self._tracer.count(origins, directions)
        return None, np.repeat(np.arange(len(counts)), counts), None


def _most_hits(multiple_hits: bool, max_hits: int) -> int:
    """How many hits of a ray are wanted by the caller of the method that asks.

    trimesh's own functions name no limit, and derive from all hits what they return.
    """
    if not multiple_hits:
        return 1
    asked = sys._getframe(1)
    caller, asked_of = asked.f_back, asked.f_locals.get("self")
    while caller is not None and caller.f_locals.get("self") is asked_of:  # methods of a subclass
        caller = caller.f_back
    if caller is not None and caller.f_globals.get("__name__", "").partition(".")[0] == "trimesh":
        return MOST_HITS
    is_large = isinstance(max_hits, (int, np.integer)) and max_hits > MOST_HITS
    return MOST_HITS if is_large else checks.integer(max_hits, "max_hits")


def _hit_by_hit(offsets: np.ndarray) -> tuple[Ids, np.ndarray]:
    """(rays, rows of their hits) in CSR form, as first hits of all rays, then second hits, and so on."""
    start, count = offsets[:-1], np.diff(offsets)
    ray = np.flatnonzero(count)
    rays, rows, number = [], [], 0
    while len(ray):
        rays.append(ray)
        rows.append(start[ray] + number)
        number += 1
        ray = ray[count[ray] > number]
    if not rays:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(rays), np.concatenate(rows)


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) float64 each."""
    origins = checks.wide(checks.real_numbers(origins, "ray origins"))
    directions = checks.wide(checks.real_numbers(directions, "ray directions"))
    if origins.shape != directions.shape:
        raise ValueError(f"ray origins and directions don't match: {origins.shape} and {directions.shape}")
    if origins.ndim != 2 or origins.shape[1] != 3:
        if origins.size == 0:
            return np.zeros((0, 3)), np.zeros((0, 3))
        raise ValueError(f"ray origins and directions must have shape (n, 3); got {origins.shape}")
    return origins, directions


class _StandIn(type):
    """The type of what stands in the place of trimesh's classes: called, it makes a `RayMeshIntersector`."""

    options: dict

    def __call__(cls, *args, **kwargs) -> RayMeshIntersector:
        return RayMeshIntersector(*args, **(cls.options | kwargs))

    def __instancecheck__(cls, instance) -> bool:
        return isinstance(instance, RayMeshIntersector)


def _stand_in(options: dict) -> type:
    # Pickles of trimesh's own intersectors ask for `__new__` of what now has their name.
    members = {"options": options, "__new__": lambda cls: object.__new__(RayMeshIntersector)}
    return _StandIn("RayMeshIntersector", (RayMeshIntersector,), members)


class Installation:
    """What `install` has put in place; as a context manager it is undone at the end."""

    def __init__(self, options: dict):
        self.stand_in = _stand_in(options)

    def __enter__(self) -> "Installation":
        return self

    def __exit__(self, *exception) -> None:
        if self in _installed:
            _installed.remove(self)
            _put_in_place()


_installed: list[Installation] = []
"""Those that have not been undone; the last one is in force."""
_own: dict[str, type] = {}
"""trimesh's own classes, by their modules, while others stand in for them."""


def _put_in_place() -> None:
    """The last installation, or, if there is none, what is trimesh's own."""
    modules = [trimesh.ray.ray_triangle] + ([trimesh.ray.ray_pyembree] if trimesh.ray.has_embree else [])
    for module in modules:
        if _installed:
            own = _own.setdefault(module.__name__, module.RayMeshIntersector)
            copyreg.pickle(own, _reduced)
            module.RayMeshIntersector = _installed[-1].stand_in
        elif module.__name__ in _own:
            module.RayMeshIntersector = _own.pop(module.__name__)
            copyreg.dispatch_table.pop(module.RayMeshIntersector, None)


def _reduced(intersector) -> tuple:
    """How to pickle one of trimesh's own while its class cannot be found by name."""
    return _own_blank, (type(intersector).__module__,), intersector.__reduce_ex__(2)[2]


def _own_blank(module: str):
    own = _own.get(module) or importlib.import_module(module).RayMeshIntersector
    return own.__new__(own)


def install(
    accuracy: str = "robust", device: str | wp.Device | None = None, threads: int | None = None
) -> Installation:
    """Makes every trimesh.Trimesh that is made from now on answer ray queries by `RayMeshIntersector`.

    Meshes that exist keep what they have. Both of trimesh's engines are replaced, so it does not matter whether embreex
    is installed or a mesh was told to use it. Raises ValueError for an unknown accuracy or device.
    """
    _installed.append(Installation(_checked(accuracy, device, threads)))
    _put_in_place()
    return _installed[-1]


def uninstall() -> None:
    """Undoes the last `install`; without one it does nothing."""
    if _installed:
        _installed[-1].__exit__()


def _checked(accuracy: str, device: str | wp.Device | None, threads: int | None) -> dict:
    """The options of a tracer."""
    return {
        "accuracy": choice(accuracy, TIERS, "accuracy"),
        "device": None if device is None else as_device(device).alias,
        "threads": None if threads is None else checks.integer(threads, "threads"),
    }
