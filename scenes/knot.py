"""A trefoil knot, one mesh, between two mirrors: much of its grid is empty, and rays come back to it."""

import numpy as np

import warprt as rt


def scene(around: int = 480, across: int = 40) -> rt.Scene:
    """A knot of 2 * around * across triangles over a polished floor, before a mirror, with a mirror ball in its bow."""
    stand = rt.Transform().rotate(14, (1, 0, 0)).rotate(-18, (0, 1, 0)).translate(0, 1.28, 0)
    mirror = rt.Transform().rotate(-24, (0, 1, 0)).translate(1.15, 1.25, -2.3)
    return rt.Scene(
        objects=[
            rt.Instance(knot(around, across), stand, rt.Material((0.10, 0.36, 0.38), specular=0.12, shininess=60)),
            rt.Instance(
                rt.Box((-1.6, -1.25, -0.05), (1.6, 1.25, 0.0)), mirror, rt.Material(0.02, mirror=(0.84, 0.88, 0.87))
            ),
            rt.Instance(rt.Sphere((0.95, 0.42, 1.25), 0.42), material=rt.Material(0.04, mirror=(0.90, 0.84, 0.72))),
            rt.Instance(rt.Plane(), material=rt.Material((0.42, 0.41, 0.40), mirror=0.14)),
        ],
        lights=[rt.AmbientLight((0.24, 0.26, 0.31)), rt.DirectionalLight((-0.7, -1.1, -0.55), (0.92, 0.86, 0.76))],
        camera=rt.Camera(position=(0.6, 2.0, 6.4), target=(0.12, 1.12, 0), fov_deg=34),
        background=rt.GradientSky(horizon=(0.88, 0.86, 0.83), zenith=(0.20, 0.33, 0.56)),
    )


def knot(around: int, across: int, radius: float = 0.24) -> rt.Mesh:
    """A tube around the curve (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t), made to fit a box about 2 wide."""
    t, angle = (2 * np.pi * np.arange(count) / count for count in (around, across))
    curve = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1) / 2.5
    ahead = np.stack([np.cos(t) + 4 * np.cos(2 * t), -np.sin(t) + 4 * np.sin(2 * t), -3 * np.cos(3 * t)], axis=1)
    # The curve winds around the z axis, so that "away from it" never is along the curve.
    side = np.cross(ahead, curve * (1, 1, 0) + (0, 0, 1e-9))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    out = np.cross(side, ahead)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    ring = np.cos(angle)[:, None] * out[:, None] + np.sin(angle)[:, None] * side[:, None]
    vertices = (curve[:, None] + radius * ring).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + k, (i + 1) % around * across + k
    a2, b2 = i * across + (k + 1) % across, (i + 1) % around * across + (k + 1) % across
    return rt.Mesh(vertices, np.stack([a, b2, b, a, a2, b2], axis=-1).reshape(-1, 3)).smooth()
