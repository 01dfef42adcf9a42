"""The white furnace: things that keep all light cannot be told from a world that is white all around."""

import numpy as np
import pytest

import warprt as rt

LAMPS = 2000
POLE = 0.2  # the height at which a thing is seen along its normal
MATERIALS = {
    "lambert": rt.Material(1),
    "mirror": rt.Material(0, mirror=1),
    "glass": rt.Material(0, glass=1, ior=1.5),
    "lambert and mirror": rt.Material(0.3, mirror=0.7),
}
SHINY = {
    f"{name}, shininess {s:g}": rt.Material(diffuse, mirror=mirror, specular=specular, shininess=s)
    for name, diffuse, mirror, specular in (("highlight", 0, 0, 1), ("mixture", 0.4, 0.2, 0.4))
    for s in (2, 30)
}
# Shadow rays do not pass glass: no lamp shines on what scatters within.
MURKY = {"lambert and glass": rt.Material(0.3, glass=0.7, ior=1.3)}
ALL = MATERIALS | SHINY | MURKY


def furnace():
    """One thing of each material, too far apart to shade each other, mirrored and sheared, under lamps from everywhere.

    A world as bright as 1 gives 4 pi / N of solid angle to each of N directions. A lamp's colour is that of a white
    surface that faces it, so pi times less.
    """
    height = 1 - (2 * np.arange(LAMPS) + 1) / LAMPS
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(LAMPS)
    radius = np.sqrt(1 - height**2)
    towards = np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1)
    matrices = np.tile(np.eye(4), (len(ALL), 1, 1))
    matrices[:, :3, :3] = [(0.9, 0.3, 0), (0, -1, POLE), (0, 0, 1.1)]
    matrices[:, 0, 3] = 60 * np.arange(len(ALL))
    things = rt.Instances(rt.Sphere(), matrices, list(ALL.values()), np.arange(len(ALL)))
    return rt.Scene([things], [rt.DirectionalLight(-d, 4 / LAMPS) for d in towards], background=(1, 1, 1))


@pytest.fixture(scope="module")
def brightness(device):
    """(n, 3) colours of the pixels that see a thing, by its material; the first is seen along the normal."""
    tracer = rt.Tracer(furnace(), device=device)
    return {name: seen(tracer, 60 * k) for k, name in enumerate(ALL)}


def seen(tracer, x):
    sizes = ((POLE, 1e-3, 1, 1), (0, 2.2, 11, 4))
    images = [
        tracer.render(
            rt.OrthographicCamera((x, y, 9), (x, y, 0), height=height),
            (pixels, pixels),
            samples=samples,
            max_bounces=100,
            outputs=("color", "instance_id"),
        )
        for y, height, pixels, samples in sizes
    ]
    # Pixels on the outline also see the world beside it: all the same where it is as bright.
    return np.concatenate([image["color"][image["instance_id"] >= 0] for image in images])


@pytest.mark.parametrize("name", MATERIALS)
def test_white_things_are_as_bright_as_a_white_world(name, brightness):
    assert len(brightness[name]) > 50
    np.testing.assert_allclose(brightness[name], 1, rtol=0, atol=0.005)


@pytest.mark.parametrize("name", [*SHINY, *MURKY])
def test_nothing_is_brighter_than_a_white_world(name, brightness):
    assert len(brightness[name]) > 50
    assert brightness[name].max() <= 1.005
    assert 0.1 < brightness[name].min() < 0.99


@pytest.mark.parametrize("name", SHINY)
def test_highlights_give_back_all_of_their_share_along_the_normal(name, brightness):
    np.testing.assert_allclose(brightness[name][0], 1, rtol=0, atol=0.005)
