"""Poses of cameras, in files and in trimesh: matrices whose frame looks along -z, with +y up."""

import numpy as np

from . import checks
from .transform import affine


def view_of(world_from_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(position, target, up) of a camera with a (4, 4) pose. Raises ValueError where it has no direction."""
    pose = affine(world_from_camera, "pose")
    position, backward = pose[:3, 3], checks.direction(pose[:3, 2], "camera view")
    # A target far enough away that the direction to it keeps its digits.
    return position, position - max(1.0, float(np.abs(position).max())) * backward, pose[:3, 1]


def pose_of(camera) -> np.ndarray:
    """(4, 4) float64: world_from_camera of a camera with a position and a frame."""
    right, up, forward = camera.frame()
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, up, -forward, camera.position])
    return pose


def pose_along(direction: np.ndarray) -> np.ndarray:
    """(4, 4) float64: a rotation that turns -z into a direction."""
    backward = -checks.direction(direction, "direction")
    across = np.cross(np.eye(3)[int(np.argmin(np.abs(backward)))], backward)
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([across, np.cross(backward, across), backward])
    return pose
