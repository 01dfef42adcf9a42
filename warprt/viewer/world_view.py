"""The 3-D window that sees the camera from outside, its ray, and the cells that it visits."""

import numpy as np

from ..camera import Camera
from .batches import Batch
from .cell_lines import (
    AMBER,
    COLORS,
    RAY_COLORS,
    CellBox,
    color_of,
    edge_lines,
    most_telling,
    normal_lines,
    ray_lines,
    solid,
)
from .path import Segment
from .space import Space
from .stage import Stage

FRUSTUM_SIZE, MOST_PIXELS = 0.18, 400
"""Of the first camera: in the browser's units, and of its picture along a side."""
ZOOM_MARGIN = 2.0
SEE_THROUGH = 0.22
"""How opaque the scene is while cells within it are shown."""
NORMAL_LENGTH = 0.06
"""In the browser's units, in which the picked point is about 1 away from the eye."""


class WorldView(Stage):
    """A second camera, which sees the first one, the ray, and the cells that it visits."""

    def __init__(self, space: Space, camera: Camera, size: tuple[int, int]):
        super().__init__(space, from_beside(camera))
        self._is_clear = False
        self._nodes: dict[str, object] = {}
        wxyz, position = space.pose(camera)
        self._frustum = self.server.scene.add_camera_frustum(
            "/camera",
            float(np.radians(camera.fov_deg)),
            size[0] / size[1],
            scale=FRUSTUM_SIZE,
            thickness=2.0,
            thickness_units="screen",
            color=(40, 60, 90),
            wxyz=wxyz,
            position=position,
            cast_shadow=False,
            receive_shadow=False,
        )

    def show_camera(self, camera: Camera, levels: np.ndarray) -> None:
        """Draws the first camera, and its picture, (H, W[, 3]) uint8, in its frustum."""
        wxyz, position = self.space.pose(camera)
        step = max(1, -(-max(levels.shape[:2]) // MOST_PIXELS))
        if levels.ndim == 2:  # grey
            levels = np.repeat(levels[..., None], 3, axis=2)
        with self.server.atomic():
            self._frustum.wxyz, self._frustum.position = wxyz, position
            self._frustum.fov = float(np.radians(camera.fov_deg))
            self._frustum.image = np.ascontiguousarray(levels[::step, ::step])

    def show_path(self, segments: list[Segment], boxes: list[CellBox]) -> None:
        """Draws a path and its cells in place of those before; nothing for no segments."""
        with self.server.atomic():
            self._clear()
            self._is_clear = bool(segments)
            for mesh in self.meshes:
                self._let_see(mesh)
            if not segments:
                return
            space = self.space
            for number, line in enumerate(ray_lines(segments, space)):
                self._line(f"/path/ray {number}", line[None], RAY_COLORS[number % len(RAY_COLORS)], 3.0)
            self._line("/path/normals", normal_lines(segments, space, NORMAL_LENGTH), (30, 30, 30), 3.0)
            boxes = most_telling(boxes)
            looks = {(box.segment, box.kind) for box in boxes}
            for number, kind in sorted(looks):
                mine = [box for box in boxes if (box.segment, box.kind) == (number, kind)]
                thickness = {"jumped": 1.0, "empty": 1.0, "tested": 2.0, "found": 3.0}[kind]
                self._line(f"/path/cells {number} {kind}", edge_lines(mine), color_of(mine[0]), thickness)
                for box in mine if kind == "found" else ():
                    self._solid(f"/path/found {number}", box, COLORS[number % len(COLORS)], 0.55)

    def show_step(self, box: CellBox | None) -> None:
        """Marks one cell of the path."""
        with self.server.atomic():
            self._remove("/path/step", "/path/step edges")
            if box is not None:
                self._solid("/path/step", box, AMBER, 0.45)
                self._line("/path/step edges", edge_lines([box]), AMBER, 4.0)

    def zoom(self, camera: Camera, boxes: list[CellBox]) -> None:
        """Goes close to cells, beside the first camera's ray; without cells, back to the beginning."""
        if not boxes:
            self.go_to(self.home)
            return
        corners = self.space.to_world(np.concatenate([box.corners for box in boxes]))
        right, up, forward = camera.frame()
        view = -(1.0 * right + 0.45 * up - 0.3 * forward)
        near = Camera.framing(corners.min(axis=0), corners.max(axis=0), view, self.home.fov_deg)
        away = near.position - near.target
        self.go_to(Camera(near.target + ZOOM_MARGIN * away, near.target, camera.up, self.home.fov_deg))

    def _mesh(self, number: int, batch: Batch):
        mesh = super()._mesh(number, batch)
        if self._is_clear:
            self._let_see(mesh)
        return mesh

    def _let_see(self, mesh) -> None:
        """The scene is clear while cells within it are shown."""
        # Both sides would cover each other, in whatever order the triangles come.
        mesh.side, mesh.opacity = ("front", SEE_THROUGH) if self._is_clear else ("double", None)

    def lines(self, name: str) -> np.ndarray:
        """(n, 2, 3) of what is drawn under a name; empty for none."""
        node = self._nodes.get(name)
        return np.zeros((0, 2, 3)) if node is None else np.asarray(node.points)

    def _line(self, name: str, points: np.ndarray, color: tuple, thickness: float) -> None:
        if len(points):
            self._nodes[name] = self.server.scene.add_line_segments(
                name, points, np.array(color, np.uint8), thickness=thickness, thickness_units="screen"
            )

    def _solid(self, name: str, box: CellBox, color: tuple, opacity: float) -> None:
        self._nodes[name] = self.server.scene.add_mesh_simple(
            name, *solid(box), color=color, opacity=opacity, side="double", cast_shadow=False, receive_shadow=False
        )

    def _remove(self, *names: str) -> None:
        for name in names:
            node = self._nodes.pop(name, None)
            if node is not None:
                node.remove()

    def _clear(self) -> None:
        self._remove(*list(self._nodes))


def from_beside(camera: Camera) -> Camera:
    """A camera that sees another one and what it looks at: from the right, above and behind."""
    right, up, forward = camera.frame()
    away = np.linalg.norm(camera.target - camera.position)
    middle = camera.position + 0.62 * away * forward
    return Camera(middle + away * (1.7 * right + 0.85 * up - 0.45 * forward), middle, camera.up, 45.0)
