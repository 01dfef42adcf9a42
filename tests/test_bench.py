"""The benchmarks measure what they say; that they are fast is for them to show, not for a test."""

import json
import re

import numpy as np
import pytest
import trimesh

from warprt.benchmarks import leaks, meshes, rates, rays
from warprt.benchmarks.agreement import agreement
from warprt.benchmarks.engines import Ours
from warprt.cli import main
from warprt.launch import default_threads
from warprt.timing import alternating, ratio


@pytest.mark.parametrize("name", meshes.MAKERS)
@pytest.mark.parametrize("count", [300, 5000])
def test_made_up_meshes_have_about_as_many_triangles_as_asked_for(name, count):
    vertices, faces = meshes.MAKERS[name](count)
    assert len(faces) == pytest.approx(count + (192 if name == "field" else 0), rel=0.15)
    assert vertices.dtype == np.float32
    assert faces.dtype == np.int32
    assert faces.min() >= 0
    assert faces.max() < len(vertices)
    assert np.isfinite(vertices).all()
    area = trimesh.Trimesh(vertices, faces, process=False).area_faces
    assert (area > 0).mean() > 0.99


def test_blob_is_closed_and_faces_outward():
    blob = trimesh.Trimesh(*meshes.blob(3000))
    blob.merge_vertices()
    assert blob.is_watertight
    assert blob.is_winding_consistent
    assert blob.volume == pytest.approx(4.2, rel=0.1)


def test_field_is_wide_and_what_stands_in_it_small():
    vertices, faces = meshes.in_field(meshes.blob(300))
    assert np.ptp(vertices, axis=0)[[0, 2]] == pytest.approx([400, 400])
    assert np.ptp(vertices[faces[:300]].reshape(-1, 3), axis=0).max() == pytest.approx(0.3, rel=1e-5)


def test_rays_are_of_each_kind_and_secondary_ones_start_off_the_surface():
    mesh = meshes.blob(2000)
    sets = rays.ray_sets(mesh, 32)
    assert set(sets) == {"primary", "random", "shadow", "ambient"}
    assert len(sets["primary"]) == len(sets["random"]) == 1024
    for kind in ("shadow", "ambient"):
        assert sets[kind].any_hit
        r = np.linalg.norm(sets[kind].origins, axis=1)
        assert ((r > 0.8) & (r < 1.2)).all()
    # The rays of a ball's surface that leave along its normal meet nothing: nor do most of those about it.
    result = rates.measure(mesh, 32, 1, 1, ["robust"])["rays"]
    assert result["ambient"]["hit"] < 0.3
    assert 0.2 < result["random"]["hit"] <= 1


def test_measure_reports_rates_builds_and_agreement():
    result = rates.measure(meshes.blob(500), 16, 2, 1)
    assert {"warprt robust", "warprt double", "wp.Mesh"} <= set(result["build_ms"])
    assert 40 < result["bytes_per_triangle"]["warprt robust"] < 90
    for kind in result["rays"].values():
        assert all(rate > 0 for rate in kind["mrays_per_s"].values())
        assert kind["agreement"]["wp.Mesh"]["same"] > 0.99
        assert kind["agreement"]["warprt double"]["unexplained"] == 0


def test_agreement_tells_edges_and_ties_from_errors():
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 0, -1), (1, 0, -1), (0, 1, -1)], np.float32)
    mesh = vertices, np.array([(0, 1, 2), (1, 3, 2), (4, 5, 6), (0, 1, 2)], np.int32)
    o = np.array([(0.2, 0.2, 1), (0.5, 0.5, 1), (0.2, 0.2, 1), (0.2, 0.2, 1), (1e-7, 0.5, 1)], np.float32)
    seen = rays.RaySet(o, np.tile(np.float32([0, 0, -1]), (5, 1)))
    found = agreement(mesh, seen, np.array([0, 0, 0, 0, 0]), np.array([0, 1, 2, 3, -1]))
    assert found == {"same": pytest.approx(0.2), "edge": 2, "tie": 1, "unexplained": 1}


