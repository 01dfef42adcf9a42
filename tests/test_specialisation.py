"""A scene pays only for what it contains: the generated code is read."""

import re
import subprocess
import sys
import warnings
from dataclasses import fields, replace
from pathlib import Path

import pytest
import warp as wp

import warprt as rt
from warprt.kernels.cast import make_cast, make_cast_packets, make_occluded, make_occluded_packets, make_spawn
from warprt.kernels.film import make_settle
from warprt.kernels.pixels import make_albedo, make_effort
from warprt.kernels.render import make_render
from warprt.kernels.spec import Look, Projection, ShapeKind, Spec, Stored, Tier
from warprt.kernels.walk import make_walk_cells

WORDS = {
    ShapeKind.SPHERE: "roots_sphere",
    ShapeKind.BOX: "roots_box",
    ShapeKind.PLANE: "root_plane",
    ShapeKind.MESH: "edge_weights",
    ShapeKind.CYLINDER: "roots_cylinder",
    ShapeKind.CONE: "roots_cone",
    ShapeKind.CAPSULE: "roots_capsule",
    ShapeKind.DISK: "root_disk",
}


def source(kernel, tmp_path, **options):
    """The C++ or CUDA source that Warp generates for a kernel."""
    with warnings.catch_warnings():
        # For a CPU, Warp warns that the code is for this one.
        warnings.simplefilter("ignore")
        paths = wp.compile_aot_module(kernel.module, module_dir=tmp_path, strip_hash=False, **options)
    assert all(Path(path).is_file() for path in paths)
    text = "".join(path.read_text() for path in tmp_path.iterdir() if path.suffix in (".cpp", ".cu"))
    # Comments repeat the Python source, docstrings and all.
    return re.sub(r"//[^\n]*", "", text)


@pytest.mark.parametrize("kind", list(ShapeKind))
def test_absent_shapes_leave_no_code_behind(kind, tier, tmp_path):
    text = source(make_cast(Spec(tier, frozenset([kind]), instance_grid=False), Stored.BRIEF), tmp_path, device="cpu")
    assert WORDS[kind] in text
    for other in ShapeKind:
        assert (WORDS[other] in text) == (other == kind)
    assert ("corner" in text) == (kind == ShapeKind.MESH)
    # What counts cells and tests is in a kernel of its own.
    assert "effort" not in text.lower()


def test_points_and_normals_leave_no_code_behind_unless_asked_for(tmp_path):
    spec = Spec(Tier.ROBUST, frozenset([ShapeKind.SPHERE]))
    text = {}
    for stored in Stored:
        (tmp_path / stored.name).mkdir()
        text[stored] = source(make_cast(spec, stored), tmp_path / stored.name, device="cpu")
    assert ["normal_to_world" in text[stored] for stored in Stored] == [False, True, True]
    assert ["position_error" in text[stored] for stored in Stored] == [False, False, True]


FEATURES = {
    "ambient": ("ambient",),
    "point_lights": ("point_position",),
    "directional_lights": ("sun_direction",),
    "mirrors": ("mirror",),
    "gradient_sky": ("zenith",),
    "textures": ("texture_number",),
    "image_sky": ("sky_texture", "sky_turn"),
    "paths": ("cosine_direction", "survivor"),
    "vertex_colors": ("color_of",),
    "rectangle_lights": ("rectangle_u", "rectangle_position"),
    "spot_lights": ("spot_cone", "spot_share"),
    "glass": ("through_glass", "absorption", "transmitted"),
    "emission": ("emission",),
    "shown_lamps": ("shines",),
    "highlights": ("highlight", "to_eye", "shininess"),
    "smooth_normals": ("shading_normal", "interpolated"),
}
OF_MESHES = ("textures", "vertex_colors", "smooth_normals")


@pytest.mark.parametrize("feature", [None, *FEATURES])
def test_absent_features_of_shading_leave_no_code_behind(feature, tmp_path):
    shape = ShapeKind.MESH if feature in OF_MESHES else ShapeKind.SPHERE
    spec = Spec(Tier.ROBUST, frozenset([shape]), instance_grid=False)
    look = Look(spec, **({feature: True} if feature else {}))
    text = source(make_render(look), tmp_path, device="cpu")
    for name, words in FEATURES.items():
        for word in words:
            assert (word in text) == (name == feature)
    for word in ("texel", "bilinear"):
        assert (word in text) == (feature in ("textures", "image_sky"))
    for word in ("max_bounces", "throughput"):
        assert (word in text) == (feature in ("mirrors", "glass", "paths"))
    assert ("bounce" in text) == (feature in ("mirrors", "glass", "paths", "rectangle_lights"))
    assert ("attributes" in text) == (feature in OF_MESHES)
    assert ("chance" in text) == (feature in ("glass", "rectangle_lights", "paths"))
    # Only kernels that measure have these.
    assert "spread" not in text and "noise" not in text
    assert ("reflected" in text) == (feature in ("mirrors", "glass"))
    assert "effort" not in text.lower()


