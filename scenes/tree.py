"""SPD "tree" (Haines 1987): a tree whose branches fork in two, a cone and a sphere each.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987,
after Aono and Kunii (1984): size 11 has 4,095 cones, 4,095 spheres and a ground. Cones are blunt there: here they are
one mesh of 32 sides, since rt.Cone comes to a point. The last spheres are larger and flat, as leaves; angles and ratios
are ours.
"""

import numpy as np

import warprt as rt

TAPER = 0.82
BARK, LEAVES = (0.20, 0.12, 0.07), [(0.10, 0.30, 0.04), (0.20, 0.38, 0.05), (0.36, 0.40, 0.05), (0.05, 0.20, 0.04)]


def scene(size: int = 11) -> rt.Scene:
    """2^(size + 1) - 1 branches: each carries two thinner and shorter ones, turned about it."""
    branches = grown(size)
    count, leaves = len(branches), 2**size
    is_leaf = np.arange(count) >= count - leaves
    leaf = np.random.default_rng(1).integers(1, 1 + len(LEAVES), count)
    tips = branches @ rt.Transform().scale(TAPER).translate(0, 1, 0).world_from_local
    # A joint is as wide as the branch that ends in it.
    tips[:, :3, :3] *= 0.11
    tips[is_leaf, :3, :3] = 0.07 * np.eye(3) * (1, 0.6, 1)
    materials = [rt.Material(BARK), *(rt.Material(color, mirror=0.04) for color in LEAVES)]
    return rt.Scene(
        objects=[
            rt.Instances(blunt_cone(), branches, rt.Material(BARK)),
            rt.Instances(rt.Sphere(), tips, materials, leaf * is_leaf),
            rt.Instance(rt.Plane(), material=rt.Material((0.30, 0.36, 0.14))),
        ],
        lights=[rt.AmbientLight((0.28, 0.32, 0.38)), rt.DirectionalLight((0.7, -1.0, -0.6), (1.05, 0.96, 0.80))],
        camera=rt.Camera(position=(0, 1.5, 11.5), target=(0.3, 2.35, 0), fov_deg=31),
        background=rt.GradientSky(horizon=(0.86, 0.90, 0.94), zenith=(0.20, 0.42, 0.80)),
    )


def grown(size: int) -> np.ndarray:
    """(2^(size + 1) - 1, 4, 4) placements of branches, level by level, each a product of those below it."""
    fork = [
        rt.Transform().scale(0.86).rotate(-24, (0, 0, 1)).rotate(110, (0, 1, 0)).translate(0, 1, 0),
        rt.Transform().scale(0.78).rotate(33, (0, 0, 1)).rotate(110, (0, 1, 0)).translate(0, 1, 0),
    ]
    levels = [np.eye(4)[None]]
    for _ in range(size):
        levels.append((levels[-1][:, None] @ np.stack([f.world_from_local for f in fork])).reshape(-1, 4, 4))
    return np.concatenate(levels)


def blunt_cone(sides: int = 32, radius: float = 0.11) -> rt.Mesh:
    """From y = 0 to 1, narrower above by TAPER."""
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    k, follower = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate(
        [np.stack([k, k + sides, follower + sides], 1), np.stack([k, follower + sides, follower], 1)]
    )
    return rt.Mesh(np.concatenate([radius * circle, TAPER * radius * circle + (0, 1, 0)]), faces)
