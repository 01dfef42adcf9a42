"""What is too small in a scene is named, and nothing else is."""

import numpy as np
import pytest
import ready
from test_cast import CUBE_FACES, CUBE_VERTICES
from test_grid import sphere_mesh

import warprt as rt
from warprt.cautions import THICKNESS, cautions, face_areas, wall_thickness
from warprt.cli import main
from warprt.scene_files import ready_scenes

EYE = rt.Camera((0, 0, 5), (0, 0, 0))


def found(*objects, device, camera=EYE):
    return cautions(rt.Tracer(rt.Scene(objects, camera=camera), "robust", device))


@pytest.mark.parametrize("name", ready_scenes())
def test_ready_scenes_give_no_cause(name, device):
    assert cautions(rt.Tracer(ready.load(name), "robust", device)) == []


def ball_beside(scale, at=(0, 0, 0)):
    """A ball, of which 32 faces at the poles have no area, and a face that makes the mesh 2,000 wide."""
    vertices, faces = sphere_mesh(8)
    far = [(1000, 0, 0), (-1000, 10, 0), (-1000, 0, 10)]
    return rt.Mesh(
        np.concatenate([scale * vertices + at, far]),
        np.concatenate([faces, [[-3, -2, -1]] + np.array(len(vertices) + 3)]),
    )


def test_faces_that_vanish_in_float32_are_counted(device):
    mesh = ball_beside(1e-6, at=(500, 500, 500))
    has_area, is_lost = face_areas(mesh)
    # Coordinates are rounded to 1024 x 2^-25 = 3e-5, and the ball is 2e-6 across.
    assert is_lost[:-1].sum() == has_area[:-1].sum() == len(mesh.faces) - 1 - 32
    assert has_area[-1]
    assert not is_lost[-1]
    (line,) = found(rt.Sphere(), mesh, rt.Instance(mesh, rt.Transform().translate(5, 0, 0)), device=device)
    assert line.startswith(f"objects[1]: {is_lost.sum():,} of {len(mesh.faces)} faces lose their area")
    assert found(ball_beside(1.0, at=(500, 500, 500)), device=device) == []


def test_slivers_that_become_lines_are_counted(device):
    mesh = rt.Mesh([(-1, -1, 0), (1, 1, 0), (1 / 3, 1 / 3 + 1e-9, 0), (1, -1, 0)], [(0, 1, 2), (0, 1, 3)])
    assert face_areas(mesh)[1].tolist() == [True, False]
    assert "1 of 2 faces" in found(mesh, device=device)[0]


def test_what_never_had_an_area_is_legal_unless_nothing_else_is_there(device):
    poles = rt.Mesh(*sphere_mesh(8))
    assert not face_areas(poles)[0].all()
    line = rt.Mesh([(0, 0, 0), (0.1, 0.2, 0.3), (0.2, 0.4, 0.6)], [(0, 1, 2)])
    assert found(poles, rt.Box((0, 0, 0), (1, 0, 1)), device=device) == []
    first, second = found(line, rt.Box((3, 3, 3), (3, 3, 3)), device=device)
    assert first.startswith("objects[0]: none of 1 faces has an area")
    assert second.startswith("objects[1]: the box is a point")


def test_spheres_beyond_the_resolution_of_float32_rays_are_named(device):
    places = np.tile(np.eye(4), (4, 1, 1))
    places[:, 2, 3] = (0, -1e3, -1e5, -1e6)
    specks = rt.Instances(rt.Sphere(radius=1e-3), places)
    (line,) = found(rt.Sphere(), specks, device=device)
    # An ulp at 1e5 is 2^-23 1e5 = 0.012.
    assert line.startswith("objects[1]: 2 instances; instance 4 is a sphere of radius 0.001, 1e+06 from the camera")
    assert found(rt.Sphere((0, 0, -1e6), 1.0), device=device) == []
    # The eye is near, but both are far from the origin, where coordinates of float32 are 0.06 apart.
    camera = rt.Camera((1e6, 0, 0), (1e6, 0, -1))
    assert "float32 rays are 0.12 apart" in found(rt.Sphere((1e6, 0, -1), 0.01), device=device, camera=camera)[0]


