"""The Cornell box: the room and blocks as measured at Cornell University, in millimetres, lit by a lamp.

Goral, Torrance, Greenberg and Battaile, "Modeling the Interaction of Light between Diffuse Surfaces", SIGGRAPH 1984;
the corners are those of graphics.cornell.edu/online/box. Ambient light, and a weak lamp at the camera, stand for
the light that walls send each other; without them (fill=False) it is a scene for integrator="path".
"""

import warprt as rt

WHITE, RED, GREEN = (0.73, 0.71, 0.68), (0.57, 0.04, 0.04), (0.12, 0.42, 0.13)
# Corners (x, z) of the blocks' tops, and their heights.
SHORT = [(130, 65), (82, 225), (240, 272), (290, 114)], 165
TALL = [(423, 247), (265, 296), (314, 456), (472, 406)], 330


def scene(fill: bool = True) -> rt.Scene:
    """A white room with a red wall and a green one, and two white blocks, one of them tall."""
    lamp = rt.RectangleLight((278, 548.4, 279.5), (130, 0, 0), (0, 0, 105), (46, 38, 27))
    fills = [rt.AmbientLight((0.13, 0.12, 0.11)), rt.PointLight((278, 300, -780), (0.16, 0.15, 0.13))]
    return rt.Scene(
        objects=[
            quad([(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)], WHITE),
            quad([(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)], WHITE),
            quad([(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)], WHITE),
            quad([(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)], GREEN),
            quad([(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)], RED),
            lamp.panel(),
            block(*SHORT),
            block(*TALL),
        ],
        lights=[lamp, *(fills if fill else [])],
        camera=rt.Camera(position=(278, 273, -800), target=(278, 273, 0), fov_deg=39.3),
    )


def quad(corners: list, color) -> rt.Instance:
    """Two triangles of one colour."""
    return rt.Instance(rt.Mesh(corners, [(0, 1, 2), (0, 2, 3)]), material=rt.Material(color))


def block(corners: list, height: float) -> rt.Instance:
    """An upright block on the floor, without a bottom."""
    vertices = [(x, y, z) for y in (0, height) for x, z in corners]
    sides = [face for k in range(4) for face in ((k, (k + 1) % 4, (k + 1) % 4 + 4), (k, (k + 1) % 4 + 4, k + 4))]
    return rt.Instance(rt.Mesh(vertices, [*sides, (4, 5, 6), (4, 6, 7)]), material=rt.Material(WHITE))
