"""Scene files of the course."""

import numpy as np
import pytest

import warprt as rt
from warprt.file_rules import FileRules

EXAMPLE = """
camera { position = (0, 1, 5); target = (0, 0, 0); fov = 45; }        // also # and /* */ comments
point_light { position = (5, 5, 5); color = (1, 1, 1); }
material red { diffuse = (0.8, 0.1, 0.1); }
# a definition
sphere ball { center = (0, 0, 0); radius = 1; }
axis_aligned_box block { min = (-1, -1, -1); max = (1, 1, 1); }
triangle_mesh bunny { file = "bunny.off"; grid_acceleration = true; grid_resolution = (8,8,8); }
geometry_instance { geometry = bunny; material = red; scale = (1, 2, 1); rotate = (30, 0, 1, 0);
                    translate = (0, 0, -2); }
geometry_instance { geometry = ball; translate = (1.5e0, -.5, +2.f); } /* two
lines */
sphere { radius = 0.25; material = red; }
"""
MESH = "OFF\n4 2 0\n10 10 10\n14 10 10\n10 12 10\n10 10 11\n3 0 1 2\n3 0 1 3\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "bunny.off").write_text(MESH)
    return tmp_path


def load(folder, text):
    (folder / "scene.cfg").write_text(text)
    return rt.load_scene(folder / "scene.cfg")


def test_example_of_the_documentation(folder):
    scene = load(folder, EXAMPLE)
    bunny, ball, small = scene.objects
    assert scene.camera.fov_deg == 45
    assert [type(light) for light in scene.lights] == [rt.PointLight]
    assert bunny.shape.grid == (8, 8, 8)
    assert bunny.material == small.material == rt.Material((0.8, 0.1, 0.1))
    assert ball.transform == rt.Transform().translate(1.5, -0.5, 2)
    assert (ball.material, small.shape.radius) == (None, 0.25)


def test_mesh_can_be_smooth(folder):
    plain, smooth = load(
        folder, 'triangle_mesh { file = "bunny.off"; } triangle_mesh { file = "bunny.off"; smooth = true; }'
    ).objects
    assert plain.shape.normals is None
    np.testing.assert_array_equal(smooth.shape.normals, plain.shape.smooth().normals)


def test_round_shapes(folder):
    scene = load(
        folder,
        "cylinder { radius = 2; height = 3; center = (1, 2, 3); } cone { } capsule { radius = 0.5; height = 4; } "
        "disk rim { radius = 5; } geometry_instance { geometry = rim; translate = (0, 0, 1); }",
    )
    cylinder, cone, capsule, disk = (item.shape for item in scene.objects)
    assert (cylinder.radius, cylinder.height, cylinder.center.tolist()) == (2, 3, [1, 2, 3])
    assert (type(cone), cone.radius, cone.height) == (rt.Cone, 1, 2)
    assert (type(capsule), capsule.radius, capsule.height) == (rt.Capsule, 0.5, 4)
    assert (type(disk), disk.radius) == (rt.Disk, 5)
    with pytest.raises(ValueError, match=r"1:1: Cone height must be positive; got -1"):
        load(folder, "cone { height = -1; }")
    with pytest.raises(ValueError, match=r"cone has no 'size'; it has radius, height, center"):
        load(folder, "cone { size = 1; }")


def test_statements_of_an_instance_act_in_the_order_written(folder):
    scene = load(
        folder,
        "sphere s { } geometry_instance { geometry = s; translate = (1, 0, 0); rotate = (90, 0, 0, 2); scale = 2; "
        "translate = (0, 0, 5); }",
    )
    expected = rt.Transform().translate(1, 0, 0).rotate(90, (0, 0, 1)).scale(2).translate(0, 0, 5)
    assert scene.objects[0].transform == expected


def test_transform_is_column_major(folder):
    numbers = "1, 2, 3, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1"
    scene = load(folder, f"sphere s {{ }} geometry_instance {{ geometry = s; transform = ({numbers}); }}")
    expected = rt.Transform.from_columns((1, 2, 3, 0), (0, 1, 0, 0), (0, 0, 1, 0), (4, 5, 6, 1))
    assert scene.objects[0].transform == expected


