"""What `measure`, `audit` and the commands on top of them say."""

import json
from pathlib import Path

import exact
import numpy as np
import pytest
import trimesh
from exact import exactly

import warprt as rt
from warprt.audit import _predictions
from warprt.cli import main
from warprt.measure import as_table, errors, sample_rays
from warprt.tracer import TIERS

BALL = trimesh.creation.icosphere(subdivisions=3)
MESH = rt.Mesh(BALL.vertices, BALL.faces)


def turned(*stretch, to=(0, 0, 0)):
    return rt.Transform().scale(*stretch).rotate(33, (1, 2, 3)).translate(*to)


SCENES = {
    "mesh": [MESH],
    "far mesh": [rt.Instance(MESH, turned(1, 1, 1, to=(1e4, -3e4, 2e4)))],
    "ill mesh": [rt.Instance(MESH, turned(1, 1e3, 1e-3))],
    "tiny": [rt.Instance(MESH, turned(1e-6, 2e-6, 1e-6))],
    "huge": [rt.Instance(MESH, turned(1e7, 2e7, 3e7))],
    "slivers": [rt.Mesh(BALL.vertices * (1, 1e-3, 1), BALL.faces)],
    "spheres": [rt.Sphere((x, 0, 0), 0.5) for x in range(5)],
    "planet": [rt.Sphere((0, -6.4e6, 0), 6.4e6), rt.Box((-1, 0, -1), (1, 2, 1))],
    "boxes": [rt.Instance(rt.Box(), turned(1, 2, 0.5, to=(3 * k, 0, 0))) for k in range(4)],
    "everything": [rt.Instance(MESH, turned(1, 2, 1)), rt.Sphere((3, 0, 0)), rt.Box((-4, -1, -1), (-3, 1, 1))],
}


@pytest.fixture(scope="module")
def measured():
    return rt.measure(rt.Scene(SCENES["everything"]), rays=20_000, rounds=1, device="cpu")


def test_measure_tells_tiers_apart(measured):
    assert list(measured) == list(TIERS)
    robust, mixed, double = (measured[name] for name in ("robust", "mixed", "double"))
    for m in measured.values():
        assert m.ns_per_ray > 0
        assert m.false_hits + m.false_misses + m.other_primitives < 1e-3
        assert m.self_hits == 0
        assert m.picture < 1e-3
        assert list(m.t_ulps.values()) == sorted(m.t_ulps.values())
    assert 0.01 < robust.t_ulps["p50"] <= 0.5 < robust.t_ulps["max"]
    assert 0 < double.t_ulps["max"] < 1e-4
    assert 0 < mixed.t_ulps["max"] < 1e-4
    assert 1e-9 < robust.bound < 1e-5
    assert 1e-17 < double.bound < 1e-12
    assert np.isnan(measured["fast"].bound)
    assert robust.bound_violations == mixed.bound_violations == double.bound_violations == 0


def test_table_has_a_line_for_each_tier(measured):
    assert [line.split()[0] for line in as_table(measured).splitlines()[1:]] == list(TIERS)


def test_errors_count_what_is_wrong():
    scene = rt.Scene(SCENES["everything"])
    tracer = rt.Tracer(scene, "double", "cpu")
    o, d = sample_rays(tracer, 5000)
    truth, found = tracer.cast(o, d), rt.Tracer(scene, "double", "cpu").cast(o, d)
    hit = np.flatnonzero(truth.hit)
    found.hit[hit[:50]] = False
    found.hit[np.flatnonzero(~truth.hit)[:30]] = True
    found.primitive_id[hit[50:70]] += 1
    found.t[hit[70]] *= 1 + 2.0**-20
    counted = errors(tracer, found, truth, o, d)
    assert counted["false_misses"] == 50 / len(o)
    assert counted["false_hits"] == 30 / len(o)
    assert counted["other_primitives"] == 20 / len(o)
    assert 4 <= counted["t_ulps"]["max"] <= 16
    assert counted["bound_violations"] > 0


def test_scene_that_nothing_hits_is_an_error(device):
    with pytest.raises(ValueError, match="none of them hit"):
        rt.measure(rt.Scene([]), device=device)


def true_errors(tracer, scene, o, d, hits):
    """|t - t*| |d| of hits on meshes, boxes and spheres, to far more digits than the tier has."""
    found = []
    items = [item if isinstance(item, rt.Instance) else rt.Instance(item) for item in scene.objects]
    places = [exact.Placement(item.transform.world_from_local) for item in items]
    for k in np.flatnonzero(hits.hit):
        i, t = hits.instance_id[k], exactly(hits.t[k])
        ray, shape = places[i].ray_to_local(exactly(o[k]), exactly(d[k])), items[i].shape
        if isinstance(shape, rt.Mesh):
            corners = exactly(shape.vertices[shape.faces[hits.primitive_id[k]]])
            error = t - exact.face_parameter(*ray, corners)
        elif isinstance(shape, rt.Sphere):
            x = exact.minus([a + t * b for a, b in zip(*ray, strict=True)], exactly(shape.center))
            error = (exact.dot(x, x) - exactly(shape.radius) ** 2) / (2 * exact.dot(x, ray[1]))
        else:
            walls = [
                (exactly(wall[a]) - ray[0][a]) / ray[1][a]
                for wall in (shape.lower, shape.upper)
                for a in range(3)
                if ray[1][a]
            ]
            error = min((t - wall for wall in walls), key=abs)
        found.append(float(abs(error)) * np.linalg.norm(d[k].astype(float)))
    return np.array(found)


