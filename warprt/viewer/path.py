"""The path of one pixel: its ray, and on from mirrors, with the cells that each part of it pierces."""

from dataclasses import dataclass

import numpy as np

from ..cameras import AnyCamera
from ..materials import Material
from ..mesh import Mesh
from ..scene import Instance, Scene
from ..tracer import Tracer
from ..walk import CellWalk

MOST_SEGMENTS = 16


@dataclass(frozen=True, eq=False)
class Segment:
    """A ray o + t d from the eye or a mirror, what it hits, and the cells of mesh grids up to there."""

    origin: np.ndarray  # (3,) float64
    direction: np.ndarray  # (3,) float64, unit for the first
    walk: CellWalk
    is_hit: bool
    t: float
    t_error: float
    position: np.ndarray  # (3,)
    normal: np.ndarray  # (3,) unit, of the surface
    instance_id: int
    primitive_id: int

    @property
    def cells_visited(self) -> int:
        """Cells looked at, without those jumped over."""
        return int(self.walk.visited.sum())

    @property
    def triangles_tested(self) -> int:
        """In those cells, eight for each block whose box the ray meets."""
        return int(self.walk.candidates.sum())


def pixel_ray(camera: AnyCamera, size: tuple[int, int], pixel: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(origin, direction), (3,) float64 each, through the centre of the pixel in that column and row.

    Raises ValueError for a pixel outside the picture of (width, height).
    """
    (column, row), (width, height) = pixel, size
    if not (0 <= column < width and 0 <= row < height):
        raise ValueError(f"pixel must lie within {width} x {height}; got column {column}, row {row}")
    origins, directions = camera.rays(width, height, rows=(row, 1))
    return origins[0, column], directions[0, column]


def trace_path(
    tracer: Tracer, camera: AnyCamera, size: tuple[int, int], pixel: tuple[int, int], max_bounces: int = 8
) -> list[Segment]:
    """The segments of a pixel's path, at least one: it ends where nothing is hit, or what is hit is no mirror."""
    origin, direction = pixel_ray(camera, size, pixel)
    segments: list[Segment] = []
    while True:
        hits = tracer.cast(origin, direction)
        segments.append(_segment(tracer, origin, direction, hits))
        if not hits.hit or len(segments) > min(max_bounces, MOST_SEGMENTS - 1):
            return segments
        if not any(material_of(tracer.scene, segments[-1].instance_id).mirror):
            return segments
        onwards = _reflected(tracer.scene, segments[-1], np.asarray(hits.uv, np.float64))
        origin, direction = (np.asarray(part, np.float64) for part in hits.spawn(onwards))


def _segment(tracer: Tracer, origin: np.ndarray, direction: np.ndarray, hits) -> Segment:
    return Segment(
        origin,
        direction,
        tracer.walk(origin, direction),
        bool(hits.hit),
        float(hits.t),
        float(hits.t_error),
        np.asarray(hits.position, np.float64),
        np.asarray(hits.normal, np.float64),
        int(hits.instance_id),
        int(hits.primitive_id),
    )


def placement_of(scene: Scene, instance_id: int):
    """(the Instance or Instances with that placement, which of its placements)."""
    left = instance_id
    for item in scene.objects:
        count = 1 if isinstance(item, Instance) else len(item)
        if left < count:
            return item, left
        left -= count
    raise ValueError(f"the scene has no instance {instance_id}")


def material_of(scene: Scene, instance_id: int) -> Material:
    """The material of a placement."""
    item, k = placement_of(scene, instance_id)
    if isinstance(item, Instance):
        return item.material or Material()
    return item.materials[item.material_index[k]]


def _reflected(scene: Scene, segment: Segment, uv: np.ndarray) -> np.ndarray:
    """Where a mirror sends the ray, as pictures have it: about the normal by which the surface is shaded."""
    d, face = segment.direction, segment.normal
    face = -face if face @ d > 0 else face
    n = _shading_normal(scene, segment, uv, face)
    onwards = d - 2 * (d @ n) * n
    return onwards + max(-2 * (onwards @ face), 0.0) * face


def _shading_normal(scene: Scene, segment: Segment, uv: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Unit, on the side of the face's normal."""
    item, k = placement_of(scene, segment.instance_id)
    shape = item.shape
    if not isinstance(shape, Mesh) or shape.normals is None:
        return face
    lengths = np.linalg.norm(shape.normals, axis=1)[shape.faces[segment.primitive_id]]
    corners = shape.normals[shape.faces[segment.primitive_id]] / np.where(lengths > 0, lengths, 1.0)[:, None]
    local = np.array([1 - uv.sum(), *uv]) @ corners
    matrix = item.transform.world_from_local if isinstance(item, Instance) else item.world_from_local[k]
    n = np.linalg.inv(matrix[:3, :3]).T @ local
    length = np.linalg.norm(n)
    if not length > 0:
        return face
    n /= length
    return -n if n @ face < 0 else n
