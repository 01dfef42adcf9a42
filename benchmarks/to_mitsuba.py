"""Scenes in Mitsuba 3, and rays through them: its variant `scalar_rgb`, which needs no compiler on the machine."""

import importlib.util
import math
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

import warprt as rt
from warprt.scene import Shape


def module():
    """Mitsuba, with its variant chosen. Raises ValueError where it is not installed."""
    if importlib.util.find_spec("mitsuba") is None:
        raise ValueError("this needs Mitsuba 3: pip install 'warprt[bench]'")
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    return mitsuba


class MitsubaScene:
    """A scene of ours as Mitsuba holds it.

    Shapes are groups, and placements are instances of them, whatever the matrix. Surfaces scatter evenly on both sides.
    A `RectangleLight` is a surface too: unlike ours it is seen and casts shadows. The background is left out. Raises
    ValueError that names what has no counterpart.
    """

    def __init__(self, scene: rt.Scene):
        self.mitsuba = module()
        with TemporaryDirectory() as folder:
            self._folder = Path(folder)
            self.scene = self.mitsuba.load_dict(dict(self._parts(scene)))

    def cast(self, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(t, normal) of the closest hits of rays (n, 3), in float32 there: t inf where there is none."""
        t, normal = np.full(len(o), np.inf), np.zeros((len(o), 3))
        for k, ray in enumerate(self._rays(o, d)):
            hit = self.scene.ray_intersect(ray)
            if hit.is_valid():
                t[k], normal[k] = hit.t, hit.n
        return t, normal

    def light(self, o: np.ndarray, d: np.ndarray, integrator: dict, seed: int = 0) -> np.ndarray:
        """(n, 3) linear RGB along each ray, one sample by an integrator, such as {"type": "direct"}."""
        integrator = self.mitsuba.load_dict(integrator)
        sampler = self.mitsuba.load_dict({"type": "independent"})
        sampler.seed(seed)
        differential = self.mitsuba.RayDifferential3f
        rays = (differential(ray) for ray in self._rays(o, d))
        return np.array([integrator.sample(self.scene, sampler, ray)[0] for ray in rays])

    def _rays(self, o: np.ndarray, d: np.ndarray) -> Iterator:
        ray, point, vector = self.mitsuba.Ray3f, self.mitsuba.Point3f, self.mitsuba.Vector3f
        return (ray(point(*a), vector(*b)) for a, b in zip(o.tolist(), d.tolist(), strict=True))

    def _parts(self, scene: rt.Scene) -> Iterator[tuple[str, object]]:
        yield "type", "scene"
        for k, item in enumerate(scene.objects):
            yield from self._item(f"object{k}", item if isinstance(item, rt.Instances) else _as_instances(item))
        for k, light in enumerate(scene.lights):
            yield f"light{k}", self._light(light)

    def _item(self, name: str, item: rt.Instances) -> Iterator[tuple[str, dict]]:
        """A group for each material of it, and an instance for each placement."""
        for k, material in enumerate(item.materials):
            parts = self._shape(item.shape, f"{name}-{k}")
            group = {f"part{i}": part | {"bsdf": _bsdf(material)} for i, part in enumerate(parts)}
            yield f"{name}-{k}", {"type": "shapegroup", **group}
        for i, (matrix, k) in enumerate(zip(item.world_from_local, item.material_index, strict=True)):
            group = {"type": "ref", "id": f"{name}-{k}"}
            yield f"{name}-at{i}", {"type": "instance", "to_world": self._matrix(matrix), "group": group}

    def _shape(self, shape: Shape, name: str) -> list[dict]:
        """What a shape is made of there."""
        if isinstance(shape, rt.Sphere):
            return [{"type": "sphere", "center": shape.center.tolist(), "radius": shape.radius}]
        if isinstance(shape, rt.Box):
            return [{"type": "cube", "to_world": self._scaled((shape.upper - shape.lower) / 2, *shape.bounds)}]
        if isinstance(shape, rt.Mesh):
            path = self._folder / f"{name}.ply"
            trimesh.Trimesh(shape.vertices, shape.faces, process=False).export(path)
            return [{"type": "ply", "filename": str(path), "face_normals": True}]
        if isinstance(shape, rt.Cylinder):
            # It is open there: two disks, which look along z, close it.
            ends = [shape.center + (0, 0, z) for z in (-shape.height / 2, shape.height / 2)]
            radius = np.full(3, shape.radius)
            wall = {"type": "cylinder", "p0": ends[0].tolist(), "p1": ends[1].tolist(), "radius": shape.radius}
            lids = [self._scaled(radius * (1, s, s), end, end) for s, end in zip((-1, 1), ends, strict=True)]
            return [wall, *({"type": "disk", "to_world": lid} for lid in lids)]
        raise ValueError(f"Mitsuba has no {type(shape).__name__} like ours")

    def _light(self, light) -> dict:
        """A white surface that faces our lamps has their colour; there, it scatters a share 1 / pi of what arrives."""
        if isinstance(light, rt.PointLight) and light.falloff:
            return {"type": "point", "position": light.position.tolist(), "intensity": _rgb(light.color, math.pi)}
        if isinstance(light, rt.DirectionalLight):
            arrives = _rgb(light.color, math.pi)
            return {"type": "directional", "direction": light.direction.tolist(), "irradiance": arrives}
        if isinstance(light, rt.RectangleLight):
            place = np.eye(4)
            place[:3, 0], place[:3, 1], place[:3, 3] = light.edge_u / 2, light.edge_v / 2, light.center
            place[:3, 2] = np.cross(light.edge_u, light.edge_v)
            glow = {"type": "area", "radiance": _rgb(light.color)}
            black = _bsdf(rt.Material(0))
            return {"type": "rectangle", "to_world": self._matrix(place), "emitter": glow, "bsdf": black}
        raise ValueError(f"Mitsuba has no {type(light).__name__} like ours; a PointLight there needs falloff")

    def _scaled(self, scale: np.ndarray, lower: np.ndarray, upper: np.ndarray):
        """Scaled, and moved to the middle of two points."""
        matrix = np.diag([*scale, 1.0])
        matrix[:3, 3] = (lower + upper) / 2
        return self._matrix(matrix)

    def _matrix(self, matrix: np.ndarray):
        return self.mitsuba.ScalarTransform4f(np.asarray(matrix, float))


def _as_instances(item: rt.Instance | Shape) -> rt.Instances:
    """One placement as many."""
    item = item if isinstance(item, rt.Instance) else rt.Instance(item)
    return rt.Instances(item.shape, item.transform.world_from_local[None], item.material)


def _bsdf(material: rt.Material) -> dict:
    rest = material.mirror + material.specular + material.glass + material.emission
    if any(rest) or material.texture:
        raise ValueError(f"with Mitsuba, only surfaces that just scatter evenly are compared; got {material}")
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _rgb(material.diffuse)}}


def _rgb(color, factor: float = 1.0) -> dict:
    return {"type": "rgb", "value": [factor * float(c) for c in color]}