def test_rounds_alternate_and_the_first_does_not_count():
    calls = []
    seconds = alternating({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 2)
    assert calls == ["a", "b"] * 3
    assert [len(times) for times in seconds.values()] == [2, 2]
    assert ratio(np.array([4.0, 2.0, 9.0]), np.array([2.0, 2.0, 1.0])) == 2


def test_command_prints_a_table_and_writes_files(tmp_path, capsys):
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=2).export(path)
    files = ["-o", str(tmp_path / "ball.json"), "--plot", str(tmp_path / "ball.png")]
    assert main(["bench", "--quick", "--mesh", str(path), "--field", str(path), "--subdivide", "1", *files]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "wp.Mesh" in lines[1]
    for name in ("ball", "ball / 4", "ball in a field"):
        assert any(line.startswith(f"{name} ") and "primary" in line for line in lines)
    saved = json.loads((tmp_path / "ball.json").read_text())
    assert saved["results"]["ball"]["triangles"] == 320
    assert saved["results"]["ball / 4"]["triangles"] == 1280
    assert {"device", "warprt", "warp-lang", "threads", "commit"} <= set(saved)
    assert (tmp_path / "ball.png").stat().st_size > 5000


@pytest.mark.parametrize(
    "topic, words",
    [
        ("resolution", "auto takes longer by"),
        ("scaling", "cube|power"),
        ("instances", "10,000 instances"),
        ("specialisation", "times as fast"),
        ("all-hits", "warprt double"),
        ("workers", "pool of 2"),
    ],
)
def test_command_measures_each_topic(topic, words, tmp_path, capsys):
    path = tmp_path / "results.json"
    assert main(["bench", topic, "--quick", "--size", "16", "-o", str(path)]) == 0
    assert re.search(words, capsys.readouterr().out)
    saved = json.loads(path.read_text())
    assert saved["topic"] == topic
    assert saved["results"]


@pytest.mark.parametrize("topic", ["scaling", "resolution"])
def test_topics_are_drawn(topic, tmp_path):
    assert main(["bench", topic, "--quick", "--size", "16", "--plot", str(tmp_path / "plot.png")]) == 0
    assert (tmp_path / "plot.png").stat().st_size > 5000


def test_command_refuses_what_it_cannot_do(tmp_path, capsys):
    assert main(["bench", "--mesh", str(tmp_path / "none.ply")]) == 2
    assert main(["bench", "--quick", "-o", str(tmp_path / "no" / "where.json")]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert "none.ply" in errors[0]
    assert "there is no folder" in errors[1]


def test_there_is_no_plot_of_some_topics(tmp_path, capsys):
    path = tmp_path / "nothing.png"
    assert main(["bench", "specialisation", "--quick", "--size", "8", "--plot", str(path)]) == 2
    assert "no plot" in capsys.readouterr().err
    assert not path.exists()


def test_census_of_leaks_finds_none_of_ours(accuracy, device):
    """Rows 5 and 41 to 43 of the conformance matrix: a million rays of each aim, over all meshes and offsets. Exact."""
    counts = leaks.measure({accuracy: 1_000_000}, default_threads(), device, with_peers=False)
    assert set(counts) == {"random", "edge", "vertex"}
    for found in counts.values():
        assert list(found) == [f"warprt {accuracy}"]
        assert found[f"warprt {accuracy}"]["rays"] >= 1_000_000
        assert found[f"warprt {accuracy}"]["leaks"] == 0


def test_census_command_casts_as_many_rays_as_each_accuracy_asks_for(tmp_path, capsys):
    path = tmp_path / "leaks.json"
    options = ["--rays", "5000", "--accuracy", "robust,fast,double:2e3", "-o", str(path)]
    assert main(["bench", "leaks", *options]) == 0
    assert "warprt double" in capsys.readouterr().out
    for found in json.loads(path.read_text())["results"].values():
        assert found["warprt robust"]["rays"] == found["warprt fast"]["rays"] == found["wp.Mesh"]["rays"] == 5019
        assert found["warprt double"]["rays"] == 2016
        assert found["warprt robust"]["leaks"] == found["warprt double"]["leaks"] == 0


@pytest.mark.parametrize("accuracy", ["robust:many", "robust:inf", "robust:", "best", "robust:0"])
def test_census_command_refuses_what_it_cannot_do(accuracy, capsys):
    assert main(["bench", "leaks", "--rays", "1000", "--accuracy", accuracy]) == 2
    assert "accuracy" in capsys.readouterr().err or accuracy.endswith("0")


def test_census_counts_the_rays_that_leak():
    mesh = leaks.at(leaks.cube(), (0, 0, 0))
    opened = mesh[0], mesh[1][1:]
    rays = leaks.aimed(mesh, (0, 0, 0), "random", 3000, np.random.default_rng(0))
    counts = {}
    leaks._add(counts, Ours(opened, 1), rays)
    (found,) = counts.values()
    assert found["rays"] == 3000
    # One of twelve triangles is missing.
    assert 100 < found["leaks"] < 500


@pytest.mark.parametrize("name", leaks.MESHES)
@pytest.mark.parametrize("offset", leaks.OFFSETS.values())
def test_meshes_of_the_census_are_closed(name, offset):
    vertices, faces = leaks.at(leaks.MESHES[name](), offset)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    around = leaks.aimed((vertices, faces), offset, "vertex", 100, np.random.default_rng(0))
    assert np.isfinite(around.directions).all()