@pytest.mark.parametrize("projection", list(Projection))
def test_absent_projections_leave_no_code_behind(projection, tmp_path):
    look = Look(Spec(Tier.ROBUST, frozenset(), instance_grid=False))
    text = source(make_render(look, projection), tmp_path, device="cpu")
    for other in Projection:
        assert (f"ray_{other.value}" in text) == (other == projection)
    is_plane = projection in (Projection.PINHOLE, Projection.ORTHOGRAPHIC)
    assert ("wp::sin(" in text) == ("forward" in text and not is_plane) == (not is_plane)


PLAIN_HASH = """
import sys
for name in sys.argv[1:]:
    __import__(name)
from warprt.kernels.cast import make_cast
from warprt.kernels.render import make_render
from warprt.kernels.spec import Look, ShapeKind, Spec, Stored, Tier
spec = Spec(Tier.ROBUST, frozenset([ShapeKind.SPHERE]))
kernels = make_render(Look(spec, point_lights=True)), make_cast(spec, Stored.FULL)
print(*(kernel.module.get_module_identifier(1) for kernel in kernels))
"""


def test_source_is_the_same_whatever_else_is_imported():
    optional = ["matplotlib.pyplot", "trimesh", "warprt.trimesh", "warprt.benchmarks.command", "warprt.walk_plot"]
    said = [
        subprocess.run([sys.executable, "-c", PLAIN_HASH, *names], capture_output=True, text=True, check=True).stdout
        for names in ([], optional)
    ]
    # Other lines are Warp's own, of where it is.
    hashes = [[line for line in text.splitlines() if line.startswith("wp_")] for text in said]
    assert hashes[0] == hashes[1] and len(hashes[0]) == 1


def test_equal_specs_share_a_kernel():
    specs = [Spec(Tier.ROBUST, frozenset([ShapeKind.BOX, ShapeKind.MESH])) for _ in range(2)]
    assert make_cast(specs[0], Stored.FULL) is make_cast(specs[1], Stored.FULL)


def test_second_scene_of_a_kind_compiles_nothing(device):
    rt.Tracer(rt.Scene([rt.Sphere()]), device=device).cast((0, 0, 5), (0, 0, -1))
    before = len(make_cast.made)
    rt.Tracer(rt.Scene([rt.Sphere((1, 2, 3), 4)] * 3), device=device).cast((0, 0, 9), (0, 0, -1))
    assert len(make_cast.made) == before


ALL = Spec(Tier.ROBUST, frozenset(ShapeKind))
MESHES = Spec(Tier.ROBUST, frozenset([ShapeKind.MESH]), instance_grid=False)
SOME = replace(ALL, shapes=frozenset([ShapeKind.SPHERE, ShapeKind.MESH]))  # what traces is the same for pictures
EVERYTHING = {field.name: True for field in fields(Look) if field.type is bool}
KERNELS = {
    "cast": lambda: make_cast(ALL, Stored.FULL),
    "occluded": lambda: make_occluded(SOME),
    "spawn": lambda: make_spawn(ALL),
    "walk": lambda: make_walk_cells(ALL),
    "render": lambda: make_render(Look(SOME, **{**EVERYTHING, "paths": False})),
    "paths": lambda: make_render(
        Look(Spec(Tier.ROBUST, frozenset([ShapeKind.SPHERE])), mirrors=True, glass=True, paths=True), is_measured=True
    ),
    "settle": lambda: make_settle(True),
    "albedo": lambda: make_albedo(Look(SOME, **EVERYTHING)),
    "effort": lambda: make_effort(replace(ALL, shapes=frozenset([ShapeKind.MESH, ShapeKind.BOX]))),
    "packets": lambda: make_cast_packets(MESHES),
    "occluded packets": lambda: make_occluded_packets(MESHES),
}
for p in (Projection.ORTHOGRAPHIC, Projection.FISHEYE, Projection.EQUIRECTANGULAR):
    KERNELS[f"render {p.value}"] = lambda p=p: make_render(Look(replace(ALL, shapes=frozenset())), p)
for t in (Tier.FAST, Tier.MIXED, Tier.DOUBLE):
    KERNELS[f"cast {t.value}"] = lambda t=t: make_cast(replace(SOME, tier=t), Stored.FULL)
    KERNELS[f"packets {t.value}"] = lambda t=t: make_cast_packets(replace(MESHES, tier=t))


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_compile_for_a_gpu_without_one(name, tmp_path):
    text = source(KERNELS[name](), tmp_path, arch=90, use_ptx=True)
    ptx = "".join(path.read_text() for path in tmp_path.rglob("*.ptx"))
    assert ".target sm_90" in ptx
    assert text
    # But in `fast`, each operation is rounded on its own: no multiply-add that the source did not ask for.
    assert ("fma.rn" in ptx.replace("fma.rn.f64", "")) == ("fast" in name)
    if "fast" in name:
        # float64 is read and rounded, and no more.
        assert not set(re.findall(r"\n\s*(?:@\S+ )?(\w+)[.\w]*\.f64", ptx)) - {"ld", "st", "cvt", "mov"}
