"""This project and its peers behind one interface: build on a mesh, answer float32 rays."""

import importlib
import importlib.util
import sys
from functools import cache

import numpy as np
import warp as wp

import warprt as rt
from warprt.launch import launch

from .meshes import Triangles
from .rays import RaySet


class Engine:
    """Something that finds where rays meet a mesh. Building is what the constructor does."""

    name: str

    def prepare(self, rays: RaySet):
        """Rays as this engine wants them; not counted as time of the query."""
        raise NotImplementedError

    def run(self, rays: RaySet, prepared):
        """Answers the rays: t and ids, or with `any_hit` whether anything is met."""
        raise NotImplementedError

    def faces(self, rays: RaySet, result) -> np.ndarray:
        """(n,) ids of the faces hit, -1 for none; with `any_hit`, 0 where something is met."""
        raise NotImplementedError

    def parameters(self, result) -> np.ndarray:
        """(n,) t of the closest hits; of no meaning where there is none."""
        raise NotImplementedError


class Ours(Engine):
    """warprt, with Warp arrays in and out."""

    def __init__(self, mesh: Triangles, threads: int, accuracy: str = "robust", device: str = "cpu"):
        self.name = f"warprt {accuracy}"
        self.tracer = rt.Tracer(rt.Scene([rt.Mesh(*mesh)]), accuracy, device, threads=threads)

    def prepare(self, rays):
        device = self.tracer.device
        return [wp.array(x, dtype=wp.vec3, device=device) for x in (rays.origins, rays.directions)]

    def run(self, rays, prepared):
        if rays.any_hit:
            return self.tracer.occluded(*prepared, t_max=rays.t_max)
        return self.tracer.cast(*prepared, t_max=rays.t_max, outputs=("t", "primitive_id"))

    def faces(self, rays, result):
        return np.where(result.numpy(), 0, -1) if rays.any_hit else result.primitive_id.numpy()

    def parameters(self, result):
        return result.t.numpy()


class WarpMesh(Engine):
    """wp.Mesh, launched in the same bands on as many threads (of its own it uses one)."""

    def __init__(
        self, mesh: Triangles, threads: int, constructor: str = "sah", leaf_size: int = 4, device: str = "cpu"
    ):
        self.name, self.threads, self.device = f"wp.Mesh {constructor} {leaf_size}", threads, wp.get_device(device)
        vertices, faces = mesh
        self._arrays = (
            wp.array(vertices, dtype=wp.vec3, device=device),
            wp.array(faces.ravel(), dtype=wp.int32, device=device),
        )
        self._mesh = wp.Mesh(*self._arrays, bvh_constructor=constructor, bvh_leaf_size=leaf_size)

    def prepare(self, rays):
        return [wp.array(x, dtype=wp.vec3, device=self.device) for x in (rays.origins, rays.directions)]

    def run(self, rays, prepared):
        count = len(rays)
        inputs = [self._mesh.id, *prepared, min(rays.t_max, 1.0e30)]
        if rays.any_hit:
            result = [wp.empty(count, dtype=wp.bool, device=self.device)]
        else:
            result = [wp.empty(count, dtype=dtype, device=self.device) for dtype in (wp.float32, wp.int32)]
        launch(_query_any if rays.any_hit else _query, count, inputs + result, self.device, self.threads)
        return result

    def faces(self, rays, result):
        return np.where(result[0].numpy(), 0, -1) if rays.any_hit else result[1].numpy()

    def parameters(self, result):
        return result[0].numpy()


@wp.kernel(module="unique", enable_backward=False)
def _query(
    mesh: wp.uint64,
    o: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
    t_max: float,
    t: wp.array(dtype=float),
    face: wp.array(dtype=int),
    first: int,
):
    k = first + wp.tid()
    hit = wp.mesh_query_ray(mesh, o[k], d[k], t_max)
    t[k] = wp.where(hit.result, hit.t, wp.inf)
    face[k] = wp.where(hit.result, hit.face, -1)


@wp.kernel(module="unique", enable_backward=False)
def _query_any(
    mesh: wp.uint64,
    o: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
    t_max: float,
    is_met: wp.array(dtype=wp.bool),
    first: int,
):
    k = first + wp.tid()
    is_met[k] = wp.mesh_query_ray_anyhit(mesh, o[k], d[k], t_max)


class Open3D(Engine):
    """Open3D's RaycastingScene: Embree, built for robustness."""

    def __init__(self, mesh: Triangles, threads: int):
        import open3d as o3d

        self.name, self.threads, self._core = "Embree (Open3D)", threads, o3d.core
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        vertices, faces = mesh
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces.astype(np.uint32)))
        # The scene is committed by its first query.
        self._scene.cast_rays(o3d.core.Tensor(np.zeros((1, 6), np.float32)), nthreads=threads)

    def prepare(self, rays):
        return self._core.Tensor(np.concatenate([rays.origins, rays.directions], axis=1))

    def run(self, rays, prepared):
        if rays.any_hit:
            return self._scene.test_occlusions(prepared, 0.0, rays.t_max, self.threads)
        return self._scene.cast_rays(prepared, self.threads)

    def faces(self, rays, result):
        return np.where(result.numpy(), 0, -1) if rays.any_hit else result["primitive_ids"].numpy().astype(np.int32)

    def parameters(self, result):
        return result["t_hit"].numpy()


class Embreex(Engine):
    """embreex, the binding that trimesh uses; one thread."""

    def __init__(self, mesh: Triangles, threads: int):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.name = "Embree (embreex)"
        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, *mesh)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def prepare(self, rays):
        return rays.origins, rays.directions

    def run(self, rays, prepared):
        limits = np.full(len(rays), rays.t_max, np.float32) if np.isfinite(rays.t_max) else None
        if rays.any_hit:
            return self._scene.run(*prepared, limits, query="OCCLUDED")
        return self._scene.run(*prepared, limits, output=True)

    def faces(self, rays, result):
        # Whether occluded comes as 0 for a hit and -1 for none already.
        return np.asarray(result) if rays.any_hit else result["primID"]

    def parameters(self, result):
        return result["tfar"]


def peer_makers(threads: int) -> dict:
    """Constructors of the peers that are installed, by name; each takes (mesh, threads)."""
    makers = {"wp.Mesh": WarpMesh}
    if is_usable("open3d"):
        makers["Embree (Open3D)"] = Open3D
    if threads == 1 and is_usable("embreex"):
        makers["Embree (embreex)"] = Embreex
    return makers


@cache
def is_usable(name: str) -> bool:
    """Whether a peer is installed and can be imported; if only the former, a line says why."""
    if importlib.util.find_spec(name) is None:
        return False
    try:
        importlib.import_module(name)
    except ImportError as error:
        print(f"{name} is left out: {error}", file=sys.stderr)
        return False
    return True
