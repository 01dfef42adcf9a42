"""SPD "tetra" (Haines 1987): a tetrahedron made of four of half its size, level after level.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987,
after Glassner (1984) and Kay and Kajiya (1986): size 6 has 4,096 triangles. The ground and the colours are ours.
"""

import numpy as np

import warprt as rt

CORNERS = np.array([(0, np.sqrt(2), 0), *((np.sin(a), 0, np.cos(a)) for a in np.radians([0, 120, 240]))])
FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
# Linear RGB, by which of its four corners the first halving went to.
COLORS = [(0.85, 0.55, 0.12), (0.70, 0.10, 0.08), (0.10, 0.36, 0.42), (0.06, 0.14, 0.40)]


def scene(size: int = 6) -> rt.Scene:
    """4^size triangles: 4^(size - 1) placements of one tetrahedron, whose base is inscribed in a circle of radius 1."""
    matrices = pyramid(size - 1)
    quarter = np.arange(len(matrices)) * 4 // max(len(matrices), 4)
    tetrahedra = rt.Instances(rt.Mesh(CORNERS, FACES), matrices, [rt.Material(color) for color in COLORS], quarter)
    ground = rt.Instance(rt.Plane(), material=rt.Material((0.40, 0.38, 0.36), mirror=0.18))
    return rt.Scene(
        objects=[tetrahedra, ground],
        lights=[rt.AmbientLight((0.26, 0.28, 0.33)), rt.DirectionalLight((-1.0, -1.1, -0.55), (1.0, 0.94, 0.84))],
        camera=rt.Camera(position=(1.15, 1.35, 4.1), target=(0, 0.56, 0.05), fov_deg=27),
        background=rt.GradientSky(horizon=(0.86, 0.84, 0.82), zenith=(0.16, 0.28, 0.52)),
    )


def pyramid(levels: int) -> np.ndarray:
    """(4^levels, 4, 4) placements; each level puts four halves into the corners of what came before."""
    halves = np.tile(np.diag((0.5, 0.5, 0.5, 1.0)), (4, 1, 1))
    halves[:, :3, 3] = CORNERS / 2
    matrices = np.eye(4)[None]
    for _ in range(levels):
        matrices = (matrices[:, None] @ halves).reshape(-1, 4, 4)
    return matrices