CUBE = rt.Mesh(CUBE_VERTICES, CUBE_FACES)


@pytest.mark.parametrize("shape", [rt.Box(), rt.Sphere(), CUBE], ids=["box", "sphere", "mesh"])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_bound_of_a_wall_is_above_the_offsets_and_near(shape, scale, device, rng):
    m = np.tile(np.eye(4), (30, 1, 1))
    one, other = np.linalg.qr(rng.normal(size=(2, 30, 3, 3)))[0]
    m[:, :3, :3] = scale * (one * np.exp(rng.uniform(-3, 3, (30, 1, 3))) @ other)
    m[:, :3, 3] = scale * rng.uniform(-9, 9, (30, 3)) * np.arange(30)[:, None]
    for k, matrix in enumerate(m):
        tracer = rt.Tracer(rt.Scene([rt.Instance(shape, matrix)]), "robust", device)
        thickness, bound = wall_thickness(tracer._device_scene.placements, slice(0, 1), shape)
        # Onto the middle of the wall across each axis, along the normal there.
        for axis in range(3):
            n = np.linalg.inv(matrix[:3, :3])[axis]
            n /= np.linalg.norm(n)
            p = matrix[:3, axis] + matrix[:3, 3]
            hits = tracer.cast(p + scale * n, -n)
            away = np.abs((hits.spawn(n)[0] - hits.spawn(-n)[0]) @ n) / 2
            assert hits.hit
            # What is measured is rounded with the origin itself.
            rounding = 2.0**-52 * np.abs(p).max()
            assert away <= 1.001 * bound[0, axis] + rounding, k
            assert bound[0, axis] <= 12 * away + rounding, k
            across = 2 * abs(matrix[:3, axis] @ n)
            assert thickness[0, axis] == pytest.approx(across, rel=1e-9)


def test_thin_shapes_are_named(device):
    # Half extents of 1: rays leave a mesh by 32 u = 1.9e-6, seen through the placement.
    places = np.tile(np.eye(4), (3, 1, 1))
    places[:, 0, 3] = (0, 10, 20)
    assert found(rt.Instances(CUBE, places), device=device) == []
    slab = rt.Mesh(np.array(CUBE_VERTICES) * (1, 1, 1e-6), CUBE_FACES)
    (line,) = found(rt.Sphere(), rt.Instances(slab, places), device=device)
    assert line.startswith("objects[1]: 3 instances; instance ")
    assert f"is 2e-06 thick, not {THICKNESS} times the 1.9e-06" in line
    assert found(rt.Box((-1, -1, -1e-6), (1, 1, 1e-6)), device=device) == []
    assert "instance 0 is 2e-16 thick" in found(rt.Box((-1, -1, -1e-16), (1, 1, 1e-16)), device=device)[0]
    # A sheet has no inside that light could leak into.
    assert (
        found(rt.Box((-1, -1, 0), (1, 1, 0)), rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]), device=device)
        == []
    )


def test_audit_says_so(tmp_path, capsys):
    path = tmp_path / "speck.cfg"
    path.write_text("camera { position = (0, 0, 1e6); } sphere { radius = 1e-6; } sphere { radius = 3; }")
    assert main(["audit", str(path), "--device", "cpu"]) == 0
    assert "warning: objects[0]: instance 0 is a sphere of radius 1e-06, 1e+06 from" in capsys.readouterr().out
    scene = rt.Scene([rt.Sphere(), rt.Box()])
    assert rt.audit(scene, rays=1000, device="cpu").warnings == []
    assert "warning" not in str(rt.audit(scene, rays=1000, device="cpu"))
