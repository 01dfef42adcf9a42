"""What cameras should see, by other means than theirs: from a direction back to the picture."""

import numpy as np
from hypothesis import strategies as st

import warprt as rt

coordinate = st.floats(-10, 10, width=32)
points = st.tuples(coordinate, coordinate, coordinate)
sizes = st.tuples(st.integers(1, 9), st.integers(1, 9))


def frame(position, target, up):
    """(right, up, forward), by Gram and Schmidt."""
    position, target, up = (np.asarray(v, float) for v in (position, target, up))
    forward = (target - position) / np.sqrt(((target - position) ** 2).sum())
    up = up - (up @ forward) * forward
    up = up / np.sqrt((up**2).sum())
    # The one unit vector that makes (right, up, -forward) a rotation.
    right = np.array([np.linalg.det([axis, up, -forward]) for axis in np.eye(3)])
    return right, up, forward


@st.composite
def poses(draw):
    """(position, target, up) that are not close to being none."""
    position, target, up = draw(points), draw(points), draw(points)
    view = np.subtract(target, position)
    across = np.linalg.norm(np.cross(view, up))
    if not (np.linalg.norm(view) > 0.1 and across > 0.1 * np.linalg.norm(view) * np.linalg.norm(up) > 0.01):
        return (1.0, 2.0, 3.0), (-4.0, 0.5, 1.0), (0.0, 1.0, 0.0)
    return position, target, up


def pixel_centers(width, height):
    """(height, width, 2): column and row of each."""
    return np.array([[(column + 0.5, row + 0.5) for column in range(width)] for row in range(height)])


def picture_position(camera, points, width, height):
    """(..., 2): column and row at which a camera sees points, by the definition of its projection."""
    right, up, forward = frame(camera.position, camera.target, camera.up)
    away = points - camera.position
    x, y, z = away @ right, away @ up, away @ forward
    middle = np.array([width / 2, height / 2])
    if isinstance(camera, rt.Camera):
        focal = height / 2 / np.tan(np.radians(camera.fov_deg) / 2)
        off = np.stack([focal * x / z, -focal * y / z], axis=-1)
    elif isinstance(camera, rt.OrthographicCamera):
        off = np.stack([x, -y], axis=-1) * height / camera.height
    elif isinstance(camera, rt.FisheyeCamera):
        r = np.arctan2(np.hypot(x, y), z) / np.radians(camera.fov_deg) * height
        azimuth = np.arctan2(y, x)
        off = np.stack([r * np.cos(azimuth), -r * np.sin(azimuth)], axis=-1)
    else:
        longitude, latitude = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
        off = np.stack([longitude / (2 * np.pi) * width, -latitude / np.pi * height], axis=-1)
    return middle + off
