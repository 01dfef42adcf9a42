"""The pictures of the documentation: `python docs/pictures.py` in the root of a checkout makes them anew."""

from pathlib import Path

import numpy as np
import PIL.Image
import trimesh

import warprt as rt

IMAGES = Path(__file__).with_name("images")
SUN = [rt.DirectionalLight((-0.6, -1.0, -0.8), (0.8, 0.77, 0.72)), rt.AmbientLight((0.2, 0.22, 0.26))]
SKY = rt.GradientSky((0.92, 0.94, 0.97), (0.45, 0.6, 0.85))
GROUND = rt.Instance(rt.Plane(), material=rt.Material((0.34, 0.36, 0.38), mirror=0.08))


def shapes():
    """One of each shape, in a row on a plane. What has an axis along z is stood upright."""
    upright = rt.Transform().rotate(-90, (1, 0, 0))
    knot = trimesh.creation.torus(0.68, 0.3)
    row = [
        (rt.Sphere(), rt.Transform().translate(0, 1, 0)),
        (rt.Box((-0.8, 0, -0.8), (0.8, 1.6, 0.8)), rt.Transform().rotate(25, (0, 1, 0))),
        (rt.Cylinder(0.8, 2), upright.translate(0, 1, 0)),
        (rt.Cone(1, 2), upright.translate(0, 1, 0)),
        (rt.Capsule(0.55, 1), upright.translate(0, 1.05, 0)),
        (rt.Disk(), rt.Transform().rotate(-20, (1, 0, 0)).translate(0, 1, 0)),
        (rt.Mesh.from_trimesh(knot), rt.Transform().rotate(-15, (0, 1, 0)).translate(0, 0.98, 0)),
    ]
    colors = [(0.7, 0.1, 0.1), (0.8, 0.35, 0.08), (0.8, 0.6, 0.15), (0.25, 0.5, 0.15), (0.05, 0.4, 0.4)]
    colors += [(0.1, 0.2, 0.6), (0.45, 0.15, 0.5)]
    objects = [
        rt.Instance(shape, place.translate(2.6 * (k - 3), 0, 0), rt.Material(color, mirror=0.06))
        for k, ((shape, place), color) in enumerate(zip(row, colors, strict=True))
    ]
    camera = rt.Camera((0, 5, 22), (0, 0.8, 0), fov_deg=13.5)
    scene = rt.Scene([*objects, GROUND], SUN, camera, SKY)
    rt.Tracer(scene).render(size=(1000, 270), samples=32).to_pil().save(IMAGES / "shapes.jpg", quality=88)


def cameras():
    """The same court of pillars through four cameras: pinhole, parallel, fisheye, the whole sphere."""
    angle = np.arange(24) * 2 * np.pi / 24
    pillars = np.tile(np.eye(4), (24, 1, 1))
    pillars[:, :3, :3] = rt.Transform().rotate(-90, (1, 0, 0)).world_from_local[:3, :3]
    pillars[:, :3, 3] = np.stack([6 * np.cos(angle), np.full(24, 1.5), 6 * np.sin(angle)], axis=1)
    hues = [rt.Material(0.15 + 0.6 * np.cos(k * np.pi / 12 + np.array([0, 2.1, 4.2])) ** 2) for k in range(24)]
    ball = rt.Instance(rt.Sphere((0, 1.2, -2.6), 1.2), material=rt.Material(0.02, mirror=(0.9, 0.9, 0.92)))
    scene = rt.Scene([rt.Instances(rt.Cylinder(0.35, 3), pillars, hues, np.arange(24)), ball, GROUND], SUN, None, SKY)
    pose = (0, 2, 2.5), (0, 1.6, -2.6)
    kinds = [
        rt.Camera(*pose, fov_deg=70),
        rt.OrthographicCamera((0, 6, 12), (0, 1, 0), height=11),
        rt.FisheyeCamera(*pose, fov_deg=180),
        rt.EquirectangularCamera(*pose),
    ]
    widths, height, gap = (240, 240, 240, 480), 240, 6
    sheet = PIL.Image.new("RGB", (sum(widths) + 3 * gap, height), "white")
    tracer, at = rt.Tracer(scene), 0
    for camera, width in zip(kinds, widths, strict=True):
        sheet.paste(tracer.render(camera, (width, height), samples=32).to_pil(), (at, 0))
        at += width + gap
    sheet.save(IMAGES / "cameras.jpg", quality=88)


def integrators():
    """The Cornell box lit by its lamp alone, and by what its walls send each other too."""
    tracer = rt.Tracer(rt.load_scene("cornell_box", fill=False))
    sheet = PIL.Image.new("RGB", (606, 300), "white")
    for k, (integrator, samples) in enumerate({"whitted": 64, "path": 512}.items()):
        image = tracer.render(size=(300, 300), samples=samples, integrator=integrator, noise=0.012)
        sheet.paste(image.to_pil(tone="filmic", exposure=1.6), (306 * k, 0))
    sheet.save(IMAGES / "integrators.jpg", quality=88)


def ripples():
    """The ready scene of that name, as docs/benchmarks.md measures it."""
    image = rt.Tracer(rt.load_scene("ripples")).render(size=(1280, 720), samples=16)
    image.to_pil().save(IMAGES / "ripples.jpg", quality=86)


if __name__ == "__main__":
    shapes()
    cameras()
    integrators()
    ripples()
