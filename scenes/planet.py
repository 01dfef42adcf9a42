"""The Earth as one sphere, seen from 2 m above it: things of a metre nearby, peaks sunk behind the horizon 5 km off."""

import numpy as np

import warprt as rt

RADIUS = 6.371e6


def scene(peaks: int = 60, seed: int = 4) -> rt.Scene:
    """Metres from the ground under the eye, since coordinates from the Earth's centre are 0.5 m apart in float32."""
    rng = np.random.default_rng(seed)
    white, red = rt.Material((0.78, 0.76, 0.72)), rt.Material((0.62, 0.07, 0.05))
    things = [
        rt.Instance(rt.Box((-0.5, 0, -0.5), (0.5, 1, 0.5)), on_ground(-2.3, -8.5, 35), rt.Material((0.75, 0.42, 0.08))),
        rt.Instance(rt.Sphere((0, 0.5, 0), 0.5), on_ground(0.1, -7.0), rt.Material(0.02, mirror=(0.88, 0.90, 0.92))),
        rt.Instance(rt.Cone(0.5, 1.0), on_ground(1.9, -8.0, lift=0.5, upright=True), rt.Material((0.08, 0.34, 0.36))),
    ]
    # A pole every 25 m, red and white, as far as the horizon.
    poles = np.stack([on_ground(4.0, -12.0 - 25 * k, lift=0.5, upright=True) for k in range(200)])
    distance, bearing = np.sqrt(rng.uniform(18e3**2, 110e3**2, peaks)), rng.uniform(-0.62, 0.62, peaks)
    spread = [on_ground(d * np.sin(b), -d * np.cos(b), upright=True) for d, b in zip(distance, bearing, strict=True)]
    mountains = np.stack(spread)
    mountains[:, :3, :3] *= rng.uniform(0.5, 1.0, (peaks, 1, 1))
    return rt.Scene(
        objects=[
            rt.Instance(rt.Sphere((0, -RADIUS, 0), RADIUS), material=rt.Material((0.50, 0.38, 0.25))),
            *things,
            rt.Instances(rt.Cylinder(0.06, 1.0), poles, [white, red], np.arange(200) % 2),
            rt.Instances(rt.Cone(2600, 2400), mountains, rt.Material((0.30, 0.28, 0.42))),
        ],
        lights=[rt.AmbientLight((0.32, 0.34, 0.40)), rt.DirectionalLight((-0.8, -0.55, -0.5), (1.0, 0.90, 0.74))],
        camera=rt.Camera(position=(0, 2, 0), target=(0, 1.55, -8), fov_deg=34),
        background=rt.GradientSky(horizon=(0.94, 0.86, 0.76), zenith=(0.08, 0.28, 0.66)),
    )


def on_ground(x: float, z: float, turn_deg: float = 0, lift: float = 0, upright: bool = False) -> np.ndarray:
    """(4, 4) placement on the sphere at (x, z): turned, its z axis up if `upright`, and lifted."""
    place = rt.Transform().rotate(-90, (1, 0, 0)) if upright else rt.Transform()
    # Heights relative to the eye's ground, without differences of large numbers.
    drop = -(x * x + z * z) / (RADIUS + np.sqrt(RADIUS**2 - x * x - z * z))
    return place.rotate(turn_deg, (0, 1, 0)).translate(x, drop + lift, z).world_from_local
