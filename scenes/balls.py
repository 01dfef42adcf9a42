"""SPD "balls" (Haines 1987): the sphereflake as it was published, shiny and of one colour.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987:
size 4 has 7,381 spheres and a ground. The ground is an infinite plane here; directional lights stand for three far
points, and the colours are ours.
"""

import warprt as rt
from warprt.scenes.sphereflake import sphereflake


def scene(size: int = 4) -> rt.Scene:
    """(9^(size + 1) - 1) / 8 spheres: each carries nine of a third its radius, six around it and three on top."""
    flake = rt.Instances(rt.Sphere(), sphereflake(size)[0], rt.Material((0.36, 0.20, 0.07), mirror=(0.52, 0.46, 0.36)))
    ground = rt.Instance(rt.Plane((0, -1, 0)), material=rt.Material((0.11, 0.14, 0.18)))
    return rt.Scene(
        objects=[flake, ground],
        lights=[
            rt.AmbientLight((0.16, 0.17, 0.20)),
            rt.DirectionalLight((-4, -4, -2), (0.50, 0.47, 0.42)),
            rt.DirectionalLight((3, -4, -3), (0.42, 0.40, 0.38)),
            rt.DirectionalLight((1, -3, 4), (0.24, 0.27, 0.32)),
        ],
        camera=rt.Camera(position=(2.9, 1.15, 5.2), target=(0, 0.25, 0), fov_deg=34),
        background=rt.GradientSky(horizon=(0.62, 0.76, 0.88), zenith=(0.05, 0.18, 0.46)),
    )