def test_mesh_is_put_into_the_unit_cube_unless_told_otherwise(folder):
    fitted, raw = (
        load(folder, f'triangle_mesh {{ file = "bunny.off"; {option} }}').objects[0].shape.bounds
        for option in ("", "unit_cube = false;")
    )
    np.testing.assert_array_equal(fitted, [(0, 0, 0), (1, 0.5, 0.25)])
    np.testing.assert_array_equal(raw, [(10, 10, 10), (14, 12, 11)])


def test_grid_can_be_turned_off(folder):
    text = 'triangle_mesh { file = "bunny.off"; grid_acceleration = false; grid_resolution = (8, 8, 8); }'
    assert load(folder, text).objects[0].shape.grid is None


def test_named_shape_is_drawn_only_through_an_instance(folder):
    assert load(folder, "sphere s { }").instance_count == 0


def test_definitions_may_follow_their_use(folder):
    text = "geometry_instance { geometry = s; material = m; } sphere s { } material m { diffuse = 0.5; }"
    assert load(folder, text).objects[0].material.diffuse == (0.5, 0.5, 0.5)


def test_sky_and_other_lights(folder):
    scene = load(
        folder,
        "background { horizon = (1, 1, 1); zenith = (0, 0, 1); } ambient_light { color = 0.1; } "
        "directional_light { direction = (0, -1, 0); } plane { point = (0, -1, 0); normal = (0, 1, 0); };",
    )
    assert scene.background == rt.GradientSky((1, 1, 1), (0, 0, 1))
    assert {type(light) for light in scene.lights} == {rt.AmbientLight, rt.DirectionalLight}


