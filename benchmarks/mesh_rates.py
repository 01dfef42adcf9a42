"""Closest hits on one mesh: this project against wp.Mesh, one thread, alternating in one process.

    python benchmarks/mesh_rates.py MESH... [--faces-per-cell N,N,...] [-o RESULT.json]

Primary rays (512 x 512, pinhole) and random rays (262,144 from a sphere about the mesh to points in its bounds),
float32, Warp arrays in and out, outputs t and primitive_id. Medians of the rounds; compilation excluded.
"""

import argparse
import json
import platform
import time
from pathlib import Path

import numpy as np
import warp as wp

import warprt as rt
import warprt.mesh
from warprt.mesh_files import read_mesh

ROUNDS = 9


@wp.kernel(enable_backward=False)
def query(mesh: wp.uint64, o: wp.array(dtype=wp.vec3), d: wp.array(dtype=wp.vec3), face: wp.array(dtype=int)):
    """The peer: Warp's own mesh query."""
    k = wp.tid()
    hit = wp.mesh_query_ray(mesh, o[k], d[k], 1.0e30)
    face[k] = wp.where(hit.result, hit.face, -1)


def ray_sets(lower: np.ndarray, upper: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(origins, directions) of each kind of rays, (n, 3) float32."""
    o, d = rt.Camera.framing(lower, upper).rays(512, 512)
    rng = np.random.default_rng(0)
    v = rng.normal(size=(262_144, 3))
    start = (lower + upper) / 2 + np.linalg.norm(upper - lower) * v / np.linalg.norm(v, axis=1, keepdims=True)
    aim = rng.uniform(lower, upper, (262_144, 3)) - start
    return {
        "primary": (o.reshape(-1, 3).astype(np.float32), d.reshape(-1, 3).astype(np.float32)),
        "random": (start.astype(np.float32), aim.astype(np.float32)),
    }


def cpu_name() -> str:
    """What the processor calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def seconds(function, *arguments, **options) -> float:
    """Time of one call."""
    started = time.perf_counter()
    function(*arguments, **options)
    return time.perf_counter() - started


def measure(path: str, densities: list[float]) -> dict:
    """Rates on one mesh, in millions of rays per second, and what the grids cost."""
    mesh = read_mesh(path)
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)
    points, indices = wp.array(vertices, dtype=wp.vec3, device="cpu"), wp.array(faces.ravel(), dtype=int, device="cpu")
    result = {"triangles": len(faces), "peer_build_ms": 1e3 * seconds(wp.Mesh, points, indices)}
    peer = wp.Mesh(points, indices)
    tracers, result["grids"] = {}, {}
    for density in densities:
        warprt.mesh.FACES_PER_CELL = density
        rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), device="cpu")  # compiles
        started = time.perf_counter()
        tracers[density] = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), device="cpu", threads=1)
        build_ms = 1e3 * (time.perf_counter() - started)
        result["grids"][density] = {
            "build_ms": build_ms,
            "bytes_per_triangle": tracers[density].bytes / len(faces),
        }
    for kind, (origins, directions) in ray_sets(vertices.min(axis=0), vertices.max(axis=0)).items():
        o, d = (wp.array(x, dtype=wp.vec3, device="cpu") for x in (origins, directions))
        found = wp.empty(len(o), dtype=int, device="cpu")
        times: dict = {name: [] for name in ("peer", *densities)}
        for _ in range(ROUNDS + 1):
            times["peer"].append(seconds(wp.launch, query, len(o), [peer.id, o, d, found], device="cpu"))
            for density in densities:
                times[density].append(seconds(tracers[density].cast, o, d, outputs=("t", "primitive_id")))
        ids = tracers[densities[0]].cast(o, d, outputs="primitive_id").primitive_id.numpy()
        rates = {name: len(o) / np.median(values[1:]) / 1e6 for name, values in times.items()}
        result[kind] = {"mrays_per_s": rates, "same_face": float(np.mean(ids == found.numpy()))}
    return result


def main() -> None:
    """Measures, prints a table, and writes the figures if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+")
    parser.add_argument("--faces-per-cell", default=str(warprt.mesh.FACES_PER_CELL), help="densities, by commas")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    densities = [float(x) for x in options.faces_per_cell.split(",")]
    results = {Path(path).stem: measure(path, densities) for path in options.meshes}
    for name, result in results.items():
        for kind in ("primary", "random"):
            rates = result[kind]["mrays_per_s"]
            ours = "  ".join(f"{d:g}: {rates[d]:.2f} ({rates[d] / rates['peer']:.2f}x)" for d in densities)
            print(f"{name} {result['triangles']} {kind}: wp.Mesh {rates['peer']:.2f} Mrays/s; faces per cell {ours}")
    if options.output:
        about = {"cpu": cpu_name(), "threads": 1, "warp": wp.__version__, "warprt": rt.__version__}
        options.output.write_text(json.dumps({**about, "results": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
