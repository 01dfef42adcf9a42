"""Census of leaks: rays from within closed meshes, which must meet them: at random, at edges, at vertices."""

from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from warprt import checks

from .engines import Engine, Ours, peer_makers
from .meshes import Triangles
from .rays import RaySet

OFFSETS = {"0": (0, 0, 0), "1e5": (1e5, 1e5, 1e5), "Embree's": (148376, 1234, -223423)}
"""Where meshes lie. The last is from Embree's own test of watertightness."""
RADIUS = 2.0
BATCH = 1 << 20
"""Rays made and cast at a time."""
MOST_OF_PEERS = 10_000_000
"""More rays of an aim than this are cast by this project alone."""


def cube() -> Triangles:
    """Twelve triangles."""
    import trimesh

    box = trimesh.creation.box((2 * RADIUS,) * 3)
    return box.vertices, box.faces


def uv_sphere() -> Triangles:
    """2,500 quadrilaterals, cut in two, with 50 triangles round each pole."""
    import trimesh

    sphere = trimesh.creation.uv_sphere(RADIUS, count=(50, 50))
    sphere.merge_vertices()
    return sphere.vertices, sphere.faces


def icosphere() -> Triangles:
    """1,280 nearly even triangles."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
    return sphere.vertices, sphere.faces


def fans(k: int) -> Triangles:
    """Two fans of k triangles, round an apex above and one below, of uneven angles."""
    angle = 2 * np.pi * (np.arange(k) + 0.3 * np.sin(np.arange(k))) / k
    rim = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0.1 * np.cos(3 * angle)], axis=1)
    here, there = np.arange(k), (np.arange(k) + 1) % k
    above = np.stack([here, there, np.full(k, k)], axis=1)
    below = np.stack([there, here, np.full(k, k + 1)], axis=1)
    return np.concatenate([rim, [(0.1, 0.2, 1.1), (-0.2, 0.1, -0.9)]]), np.concatenate([above, below])


MESHES: dict[str, Callable[[], Triangles]] = {"cube": cube, "uv-sphere": uv_sphere, "icosphere": icosphere}
MESHES |= {f"fans of {k}": lambda k=k: fans(k) for k in (3, 5, 8, 12)}


def at(mesh: Triangles, offset: tuple) -> Triangles:
    """The mesh somewhere, as float32: rounding moves vertices, but it stays closed."""
    vertices, faces = mesh
    return (vertices + np.asarray(offset)).astype(np.float32), np.asarray(faces, np.int32)


def aimed(mesh: Triangles, offset: tuple, aim: str, count: int, rng: np.random.Generator) -> RaySet:
    """Rays from around the middle: in random directions, to points of edges, or to vertices."""
    vertices, faces = mesh
    origins = (np.asarray(offset) + rng.uniform(-0.15, 0.15, (count, 3))).astype(np.float32)
    if aim == "random":
        return RaySet(origins, rng.normal(size=(count, 3)).astype(np.float32))
    if aim == "vertex":
        target = vertices[faces.ravel()[rng.integers(0, faces.size, count)]]
    else:
        face, side = rng.integers(0, len(faces), count), rng.integers(0, 3, count)
        p, q = (vertices[faces[face, (side + k) % 3]].astype(np.float64) for k in (0, 1))
        target = (p + rng.uniform(0, 1, (count, 1)) * (q - p)).astype(np.float32)
    return RaySet(origins, target - origins)


AIMS = ("random", "edge", "vertex")


def asked_for(text: str, rays: int) -> dict[str, int]:
    """How many rays of each aim each accuracy is to cast, from "robust,double:1e7": `rays`, or its own number."""
    counts = {}
    for part in text.split(","):
        accuracy, colon, count = part.partition(":")
        try:
            counts[accuracy] = int(float(count)) if colon else rays
        except (ValueError, OverflowError):
            raise ValueError(f"rays of an accuracy must be a number, as in robust:1e8; got {part!r}") from None
    for accuracy, count in counts.items():
        checks.integer(count, f"rays of {accuracy}")
    return counts


def measure(rays: dict[str, int], threads: int, device: str = "cpu", with_peers: bool = True) -> dict:
    """For each aim and each engine: rays cast, and how many of them met nothing.

    rays: of each aim, for each accuracy: at least so many in all, shared out over meshes and offsets. All engines get
    the same rays, but for those that ask for fewer.
    """
    places = len(MESHES) * len(OFFSETS)
    shares = {accuracy: -(-count // places) for accuracy, count in rays.items()}
    most = max(shares.values())
    counts = {aim: {} for aim in AIMS}
    bar = tqdm(total=len(AIMS) * places, disable=None, leave=False, desc="leaks")
    for number, make in enumerate(MESHES.values()):
        for offset in OFFSETS.values():
            mesh = at(make(), offset)
            engines = [(Ours(mesh, threads, accuracy, device), share) for accuracy, share in shares.items()]
            if with_peers:
                engines += [(maker(mesh, threads), MOST_OF_PEERS // places) for maker in peer_makers(1).values()]
            for aim in AIMS:
                rng = np.random.default_rng((number, AIMS.index(aim)))
                for first in range(0, most, BATCH):
                    batch = aimed(mesh, offset, aim, min(BATCH, most - first), rng)
                    for engine, share in engines:
                        if share > first:
                            _add(counts[aim], engine, batch.part(share - first))
                bar.update()
    bar.close()
    return counts


def _add(counts: dict, engine: Engine, rays: RaySet) -> None:
    faces = engine.faces(rays, engine.run(rays, engine.prepare(rays)))
    name = engine.name.removesuffix(" sah 4")
    so_far = counts.setdefault(name, {"rays": 0, "leaks": 0})
    so_far["rays"] += len(rays)
    so_far["leaks"] += int((faces < 0).sum())


def table(results: dict) -> str:
    """A line for each engine; where nothing leaked, the rate that is below with 95 % confidence is 3 / rays."""
    lines = [f"{'leaks of rays':<20} " + " ".join(f"{aim:>26}" for aim in AIMS)]
    for name in results[AIMS[0]]:
        cells = []
        for aim in AIMS:
            leaks, rays = results[aim][name]["leaks"], results[aim][name]["rays"]
            rate = f"{leaks / rays:.2%}" if leaks else f"< {3 / rays:.0e}"
            cells.append(f"{f'{leaks:,} of {rays:,} ({rate})':>26}")
        lines.append(f"{name:<20} " + " ".join(cells))
    return "\n".join(lines)
