"""The space of the browser: the scene moved and scaled, so that WebGL's float32 is enough for any scene."""

from dataclasses import dataclass

import numpy as np

from ..camera import Camera
from ..cameras import AnyCamera, OrthographicCamera
from ..poses import pose_of
from ..quaternions import compose, decompose
from ..tracer import Tracer
from ..views import View

FOV_DEG = 45.0
"""Of the viewer's camera where the scene's is none that has one."""
MOST_OFF = 10.0
"""How often the distance to a camera's target what it sees may be away, to count as what it looks at."""
FAR = 1e4
"""How far the browser sees, in its units, beyond the size of the scene."""


@dataclass(frozen=True, eq=False)
class Space:
    """browser = (world - center) / scale, in float64."""

    center: np.ndarray
    scale: float

    def to_browser(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the world."""
        return (np.asarray(points, np.float64) - self.center) / self.scale

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the browser's space."""
        return np.asarray(points, np.float64) * self.scale + self.center

    def camera(self, position, wxyz, look_at, up, fov: float) -> Camera:
        """The camera that viser describes: its axes are x right, y down, z forward, and fov is vertical, in radians."""
        w, x, y, z = np.asarray(wxyz, np.float64)
        turned = compose(np.zeros((1, 3)), np.array([[x, y, z, w]]), np.ones((1, 3)))[0, :3, :3]
        position = np.asarray(position, np.float64)
        ahead = np.linalg.norm(np.asarray(look_at, np.float64) - position) or 1.0
        # Where nothing has rolled, the direction that the user knows, such as (0, 1, 0), and not a tilted one.
        up = np.asarray(up, np.float64)
        is_level = abs(up @ turned[:, 0]) < 1e-6 and up @ turned[:, 1] < -1e-6
        return Camera(
            self.to_world(position),
            self.to_world(position + ahead * turned[:, 2]),
            up if is_level else -turned[:, 1],
            float(np.degrees(fov)),
        )

    def pose(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """((4,) wxyz, (3,) position) by which viser draws a camera."""
        pose = pose_of(camera)
        # From x right, y up, z backward to x right, y down, z forward.
        pose[:3, :3] *= (1.0, -1.0, -1.0)
        pose[:3, 3] = 0.0
        x, y, z, w = decompose(pose[None])[1][0].astype(float)
        return np.array([w, x, y, z]), self.to_browser(camera.position)


def framed(tracer: Tracer, camera: Camera) -> Space:
    """A space whose unit is the distance to what the camera looks at, which is in its middle.

    That is what it sees, but not so far from its target, in either direction, as a horizon is.
    """
    hit = tracer.cast(camera.position, camera.frame()[2], outputs=("hit", "t"))
    target = float(np.linalg.norm(camera.target - camera.position))
    away = float(np.clip(hit.t, target / MOST_OFF, target * MOST_OFF)) if hit.hit else target
    if not 0 < away < np.inf:
        away = 1.0
    return Space(camera.position + away * camera.frame()[2], away)


def viewing_camera(tracer: Tracer) -> tuple[Camera, str | None]:
    """(where the viewer begins, what to say of it): the scene's camera as a perspective one, or one that sees all."""
    camera = tracer.scene.camera
    if camera is None:
        return tracer.framing_camera(), "The scene has no camera; this one sees everything."
    name = type(camera).__name__
    if name == "Camera":
        return camera, None
    return _perspective(tracer, camera), f"The scene's {name} is shown as a perspective camera."


def _perspective(tracer: Tracer, camera: AnyCamera) -> Camera:
    """A pinhole where another camera stands."""
    if isinstance(camera, View):
        fov_deg = getattr(camera, "fov_deg", FOV_DEG)
        if isinstance(camera, OrthographicCamera):  # the same height at the target
            away = np.linalg.norm(camera.target - camera.position)
            fov_deg = float(np.clip(2 * np.degrees(np.arctan2(camera.height / 2, away)), 1, 120))
        return Camera(camera.position, camera.target, camera.up, fov_deg if 1 <= fov_deg <= 120 else FOV_DEG)
    width, height = camera.size
    corner, right, down = camera.pixel_steps(width, height)
    forward = corner + width / 2 * right + height / 2 * down
    fov_deg = 2 * np.degrees(np.arctan2(np.linalg.norm(height / 2 * down), np.linalg.norm(forward)))
    reach = np.linalg.norm(tracer.framing_camera().target - camera.position) or 1.0
    target = camera.position + reach * forward / np.linalg.norm(forward)
    return Camera(camera.position, target, -down, float(fov_deg))