def test_other_cameras(folder):
    place = "position = (1, 2, 3); target = (0, 0, 1); up = (0, 0, 1);"
    pose = (1, 2, 3), (0, 0, 1), (0, 0, 1)
    rotation = "1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 4, 5, 6, 1"
    extrinsic = [(1, 0, 0, 4), (0, 0, -1, 5), (0, 1, 0, 6), (0, 0, 0, 1)]
    for text, expected in {
        f"orthographic_camera {{ {place} height = 5; }}": rt.OrthographicCamera(*pose, height=5),
        f"fisheye_camera {{ {place} fov = 200; }}": rt.FisheyeCamera(*pose, fov_deg=200),
        f"equirectangular_camera {{ {place} }}": rt.EquirectangularCamera(*pose),
        f"matrix_camera {{ intrinsic = (9, 0, 0, 1, 8, 0, 3, 2, 1); extrinsic = ({rotation}); size = (6, 4); }}": (
            rt.MatrixCamera([(9, 1, 3), (0, 8, 2), (0, 0, 1)], extrinsic, (6, 4))
        ),
    }.items():
        camera = load(folder, text).camera
        assert type(camera) is type(expected)
        for found, wanted in zip(camera.rays(6, 4), expected.rays(6, 4), strict=True):
            np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    "text, place, words",
    [
        pytest.param("sphere { radius = 1 }", "1:21", "expected ';'; got '}'", id="missing semicolon"),
        pytest.param("sphere {\n  radius = ;\n}", "2:12", "expected", id="missing value"),
        pytest.param("sphere { radius = 1;", "1:21", "end of the file", id="missing brace"),
        pytest.param("sphere { radius = $; }", "1:19", "unexpected '$'", id="strange character"),
        pytest.param("\n\ncube { }", "3:1", "unknown block 'cube'", id="unknown block"),
        pytest.param("sphere { size = 1; }", "1:1", "sphere has no 'size'; it has center, radius", id="unknown key"),
        pytest.param("sphere { radius = 1; radius = 2; }", "1:22", "given twice", id="key twice"),
        pytest.param('background { color = 1; picture = "x.png"; }', "1:1", "one of color, horizon", id="two skies"),
        pytest.param("background { color = 1; rotation = 3; }", "1:1", "for a picture only", id="sky turned"),
        pytest.param('background { folder = "x"; }', "1:14", "background has no 'folder'", id="folder"),
        pytest.param("sphere { radius = -1; }", "1:1", "radius must be positive", id="bad value"),
        pytest.param("sphere { center = (0, 0); }", "1:1", "center", id="two numbers"),
        pytest.param("sphere { center = red; }", "1:1", "center", id="name for numbers"),
        pytest.param("axis_aligned_box { min = (0, 0, 0); }", "1:1", "needs max", id="missing key"),
        pytest.param("material { diffuse = 1; }", "1:1", "needs a name", id="unnamed material"),
        pytest.param("sphere s { } sphere s { }", "1:14", "defined twice", id="shape twice"),
        pytest.param("sphere { material = blue; }", "1:1", "no material 'blue'", id="unknown material"),
        pytest.param("geometry_instance { }", "1:1", "needs a geometry", id="no geometry"),
        pytest.param("geometry_instance { geometry = x; }", "1:21", "no geometry 'x'", id="unknown geometry"),
        pytest.param(
            "sphere s {}\ngeometry_instance { geometry = s;\n scale = (1, 0, 1); }", "3:2", "zero", id="scale 0"
        ),
        pytest.param("sphere s {} geometry_instance { geometry = s; rotate = 4; }", "1:47", "rotate", id="rotate"),
        pytest.param("sphere s {} geometry_instance { geometry = s; spin = 4; }", "1:47", "no 'spin'", id="spin"),
        pytest.param("sphere s {} geometry_instance { geometry = s; transform = (1, 2); }", "1:47", "16", id="not 16"),
        pytest.param("camera { position = (0, 5, 0); }", "1:1", "parallel", id="camera"),
        pytest.param("orthographic_camera { fov = 4; }", "1:1", "has position, target, up, height", id="fov"),
        pytest.param("fisheye_camera { position = (0, 0, 5); fov = 400; }", "1:1", "at most 360", id="fisheye"),
        pytest.param(
            "matrix_camera { intrinsic = 1; extrinsic = 2; size = (6, 4); }", "1:1", "of 9 and", id="no matrices"
        ),
        pytest.param('triangle_mesh { file = "none.ply"; }', "1:1", "there is no file", id="missing mesh"),
        pytest.param("triangle_mesh { file = bunny; }", "1:1", "string", id="file not quoted"),
        pytest.param('triangle_mesh { file = "bunny.off"; grid_resolution = (8, 8); }', "1:1", "3 whole", id="two"),
        pytest.param(
            'triangle_mesh { file = "bunny.off"; grid_resolution = (1e999, 1, 1); }', "1:1", "whole", id="inf"
        ),
        pytest.param('sphere { radius = "5"; }', "1:1", "radius", id="text for a number"),
        pytest.param('triangle_mesh { file = "bunny.off"; unit_cube = 1; }', "1:1", "true or false", id="flag"),
        pytest.param('triangle_mesh { file = "scene.cfg"; }', "1:1", "cannot read", id="not a mesh"),
    ],
)
def test_error_names_file_line_and_column(folder, text, place, words):
    with pytest.raises((ValueError, OSError)) as caught:
        load(folder, text)
    assert str(caught.value).startswith(f"{folder / 'scene.cfg'}:{place}: ")
    assert words in str(caught.value)


def test_two_cameras_are_an_error(folder):
    with pytest.raises(ValueError, match="at most one camera"):
        load(folder, "camera { position = (0, 1, 5); } camera { position = (0, 2, 5); }")
    with pytest.raises(ValueError, match="at most one camera"):
        load(folder, "camera { position = (0, 1, 5); } fisheye_camera { position = (0, 2, 5); }")


def test_binary_file_is_an_error(folder):
    (folder / "scene.cfg").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="UTF-8"):
        rt.load_scene(folder / "scene.cfg")


def test_byte_order_mark_is_no_text(folder):
    assert load(folder, "\ufeffsphere { }").instance_count == 1


def test_backslashes_part_folders(folder):
    """As in any other file; one that has a backslash in its name is taken first."""
    (folder / "below").mkdir()
    (folder / "below" / "box.off").write_text(MESH)
    (folder / "scene.cfg").write_text("sphere { }")
    rules = FileRules(folder / "scene.cfg")
    assert rules.file("below\\box.off", (".off",), "file") == folder / "below" / "box.off"
    (folder / "below\\box.off").write_text(MESH)
    assert rules.file("below\\box.off", (".off",), "file") == folder / "below\\box.off"