@pytest.mark.parametrize("name", SCENES)
def test_prediction_is_not_below_the_error_nor_far_above(name, device):
    scene = rt.Scene(SCENES[name])
    tracers = {accuracy: rt.Tracer(scene, accuracy, device) for accuracy in TIERS}
    predicted, predicted_position = _predictions(tracers, 20_000)
    # Other rays than those of the prediction.
    o, d = sample_rays(tracers["double"], 800, seed=1)
    for accuracy, tracer in tracers.items():
        hits = tracer.cast(o, d)
        assert hits.hit.sum() > 100
        error = np.quantile(true_errors(tracer, scene, o, d, hits), 0.99)
        assert error <= predicted[accuracy] <= 10 * error
        bound = tracer.cast(o, d, outputs=("hit", "position_error"))
        if accuracy != "fast":
            most = np.quantile(bound.position_error[bound.hit], 0.99)
            assert 0.01 * most < predicted_position[accuracy] < 10 * most


def test_audit_reads_the_scene(device):
    mesh = rt.Mesh([(0, 0, 0), (1, 0, 0), (0.5, 1e-4, 0), (0, 1, 0)], [(0, 1, 2), (0, 1, 3)])
    objects = [rt.Instance(mesh, rt.Transform().scale(1, 1, 4)), rt.Sphere((0, 0, 10), 0.25)]
    camera = rt.Camera((0, 0, 60), (0, 0, 0))
    found = rt.audit(rt.Scene(objects, camera=camera), device=device)
    assert found.condition == pytest.approx(4)
    assert found.slivers == 1
    assert found.smallest_feature == pytest.approx(0.25)
    assert found.distance_over_radius == pytest.approx(200)
    assert found.largest_coordinate == pytest.approx(10.25, rel=1e-5)
    assert len(found.cells) == 1
    assert found.tolerance == pytest.approx(1e-6 * found.extent)


def test_audit_recommends_the_cheapest_that_keeps_the_tolerance(device):
    scene = rt.Scene(SCENES["mesh"])
    predicted = rt.audit(scene, device=device).predicted
    assert predicted["fast"] > predicted["double"]
    for tolerance, expected in ((1.0, "fast"), (1e-10, "mixed"), (1e-30, None)):
        assert rt.audit(scene, tolerance, device=device).recommended == expected
    with pytest.raises(ValueError, match="tolerance must be positive"):
        rt.audit(scene, 0.0, device=device)


def test_audit_judges_positions_far_from_the_origin(device):
    ball = rt.Mesh(BALL.vertices, BALL.faces)
    camera = rt.Camera((500_000, 5_000_000, 60), (500_000, 5_000_000, 30))
    far = rt.Scene([rt.Instance(ball, rt.Transform().translate(500_000, 5_000_000, 30))], camera=camera)
    found = rt.audit(far, tolerance=1e-3, rays=2000, device=device)
    # t is right, and the point half a step of float32, which is 0.5 there, off the mark.
    assert found.predicted["robust"] < 1e-3
    assert 0.2 < found.predicted_position["robust"] < 2
    assert found.predicted_position["mixed"] < 1e-7
    assert found.recommended == "mixed"
    (line,) = found.warnings
    assert line.startswith("positions are float32 in robust and 0.5 apart where instance 0 is, whose features are 0.")
    assert "robust   99 % of hits within " in str(found)
    assert f"positions within {found.predicted_position['robust']:.2g}" in str(found)


def test_audit_command(capsys):
    assert main(["audit", "ellipsoids", "--tolerance", "1e-9", "--device", "cpu"]) == 0
    assert "for a tolerance of 1e-09: mixed" in capsys.readouterr().out


MIRROR_BALL = """
import warprt as rt


def scene():
    material = rt.Material(diffuse=(0.5, 0.5, 0.5), mirror=(0.4, 0.4, 0.4))
    ball = rt.load_scene("ball.ply").objects[0].shape
    return rt.Scene([rt.Instance(ball, material=material)], [rt.DirectionalLight((1, 1, 1))])
"""


def test_tradeoff_command(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    BALL.export("ball.ply")
    Path("mirror.py").write_text(MIRROR_BALL)
    path, plot = tmp_path / "t.json", tmp_path / "t.png"
    options = ["--rays", "2000", "--rounds", "1", "--device", "cpu", "-o", str(path), "--plot", str(plot)]
    assert main(["tradeoff", "mirror.py", "--accuracy", "fast,robust", *options]) == 0
    out = capsys.readouterr().out
    # Peers, as all of it is meshes.
    for word in ("robust", "samples", "max_bounces", "same_bits", "jumps", "float32 normalised", "wp.Mesh"):
        assert word in out
    results = json.loads(path.read_text())["results"]
    assert set(results["tiers"]) == {"fast", "robust"}
    assert all(entry["same_bits"] for entry in results["grid"].values())
    assert set(results["jumps"]) == {"on", "off"}
    assert all(entry["same_bits"] for entry in results["jumps"].values())
    assert set(results["directions"]) == {"float32", "float64"}
    assert plot.stat().st_size > 5000
