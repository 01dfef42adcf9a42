"""Where positions in float32 cannot tell features apart, a tracer says so: once, and nowhere else."""

import warnings

import numpy as np
import pytest
import ready
import trimesh
import warp as wp

import warprt as rt
from warprt.scene_files import ready_scenes

UTM = np.array((500_000.0, 5_000_000.0, 30.0))
"""Floats of float32 are 0.5 apart there."""
BALL = trimesh.creation.icosphere(subdivisions=3)
FAR = rt.Transform().translate(*UTM)


def down_at(tracer, **options):
    """One ray straight down."""
    return tracer.cast(UTM + np.array((0.1, 0.2, 30)), (0, 0, -1), **options)


@pytest.mark.parametrize(
    "item, width",
    [
        (rt.Instance(rt.Mesh(BALL.vertices, BALL.faces), FAR), 0.14),
        (rt.Mesh(BALL.vertices + UTM, BALL.faces), 0.14),
        (rt.Instance(rt.Box((0, 0, 0), (1, 1, 1)), FAR), 1),
        (rt.Instance(rt.Box((0, 0, 0), (0.4, 0.3, 90)), FAR), 0.4),
        (rt.Sphere(UTM, 0.4), 0.8),
        (rt.Instance(rt.Cylinder(0.3, 50), FAR), 0.6),
    ],
    ids=["instance", "mesh", "box", "pole", "sphere", "cylinder"],
)
def test_features_are_measured_where_they_are(item, width, device):
    line = rt.Tracer(rt.Scene([rt.Sphere(), item]), "robust", device).spacing.line()
    words = (
        f"positions are float32 in robust and 0.5 apart where instance 1 is, whose features are {width:.2g} wide; use"
    )
    assert line.startswith(words)
    near = rt.Tracer(rt.Scene([rt.Instance(rt.Sphere(), FAR), rt.Box()]), "robust", device)
    assert near.spacing.line() is None, "features of 2, four steps wide"


@pytest.mark.parametrize("accuracy", ["fast", "robust"])
def test_one_warning_names_the_instance_and_the_way_out(accuracy, device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere(), rt.Sphere(UTM, 0.4)]), accuracy, device)
    words = rf"positions are float32 in {accuracy} and 0\.5 apart where instance 1 is"
    with pytest.warns(UserWarning, match=words) as found:
        assert down_at(tracer).hit
    assert len(found) == 1
    assert found[0].filename.endswith("test_spacing.py")
    assert "use accuracy='mixed' or 'double', or move the scene to the origin" in str(found[0].message)
    # Warnings are errors: there is no second one.
    assert down_at(tracer).hit
    tracer.cast_all(UTM, (0, 0, -1))


def test_nothing_is_said_where_positions_are_fine_or_not_asked_for(accuracy, device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere(), rt.Sphere(UTM, 0.4)]), accuracy, device)
    assert down_at(tracer, outputs=("t", "normal")).t == pytest.approx(29.67, abs=0.01)
    tracer.count(UTM, (0, 0, -1))
    # The far instance is in the scene, but not hit.
    assert tracer.cast((0, 0, 5), (0, 0, -1)).t == 4
    assert not tracer.cast((5, 5, 5), (0, 0, 1)).hit
    if accuracy != "robust":
        assert down_at(tracer).hit
        return
    with pytest.warns(UserWarning, match="where instance 1 is"):
        down_at(tracer)


@pytest.mark.parametrize(
    "shape", [rt.Box((-9, -9, 0), (9, 9, 1e-9)), rt.Mesh([(0, 0, 0), (9, 0, 0), (0, 9, 0)], [(0, 1, 2)]), rt.Disk(9)]
)
def test_sheets_are_not_thin(shape, device):
    turned = rt.Transform().rotate(30, (1, 2, 3)).translate(1000, 2000, 3000)
    tracer = rt.Tracer(rt.Scene([rt.Instance(shape, turned)]), device=device)
    assert tracer.spacing.line() is None


def test_instances_that_move_are_judged_anew(device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere(radius=0.2), rt.Sphere((0, 3, 0))]), device=device)
    tracer.cast((0, 0, 5), (0, 0, -1))
    tracer.set_transforms(0, rt.Transform().translate(*UTM).world_from_local)
    tracer.set_transforms(1, rt.Transform().translate(1, 0, 0).world_from_local)
    tracer.cast((1, 3, 5), (0, 0, -1))
    with pytest.warns(UserWarning, match="where instance 0 is, whose features are 0.4 wide"):
        tracer.cast(UTM + np.array((0, 0, 9)), (0, 0, -1))


def test_arrays_on_the_device_are_not_looked_at(device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere(), rt.Sphere(UTM, 0.2)]), device=device)
    o, d = (wp.array([v], dtype=wp.vec3, device=device) for v in ((0, 0, 5), (0, 0, -1)))
    tracer.cast(o, d, outputs="t")
    with pytest.warns(UserWarning, match="where instance 1 is"):
        tracer.cast(o, d)


def test_many_instances_and_what_is_beyond_float32(device):
    places = np.tile(np.eye(4), (40, 1, 1))
    places[:, :3, 3] = UTM + np.arange(40)[:, None]
    scene = rt.Scene([rt.Instances(rt.Sphere(radius=0.1), places), rt.Sphere((0, 0, 1e39), 1e39)])
    line = rt.Tracer(scene, device=device).spacing.line()
    assert "inf apart where instance 40 (and 40 more) is, whose features are 2e+39 wide" in line


@pytest.mark.parametrize("name", ready_scenes())
def test_ready_scenes_give_no_cause(name, device):
    tracer = rt.Tracer(ready.load(name), "robust", device)
    assert tracer.spacing.line() is None


def test_workers_leave_it_to_the_process_that_asks(device):
    from warprt.parcel import make_tracer, recipe_of

    tracer = rt.Tracer(rt.Scene([rt.Sphere(UTM, 0.2)]), device=device)
    other = make_tracer(recipe_of(tracer), tracer.device, 1 << 20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert other.cast(UTM + np.array((0, 0, 9)), (0, 0, -1)).hit


def test_meshes_that_change_are_judged_anew(device):
    mesh = rt.Mesh(BALL.vertices, BALL.faces)
    tracer = rt.Tracer(rt.Scene([mesh]), device=device)
    tracer.cast((0, 0, 5), (0, 0, -1))
    mesh.update(BALL.vertices + UTM)
    with pytest.warns(UserWarning, match=r"where instance 0 is, whose features are 0\.14 wide"):
        down_at(tracer)


def test_the_smallest_feature_counts_and_specks_do_not(device):
    """A large mesh far away with one small face; and with an edge that is shorter than float32 tells apart anywhere."""
    vertices = 20.0 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]) + UTM
    faces = [(0, 1, 2), (1, 3, 2), (4, 5, 6)]
    for width, is_small in ((0.1, True), (1e-9, False)):
        small = UTM + np.array([(5, 5, 1), (5 + width, 5, 1), (5, 5 + 15 * (not is_small) + width, 1)])
        mesh = rt.Mesh(np.concatenate([vertices, small]), faces)
        line = rt.Tracer(rt.Scene([mesh]), device=device).spacing.line()
        assert (line is not None) == is_small
