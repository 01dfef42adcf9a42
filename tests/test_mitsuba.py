"""The comparison with Mitsuba 3: that it finds agreement, and that it would find the lack of it."""

from dataclasses import replace

import numpy as np
import pytest

import warprt as rt
from warprt.benchmarks import against_mitsuba, shared_scenes, to_mitsuba
from warprt.cli import main

FLOOR = rt.Instance(rt.Box((-9, -1, -9), (9, 0, 9)), material=rt.Material((0.5, 0.25, 1)))
ABOVE = rt.Camera((0, 5, 0.01), (0, 0, 0))
BALL = rt.Sphere(radius=1)


@pytest.fixture
def needs_mitsuba():
    pytest.importorskip("mitsuba", reason="Mitsuba is an optional peer")


def test_shared_scenes_are_sheared_and_mirrored():
    for make in shared_scenes.SCENES.values():
        matrices = np.concatenate([item.world_from_local for item in make().objects if isinstance(item, rt.Instances)])
        linear = matrices[:, :3, :3]
        assert (np.linalg.det(linear) < 0).mean() == pytest.approx(0.5)
        squares = np.swapaxes(linear, 1, 2) @ linear
        assert (np.abs(squares[:, [0, 0, 1], [1, 2, 2]]).max(axis=1) > 1e-3).all()


def test_rays_of_pixels_are_those_of_the_camera():
    o, d = against_mitsuba.camera_rays(ABOVE, 8, 6)
    expected = ABOVE.rays(8, 6)
    np.testing.assert_array_equal(o, np.float32(expected[0]).reshape(-1, 3))
    np.testing.assert_allclose(d, expected[1].reshape(-1, 3), rtol=0, atol=1e-7)


def test_differing_hits_are_counted_by_kind():
    tracer = rt.Tracer(rt.Scene([BALL]), device="cpu")
    d = np.array([(0, 0, -1.0)] * 6)
    o = np.array([(0, 0, 5), (0, 0, 5), (0, 0, 5), (0, 0, 5), (3, 0, 5), (1 - 1e-7, 0, 5)], np.float32)
    t = np.array([4, 4 + 2e-4, 6, 4.5, np.inf, np.inf])
    normal = np.array([(0, 0, 1), (0, 0, 1), (0, 0, -1), (0, 0, 1), (0, 0, 0), (0, 0, 0)])
    found = against_mitsuba.compare_hits(tracer, o, d, t, normal)
    assert found["depth"] == pytest.approx(2 / 6)
    assert found["differ"] == {"edge": 1, "rounding": 1, "through": 1, "other": 1}


def test_pictures_are_compared_by_means_and_pixels():
    theirs = np.full((4, 3), 0.5)
    ours = theirs * np.array([[1.005], [1], [1.1], [0.9]])
    found = against_mitsuba.compare_pictures(ours, theirs)
    assert found["same"] == 0.5
    assert found["mean_differs"] == pytest.approx(0.00125)
    assert found["pixels_differ"] == pytest.approx(0.05125)


@pytest.mark.parametrize("make", [shared_scenes.solids, shared_scenes.mesh])
def test_both_agree_and_a_moved_lamp_or_shape_is_noticed(make, needs_mitsuba):
    scene = make(8)
    found = against_mitsuba.measure(scene, (48, 36), 1)
    for hits in found["hits"].values():
        assert min(hits["depth"], hits["normal"]) > 0.998
    for light in found["light"].values():
        assert light["mean_differs"] < 0.01
    o, d = against_mitsuba.camera_rays(scene.camera, 48, 36)
    theirs = to_mitsuba.MitsubaScene(scene).cast(o, d)
    moved = [
        replace(item, world_from_local=item.world_from_local * 1.02 / [1, 1, 1, 1.02]) for item in scene.objects[:1]
    ]
    other = rt.Tracer(replace(scene, objects=[*moved, *scene.objects[1:]]), device="cpu")
    assert against_mitsuba.compare_hits(other, o, d, *theirs)["depth"] < 0.99


def test_rectangle_is_as_bright_there(needs_mitsuba):
    lamp = rt.RectangleLight((4, 6, 0), (2, 0, 1), (-0.5, 0, 1), (3, 4, 5))
    found = against_mitsuba.compare_light(rt.Scene([FLOOR], [lamp], ABOVE), (16, 12), 256)
    assert found["mean_differs"] < 0.01
    assert found["pixels_differ"] < 0.03


@pytest.mark.parametrize(
    "scene, words",
    [
        (rt.Scene([rt.Cone()]), "Mitsuba has no Cone"),
        (rt.Scene([BALL], [rt.AmbientLight()]), "Mitsuba has no AmbientLight"),
        (rt.Scene([BALL], [rt.PointLight((0, 3, 0))]), "falloff"),
        (rt.Scene([rt.Instance(BALL, material=rt.Material(0, mirror=1))]), "just scatter evenly"),
    ],
)
def test_what_has_no_counterpart_is_named(scene, words, needs_mitsuba):
    with pytest.raises(ValueError, match=words):
        to_mitsuba.MitsubaScene(scene)


def test_command_says_how_to_get_mitsuba(monkeypatch, capsys):
    monkeypatch.setattr(to_mitsuba.importlib.util, "find_spec", lambda name: None)
    assert main(["bench", "mitsuba", "--quick"]) == 2
    assert "pip install 'warprt[bench]'" in capsys.readouterr().err


def test_command_compares_three_scenes(capsys, needs_mitsuba):
    assert main(["bench", "mitsuba", "--quick", "--size", "16"]) == 0
    out = capsys.readouterr().out
    for words in ("solids: 181 instances, 192 pixels", "mesh: 251", "RectangleLight"):
        assert words in out
