"""The scene of the viewer's tests: a mesh with a grid that is known, and a mesh that is a mirror beside it."""

import numpy as np
import trimesh

import warprt as rt

SIZE = (80, 60)


def viewer_scene() -> rt.Scene:
    """A ball in a grid of 16 x 16 x 16, before a mirror at z = -2 that faces the camera.

    The rest is out of sight: with it, kernels are those of the ready scene "knot", and compiled once for both.
    """
    ball = trimesh.creation.icosphere(2)
    mirror = rt.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)], grid=(2, 2, 1))
    place = rt.Transform().translate(0, 0, -2)
    return rt.Scene(
        [
            rt.Instance(
                rt.Mesh(ball.vertices, ball.faces, grid=(16, 16, 16)).smooth(),
                None,
                rt.Material((0.7, 0.4, 0.2), specular=0.1),
            ),
            rt.Instance(mirror, place, rt.Material(0.1, mirror=0.8)),
            *(rt.Sphere((0, 0, -9)), rt.Box((0, 0, -9), (1, 1, -8)), rt.Plane((0, 0, -20), (0, 0, 1))),
        ],
        lights=[rt.AmbientLight((0.2, 0.2, 0.2)), rt.DirectionalLight((-1, -1, -1))],
        camera=rt.Camera((0.3, 0.4, 6), (0, 0, 0), fov_deg=40),
        background=rt.GradientSky(horizon=(0.88, 0.86, 0.83), zenith=(0.20, 0.33, 0.56)),
    )


def moved(camera: rt.Camera, x: float) -> rt.Camera:
    """The camera shifted to a side."""
    return rt.Camera(camera.position + np.array([x, 0, 0]), camera.target, camera.up, camera.fov_deg)
