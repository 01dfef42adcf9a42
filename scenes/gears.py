"""SPD "gears" (Haines 1987): layers of gears of 36 teeth, each in mesh with its neighbours.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987:
size 4 has 64 gears of 144 rectangles and two faces of 144 corners each, and a ground: 9,345 polygons. Here they are
triangles, one mesh for all gears; the layers stand apart, and the colours are ours.
"""

import numpy as np

import warprt as rt

TEETH = 36
# Linear RGB (diffuse, mirror): brass, copper, steel, blued steel.
METALS = [
    ((0.50, 0.33, 0.08), 0.22),
    ((0.50, 0.17, 0.07), 0.20),
    ((0.34, 0.36, 0.38), 0.25),
    ((0.05, 0.13, 0.30), 0.22),
]


def scene(size: int = 4) -> rt.Scene:
    """size^3 placements of one gear, upright, in layers that are set off by half a gear."""
    world_from_gear, metal = train(size)
    gears = rt.Instances(gear(), world_from_gear, [rt.Material(*m) for m in METALS], metal)
    ground = rt.Instance(rt.Plane(), material=rt.Material((0.10, 0.11, 0.13), mirror=0.30))
    return rt.Scene(
        objects=[gears, ground],
        lights=[
            rt.AmbientLight((0.20, 0.21, 0.24)),
            rt.DirectionalLight((-0.7, -1.0, -0.8), (0.90, 0.84, 0.74)),
            rt.DirectionalLight((1.0, -0.5, -0.4), (0.22, 0.26, 0.34)),
        ],
        camera=rt.Camera(position=(2.7 * size, 1.9 * size, 3.3 * size), target=(0, 0.93 * size, 0), fov_deg=36),
        background=rt.GradientSky(horizon=(0.50, 0.54, 0.60), zenith=(0.06, 0.10, 0.18)),
    )


def gear(thickness: float = 0.5, depth: float = 0.075) -> rt.Mesh:
    """A wheel about the z axis whose teeth are `depth` high about the radius 1; 2 (4 T) + 2 (4 T - 2) triangles."""
    # Four corners to a tooth: up its flank, over its tip, down to its root. Teeth are narrower than gaps.
    angle = 2 * np.pi / TEETH * (np.arange(TEETH)[:, None] + (-0.22, -0.10, 0.10, 0.22)).ravel()
    radius = np.tile(1 + depth / 2 * np.array((-1.15, 1, 1, -1.15)), TEETH)
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    count = len(outline)
    k = np.arange(count)
    follower = (k + 1) % count
    roots = np.sort(np.concatenate([k[::4], k[3::4]]))
    teeth = np.concatenate([np.stack([k[::4], k[1::4], k[2::4]], 1), np.stack([k[::4], k[2::4], k[3::4]], 1)])
    fan = np.stack([np.full(len(roots) - 2, roots[0]), roots[1:-1], roots[2:]], axis=1)
    front = np.concatenate([teeth, fan])
    rim = np.concatenate([np.stack([k + count, follower + count, follower], 1), np.stack([k + count, follower, k], 1)])
    vertices = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (thickness / 2, -thickness / 2)])
    return rt.Mesh(vertices, np.concatenate([front, front[:, ::-1] + count, rim]))


def train(size: int) -> tuple[np.ndarray, np.ndarray]:
    """((N, 4, 4) placements, (N,) metals); every other gear is turned, so that its teeth stand in gaps."""
    layer, row, column = (index.ravel() for index in np.indices((size, size, size)))
    turn = np.where((row + column) % 2 == 0, 0.0, np.pi / TEETH)
    matrices = np.tile(np.eye(4), (len(turn), 1, 1))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(turn)
    matrices[:, 1, 0], matrices[:, 0, 1] = np.sin(turn), -np.sin(turn)
    shift = 0.5 * (layer % 2)
    place = [2 * (column + shift) - size + 0.5, 2 * row + 1.05 + 0 * shift, 1.3 * (layer - (size - 1) / 2)]
    matrices[:, :3, 3] = np.stack(place, axis=1)
    return matrices, (layer + row + column) % len(METALS)
