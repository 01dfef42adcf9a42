"""Triangle meshes: what the user gives, and its copy on a device."""

from pathlib import Path

import numpy as np
import warp as wp

from warprt.kernels.blocks import BLOCK_SIZE
from warprt.kernels.making import lock
from warprt.kernels.spec import ShapeKind, Tier
from warprt.kernels.structs import mesh_struct

from . import checks
from .foreign import adopted, hosted, is_on_gpu, vectors
from .grid import (
    Faces,
    Trees,
    auto_resolution,
    build_block_trees,
    build_blocks,
    first_not_finite,
    sort_faces,
    vertex_bounds,
)
from .memory import convert
from .read_only import ReadOnly
from .shapes import Canonical, power_of_two_above
from .typing import ArrayLike
from .visuals import coated

PAD_ROUNDINGS = 64
"""Widening of a mesh's grid cells, in units of roundoff of the largest canonical coordinate, 1.

A hit found by the triangle test lies on the triangle and within 25 roundings of the ray. Of terms up to 2, a wall's
parameter carries at most 12 roundings, a point to which a ray jumps over empty space 19, and a parameter at a box (two
sums, three products) 19. So each cell whose span of t holds a hit lists the triangle, its box there is met before the
hit, and a ray may stop as soon as its best hit lies before the exit of a cell.
"""


