"""The Cornell box: the room and blocks as measured at Cornell University, in millimetres, in direct light.

Goral, Torrance, Greenberg and Battaile, "Modeling the Interaction of Light between Diffuse Surfaces", SIGGRAPH 1984;
the corners are those of graphics.cornell.edu/online/box. Nine points stand for the lamp; ambient light, and a weak lamp
at the camera, for the light that walls send each other.
"""

import warprt as rt

WHITE, RED, GREEN = (0.73, 0.71, 0.68), (0.57, 0.04, 0.04), (0.12, 0.42, 0.13)
# Corners (x, z) of the blocks' tops, and their heights.
SHORT = [(130, 65), (82, 225), (240, 272), (290, 114)], 165
TALL = [(423, 247), (265, 296), (314, 456), (472, 406)], 330


def scene() -> rt.Scene:
    """A white room with a red wall and a green one, and two white blocks, one of them tall."""
    lamp = [(x, 547.0, z) for x in (235, 278, 321) for z in (244, 279.5, 315)]
    return rt.Scene(
        objects=[
            quad([(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)], WHITE),
            quad([(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)], WHITE),
            quad([(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)], WHITE),
            quad([(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)], GREEN),
            quad([(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)], RED),
            # The lamp: so white that ambient light makes it shine.
            quad([(343, 548.5, 227), (343, 548.5, 332), (213, 548.5, 332), (213, 548.5, 227)], (9, 8, 6)),
            block(*SHORT),
            block(*TALL),
        ],
        lights=[
            rt.AmbientLight((0.13, 0.12, 0.11)),
            rt.PointLight((278, 300, -780), (0.16, 0.15, 0.13)),
            *(rt.PointLight(point, (12500, 10400, 7600), falloff=True) for point in lamp),
        ],
        camera=rt.Camera(position=(278, 273, -800), target=(278, 273, 0), fov_deg=39.3),
    )


def quad(corners: list, color: tuple) -> rt.Instance:
    """Two triangles of one colour."""
    return rt.Instance(rt.Mesh(corners, [(0, 1, 2), (0, 2, 3)]), material=rt.Material(color))


def block(corners: list, height: float) -> rt.Instance:
    """An upright block on the floor, without a bottom."""
    vertices = [(x, y, z) for y in (0, height) for x, z in corners]
    sides = [face for k in range(4) for face in ((k, (k + 1) % 4, (k + 1) % 4 + 4), (k, (k + 1) % 4 + 4, k + 4))]
    return rt.Instance(rt.Mesh(vertices, [*sides, (4, 5, 6), (4, 6, 7)]), material=rt.Material(WHITE))
