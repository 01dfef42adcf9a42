"""Light from surface to surface against Mitsuba 3: pictures of rooms by both path tracers."""

from dataclasses import replace

import numpy as np

import warprt as rt

from . import shared_scenes
from .against_mitsuba import compare_pictures, integrated

BOUNCES = 64
PATH = {"type": "path", "max_depth": BOUNCES + 2}
"""Their depth counts the lamp, and the surface that is seen."""


def scenes() -> dict[str, rt.Scene]:
    """The Cornell box, and the mixed scene that depth and normals are compared on, each with its one lamp."""
    mixed = shared_scenes.SCENES["mixed"]()
    lamps = [light for light in mixed.lights if isinstance(light, rt.RectangleLight)]
    return {"Cornell box": rt.load_scene("cornell_box", fill=False), "mixed": replace(mixed, lights=lamps)}


def measure(scene: rt.Scene, size: tuple[int, int], samples: int) -> dict:
    """How far the means of both pictures, and their pixels, lie apart; where a lamp is seen, they are left out.

    noise: what pixels should differ by, by the variance of ours and as much again.
    """
    tracer = rt.Tracer(scene, device="cpu")
    image = tracer.render(
        size=size,
        samples=samples,
        max_bounces=BOUNCES,
        integrator="path",
        outputs=("color", "variance", "instance_id"),
    )
    lit = (~shows_lamp(scene))[image["instance_id"].ravel()]
    bare = replace(scene, objects=[item for item, shows in zip(scene.objects, panels(scene), strict=True) if not shows])
    theirs = integrated(bare, size, samples, PATH)[lit]
    ours = image["color"].reshape(-1, 3)[lit]
    # Of a normal distribution, the mean distance from its middle is so many standard deviations.
    noise = np.sqrt(2 / np.pi) * np.sqrt(2 * image.variance.reshape(-1, 3)[lit]).mean() / theirs.mean()
    return compare_pictures(ours, theirs) | {"samples": samples, "pixels": int(lit.sum()), "noise": float(noise)}


def panels(scene: rt.Scene) -> list[bool]:
    """Of each object, whether it only shows a lamp, which Mitsuba's lamps do by themselves."""
    return [
        isinstance(item, rt.Instance) and item.material is not None and not item.material.shines
        for item in scene.objects
    ]


def shows_lamp(scene: rt.Scene) -> np.ndarray:
    """Of each instance; the last entry, which the id -1 finds, is for what meets nothing."""
    counts = [len(item) if isinstance(item, rt.Instances) else 1 for item in scene.objects]
    return np.append(np.repeat(panels(scene), counts), False)


def table(results: dict) -> str:
    """A line for each scene, ours before theirs."""
    return "\n".join(
        f"{name}: mean {light['mean'][0]:.5f} / {light['mean'][1]:.5f}, off by {100 * light['mean_differs']:.3f} %; "
        f"pixels by {100 * light['pixels_differ']:.2f} % (noise {100 * light['noise']:.2f} %); "
        f"{light['pixels']:,} pixels, {light['samples']} samples"
        for name, light in results.items()
    )