class Mesh(ReadOnly):
    """Triangles that share vertices, with a uniform grid over them.

    vertices: (V, 3) finite numbers, in scene units. faces: (F, 3) integers, indices into the vertices. normals: (V, 3)
    finite vectors of any length, by which pictures are shaded as if the mesh were smooth; hits keep the normals of
    faces. uvs: (V, 2) finite texture coordinates, see `Texture`. colors: (V, 3) linear RGB, not negative, which
    multiplies what the material says. All three are interpolated over a face by barycentric weights. grid: "auto",
    cells (nx, ny, nz), or None for no grid.

    Faces without area are never hit; vertices without a face are ignored. Threads may share a mesh.

    Raises ValueError for an empty mesh, indices out of range, non-finite values and wrong shapes.
    """

    kind = ShapeKind.MESH

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        normals: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        grid: str | tuple[int, int, int] | None = "auto",
        colors: ArrayLike | None = None,
    ):
        self._vertices = _rows(vertices, 3, "Mesh vertices")
        self.faces = _face_indices(faces, len(self.vertices))
        self.normals = None if normals is None else _rows(normals, 3, "Mesh normals", len(self.vertices))
        self.uvs = None if uvs is None else _rows(uvs, 2, "Mesh uvs", len(self.vertices))
        self.colors = None if colors is None else _colors(colors, len(self.vertices))
        self.grid = _grid_choice(grid)
        self.version = 0
        """How often `update` has been called."""
        self._count = len(self._vertices)
        self._bounds: tuple[np.ndarray, np.ndarray] | None = None
        self._device_vertices: wp.array | None = None
        self._device_copies: dict = {}
        self._device_attributes: dict = {}

    def __repr__(self) -> str:
        return f"Mesh({len(self)} vertices, {len(self.faces)} faces, grid={self.grid!r})"

    def __getstate__(self):
        made_anew = {"_bounds": None, "_device_vertices": None, "_device_copies": {}, "_device_attributes": {}}
        with lock:
            return {**self.__dict__, "_vertices": self.vertices, **made_anew}

    @property
    def vertices(self) -> np.ndarray:
        """(V, 3) float64, read-only."""
        vertices = self._vertices
        return self._fetched_vertices() if vertices is None else vertices

    def _fetched_vertices(self) -> np.ndarray:
        """Those of an update from a device, brought to the host."""
        with lock:
            if self._vertices is None:
                self._vertices = self._device_vertices.numpy()
                self._vertices.setflags(write=False)
            return self._vertices

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners of the vertices that faces use, (3,) float64, read-only."""
        bounds = self._bounds
        if bounds is not None:
            return bounds
        with lock:
            if self._bounds is None:
                self._bounds = self._found_bounds()
            return self._bounds

    def _found_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        if self._vertices is None:
            lower, upper = vertex_bounds(self._device_vertices, self._device_faces(self._device_vertices.device))
        else:
            is_used = np.zeros(len(self._vertices), dtype=bool)
            is_used[self.faces] = True
            columns = np.ascontiguousarray(self._vertices[is_used].T)
            lower, upper = columns.min(axis=1), columns.max(axis=1)
        for corner in (lower, upper):
            corner.setflags(write=False)
        return lower, upper

    def canonical(self) -> Canonical:
        """Centred; largest half extent in [1/2, 1)."""
        lower, upper = self.bounds
        center = lower / 2 + upper / 2
        scale = power_of_two_above((upper / 2 - lower / 2).max())
        return Canonical(center, scale, (lower - center) / scale, (upper - center) / scale)

    def fit_unit_cube(self) -> "Mesh":
        """A copy scaled evenly to a longest side of 1, with its minimum corner at the origin."""
        lower, upper = self.bounds
        # In halves, which cannot overflow.
        side = (upper / 2 - lower / 2).max()
        vertices = (self.vertices / 2 - lower / 2) / (side if side > 0 else 0.5)
        return Mesh(vertices, self.faces, self.normals, self.uvs, self.grid, self.colors)

    def smooth(self) -> "Mesh":
        """A copy with normals at its vertices, by which it is shaded as one smooth surface.

        The normal of a vertex is the mean of those of the faces around it, each by its angle there (Thuermer &
        Wuethrich 1998), so that it does not depend on how the surface is cut into triangles. Vertices at one place
        share theirs.
        """
        return Mesh(self.vertices, self.faces, _vertex_normals(self), self.uvs, self.grid, self.colors)

    def with_grid(self, grid: str | tuple[int, int, int] | None) -> "Mesh":
        """A copy, which shares vertices and faces, with another grid. Raises ValueError for a grid that is none."""
        copy = object.__new__(Mesh)
        copy.__dict__.update(self.__dict__, grid=_grid_choice(grid), _device_copies={})
        return copy

    def update(self, vertices: ArrayLike | wp.array) -> None:
        """Gives the mesh new vertices, as many as before; tracers that use it notice at their next call.

        vertices: (V, 3) finite numbers, or a Warp array of V vec3 or vec3d, or what lies on a GPU and has `__dlpack__`
        (PyTorch, CuPy, JAX). From a tracer's device, blocks and grid are made anew without a way over the host. Faces,
        uvs and colors stay; normals, those of the old shape, go.

        Raises ValueError, and changes nothing, for another number of vertices, or where one is not finite, whether a
        face uses it or not.
        """
        if isinstance(vertices, wp.array) or is_on_gpu(vertices):
            on_device, host = _device_rows(vectors(adopted(vertices, "Mesh.update vertices")), len(self)), None
        else:
            on_device, host = None, _rows(vertices, 3, "Mesh.update vertices", len(self))
        with lock:
            self._vertices, self._device_vertices, self.normals, self._bounds = host, on_device, None, None
            self._device_copies = {}
            kept = {key: value for key, value in self._device_attributes.items() if key[0] != "normal"}
            self._device_attributes = kept
            self.version += 1

    def __len__(self) -> int:
        return self._count

    def device_faces(self, device: wp.Device) -> Faces:
        """Vertices and faces on a device, with the canonical space to which they will be taken."""
        vertices, canonical = self._device_vertices, self.canonical()
        if vertices is None or vertices.device != device:
            vertices = wp.array(self.vertices, dtype=wp.vec3d, device=device, copy=False)
        return Faces(vertices, self._device_faces(device), canonical.center, canonical.scale)

    def _device_faces(self, device: wp.Device) -> wp.array:
        return wp.array(self.faces.ravel(), dtype=wp.int32, device=device, copy=False)

    def device_attribute(self, name: str, device: wp.Device, real: type = wp.float32) -> wp.array:
        """On a device, made once: "face" int32 [3 F]; "uv" vec2 or "normal" vec3, unit, of that real; "color" vec3f."""
        key = (name, device.alias, real)
        if key not in self._device_attributes:
            self._device_attributes[key] = self._make_attribute(name, device, real)
        return self._device_attributes[key]

    def _make_attribute(self, name: str, device: wp.Device, real: type) -> wp.array:
        if name == "face":
            return self._device_faces(device)
        if name == "normal":
            return wp.array(_unit_rows(self.normals), dtype=wp.types.vector(3, real), device=device)
        # Beyond 2^53, to which they are cut off so that nothing overflows, all floats are whole and even.
        largest = 2.0**100
        values = np.clip(self.uvs if name == "uv" else self.colors, -largest, largest)
        return wp.array(values, dtype=wp.types.vector(values.shape[1], real), device=device)

    @classmethod
    def from_file(
        cls, path: str | Path, grid: str | tuple[int, int, int] | None = "auto", trust: bool = False
    ) -> "Mesh":
        """Reads a mesh file (.obj .ply .stl .off); several parts become one mesh.

        With it come texture coordinates, if all parts have them, and colours. `load_scene` also takes the materials.
        Faces are in the order of the file, those of each material together; a polygon of n corners, convex or not,
        becomes n - 2 triangles, which stand together. trust: also reads what else trimesh reads, and lifts the limits
        of memory and time for each byte of the file, see `load_scene`.

        Raises FileNotFoundError when there is no such file, ValueError for one that is broken, or has no triangles.
        """
        from .file_rules import FileRules
        from .mesh_files import read_mesh

        rules = FileRules(path, trust)
        return read_mesh(rules.path, rules, grid)

    @classmethod
    def from_trimesh(cls, mesh, grid: str | tuple[int, int, int] | None = "auto") -> "Mesh":
        """The triangles of a trimesh.Trimesh, with its texture coordinates, or its colours of vertices or faces.

        Vertices at which faces of different colours meet become one for each. Raises ValueError for anything else.
        """
        if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
            raise ValueError(f"Mesh.from_trimesh needs a trimesh.Trimesh; got {type(mesh).__name__}")
        vertices, faces, uvs, colors = coated(mesh)
        return cls(vertices, faces, uvs=uvs, grid=grid, colors=colors)

    def device_copy(self, tier: Tier, device: wp.Device, has_grid: bool) -> "DeviceMesh":
        """The mesh on a device, made once for each tier."""
        key = (tier, device.alias, has_grid)
        if key not in self._device_copies:
            self._device_copies[key] = DeviceMesh(self, tier, device, has_grid)
        return self._device_copies[key]


class DeviceMesh:
    """Canonical triangles and their grid in device memory."""

    def __init__(self, mesh: Mesh, tier: Tier, device: wp.Device, has_grid: bool):
        self._tier, real = tier, tier.real
        canonical = mesh.canonical()
        faces = mesh.device_faces(device)
        place, sorted_face = sort_faces(faces)
        self._corner, *fine = build_blocks(faces, sorted_face, [real, tier.result] if tier.has_fine else [real])
        self._fine = fine[0] if fine else None
        self.trees: Trees | None = None
        if has_grid:
            pad = PAD_ROUNDINGS * float(np.finfo(wp.dtype_to_numpy(real)).eps) / 2
            lower, upper = canonical.lower - 2 * pad, canonical.upper + 2 * pad
            count = mesh.grid or (1, 1, 1)
            if count == "auto":
                count = auto_resolution(faces, place, upper - lower)
            self.trees = build_block_trees(self._corner, lower, upper, count, pad, real)

    def struct(self):
        """The mesh as kernels take it."""
        mesh = mesh_struct(self._tier, self.trees is not None)()
        mesh.block_count, mesh.corner = self._corner.size // BLOCK_SIZE, self._corner
        if self._fine is not None:
            mesh.fine = self._fine
        if self.trees is not None:
            mesh.trees = self.trees.struct
        return mesh

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        corners = sum(array.capacity for array in (self._corner, self._fine) if array is not None)
        return corners + (self.trees.bytes if self.trees else 0)


def joined(parts: list[Mesh]) -> Mesh:
    """Meshes as one: with uvs if each has them, white where a part has no colours and another has."""
    if len(parts) == 1:
        return parts[0]
    first = np.cumsum([0, *(len(part) for part in parts)])
    uvs = [part.uvs for part in parts if part.uvs is not None]
    colors = [np.ones((len(part), 3)) if part.colors is None else part.colors for part in parts]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + k for part, k in zip(parts, first, strict=False)]),
        uvs=np.concatenate(uvs) if len(uvs) == len(parts) else None,
        grid=parts[0].grid,
        colors=np.concatenate(colors) if any(part.colors is not None for part in parts) else None,
    )


def _unit_rows(vectors: np.ndarray) -> np.ndarray:
    """(N, 3) of length 1; those of length 0 stay."""
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    scaled = np.divide(vectors, largest, out=np.zeros(vectors.shape), where=largest > 0)
    length = np.sqrt((scaled**2).sum(axis=1, keepdims=True))
    return np.divide(scaled, length, out=scaled, where=length > 0)


def _vertex_normals(mesh: Mesh) -> np.ndarray:
    """(V, 3) unit, weighted by angles; 0 where no face with an area is."""
    lower, upper = mesh.bounds
    side = (upper / 2 - lower / 2).max()
    # About 1, so that no product overflows; vertices that no face uses may.
    with np.errstate(over="ignore", invalid="ignore"):
        points = (mesh.vertices / 2 - lower / 2) / (side if side > 0 else 1.0)
    _places, place = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)  # -0.0 is 0
    place = place.reshape(-1)
    corners = points[mesh.faces]
    edges = _unit_rows((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)).reshape(-1, 3, 3)
    normals = _unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    cosines = -(edges * np.roll(edges, 1, axis=1)).sum(axis=2)
    angles = np.arccos(np.clip(cosines, -1, 1))
    total = np.zeros((len(points), 3))
    for k in range(3):
        np.add.at(total, place[mesh.faces[:, k]], angles[:, k, None] * normals)
    return _unit_rows(total)[place]


def _rows(value: ArrayLike, width: int, name: str, count: int | None = None) -> np.ndarray:
    """A read-only (N, width) float64 copy without NaN or infinity, N >= 1."""
    array = checks.real_array(value, name)
    if array.ndim != 2 or array.shape[1] != width or array.shape[0] == 0:
        raise ValueError(f"{name} must have shape (N, {width}) with N >= 1; got {array.shape}")
    if count is not None and len(array) != count:
        raise ValueError(f"{name} must have one row per vertex, {count}; got {len(array)}")
    is_bad = ~np.isfinite(array).all(axis=1)
    if is_bad.any():
        i = int(np.argmax(is_bad))
        raise ValueError(f"{name}[{i}] is not finite; got {array[i].tolist()}")
    array.setflags(write=False)
    return array


def _colors(value: ArrayLike, count: int) -> np.ndarray:
    """A read-only (V, 3) float64 copy of colours."""
    array = _rows(value, 3, "Mesh colors", count)
    is_negative = (array < 0).any(axis=1)
    if is_negative.any():
        i = int(np.argmax(is_negative))
        raise ValueError(f"Mesh colors[{i}] must not be negative; got {array[i].tolist()}")
    return array


def _device_rows(vertices: wp.array, count: int) -> wp.array:
    """A copy in vec3d of as many vertices as a mesh has."""
    if vertices.dtype not in (wp.vec3f, wp.vec3d) or vertices.shape != (count,):
        raise ValueError(
            f"Mesh.update vertices must be a Warp array of {count} vec3 or vec3d; got {vertices.dtype.__name__} "
            f"{vertices.shape}"
        )
    wide = wp.empty(count, dtype=wp.vec3d, device=vertices.device)
    convert(vertices, wide)
    i = first_not_finite(wide)
    if i >= 0:
        raise ValueError(f"Mesh.update vertices[{i}] is not finite; got {wide[i : i + 1].numpy()[0].tolist()}")
    return wide


def _face_indices(faces: ArrayLike, vertex_count: int) -> np.ndarray:
    """A read-only (F, 3) int32 copy, F >= 1, within range."""
    faces = hosted(faces, "Mesh faces")
    try:
        array = np.array(faces)
    except ValueError:
        raise ValueError("Mesh faces must have shape (F, 3); the rows given differ in length") from None
    if array.ndim != 2 or array.shape[1] != 3 or array.shape[0] == 0:
        raise ValueError(f"Mesh faces must have shape (F, 3) with F >= 1; got {array.shape}")
    if not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"Mesh faces must be integers; got {array.dtype}")
    if array.min() < 0 or array.max() >= vertex_count:
        i = int(np.argmax(((array < 0) | (array >= vertex_count)).any(axis=1)))
        raise ValueError(f"Mesh faces[{i}] = {array[i].tolist()} is out of range: there are {vertex_count} vertices")
    array = array.astype(np.int32)
    array.setflags(write=False)
    return array


def _grid_choice(grid):
    """The grid argument, checked."""
    if grid is None or (isinstance(grid, str) and grid == "auto"):
        return grid
    if not isinstance(grid, (tuple, list, np.ndarray)) or len(grid) != 3:
        raise ValueError(f"Mesh grid must be 'auto', None or three cell counts; got {grid!r}")
    return tuple(checks.integer(n, "Mesh grid cells per axis") for n in grid)
