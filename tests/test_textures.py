"""Textures and vertex colours against a picture that is sampled by hand."""

import pickle
from fractions import Fraction
from functools import cache

import numpy as np
import PIL.Image
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import OPTIONS, rounded, roundoff

import warprt as rt
from warprt import picture_files
from warprt.kernels.texture import Texture, bilinear
from warprt.texels import pack_textures

WRAPS = ("repeat", "clamp", "mirror")
U32 = 2.0**-24
QUAD = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
CORNERS = [(0, 0), (1, 0), (1, 1), (0, 1)]
HALVES = [(0, 1, 2), (0, 2, 3)]


# ------------------------------------------------------------------------------------------------------ oracle


def tents(x: float, count: int, wrap: str) -> np.ndarray:
    """The weight of each of a line of texels at x: tents of width 2 over a line that is laid out beyond its ends."""
    x, line = Fraction(float(x)), list(range(count))
    if wrap == "clamp":
        x, line = min(max(x, Fraction(0)), Fraction(1)), [0, *line, count - 1]
    elif wrap == "repeat":
        x, line = x % 1, [line[-1], *line, 0]
    else:
        x, line = x % 2, [0, *line, *line[::-1], 0]
    weights = np.zeros(count)
    for k, i in enumerate(line):
        weights[i] += float(max(Fraction(0), 1 - abs(x * count + Fraction(1, 2) - k)))
    return weights


def sampled(light: np.ndarray, wrap: str, u: float, v: float) -> np.ndarray:
    """Colour at (u, v) of a picture of linear light; v counts from its last row upwards."""
    height, width = light.shape[:2]
    return np.einsum("i,j,ijc->c", tents(v, height, wrap), tents(u, width, wrap), light[::-1])


def decoded(level: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, of levels 0 .. 255."""
    x = np.asarray(level) / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def flat_lit(color=1.0):
    return rt.AmbientLight(color)


def seen(objects, accuracy="robust", device="cpu", size=(48, 40), background=(0, 0, 0), **options):
    """(colours of pixels, points of the plane z = 0 behind them)."""
    camera = rt.Camera((0.5, 0.45, 2), (0.5, 0.45, 0), fov_deg=32)
    tracer = rt.Tracer(rt.Scene(objects, [flat_lit()], camera, background), accuracy, device)
    o, d = camera.rays(*size)
    return tracer.render(size=size, **options)["color"], (o - (o[..., 2:] / d[..., 2:]) * d)[..., :2]


def inside(points):
    """Away from edges, where a ray may rightly hit or miss."""
    return (np.abs(points - 0.5) < 0.5 - 1e-4).all(axis=-1)


def noise(rng, width, height):
    return rng.integers(0, 256, (height, width, 3), dtype=np.uint8)


# ----------------------------------------------------------------------------------------------- one look-up


@cache
def sampler(real):
    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def sample(
        word: wp.array(dtype=wp.uint32),
        level: wp.array(dtype=wp.float32),
        texture: wp.array(dtype=Texture),
        u: wp.array(dtype=real),
        v: wp.array(dtype=real),
        color: wp.array(dtype=wp.vec3f),
    ):
        k = wp.tid()
        color[k] = bilinear(word, level, texture[0], u[k], v[k])

    return sample


def looked_up(texture, uv, real, device) -> np.ndarray:
    uv = np.reshape(uv, (-1, 2))
    records, texels, levels = pack_textures([texture], wp.get_device(device))
    color = wp.zeros(len(uv), dtype=wp.vec3f, device=device)
    inputs = [texels, levels, wp.array(records, dtype=Texture, device=device)]
    inputs += [wp.array(rounded(uv[:, k], real), dtype=real, device=device) for k in (0, 1)]
    wp.launch(sampler(real), dim=len(uv), inputs=inputs, outputs=[color], device=device)
    return color.numpy()


def tolerance(real, count: int) -> float:
    """Folding and scaling a coordinate round six times; the weights and the colour, in float32, eight times."""
    return 6 * roundoff(real) * count + 8 * U32


@given(data=st.data())
def test_lookup_is_bilinear_for_any_uv(real, device, data):
    width, height = data.draw(st.integers(1, 9)), data.draw(st.integers(1, 9))
    wrap = data.draw(st.sampled_from(WRAPS))
    kind = np.float32 if real is wp.float32 else np.float64
    bits = 32 if real is wp.float32 else 64
    number = st.floats(-3, 3, width=bits) | st.floats(allow_nan=False, allow_infinity=False, width=bits)
    uv = np.array(data.draw(st.lists(st.tuples(number, number), min_size=1, max_size=8)), kind)
    pixels = noise(np.random.default_rng(data.draw(st.integers(0, 9))), width, height)
    color = looked_up(rt.Texture(pixels, wrap=wrap), uv, real, device)
    expected = [sampled(decoded(pixels), wrap, u, v) for u, v in uv]
    np.testing.assert_allclose(color, expected, rtol=0, atol=tolerance(real, width + height))


@pytest.mark.parametrize("wrap", WRAPS)
def test_nearest_texel_is_one_colour_throughout(wrap, real, device, rng):
    pixels = rng.uniform(0, 7, (3, 5, 3)).astype(np.float32)
    uv = rng.uniform(-2, 3, (400, 2))
    column, row = np.floor(uv[:, 0] * 5).astype(int), np.floor((1 - uv[:, 1]) * 3).astype(int)
    fold = {
        "repeat": lambda k, n: k % n,
        "clamp": lambda k, n: np.clip(k, 0, n - 1),
        "mirror": lambda k, n: np.minimum(k % (2 * n), 2 * n - 1 - k % (2 * n)),
    }[wrap]
    color = looked_up(rt.Texture(pixels, wrap=wrap, filter="nearest"), uv, real, device)
    np.testing.assert_array_equal(color, pixels[fold(row, 3), fold(column, 5)])


def test_checker_is_a_chessboard(device):
    board = rt.Texture.checker((0.1, 0.2, 0.3), 0.9, (4, 2))
    assert board.size == (4, 2)
    uv = [(x + 0.01 + 0.98 * f, y + 0.5) for y in (0, 1) for x in range(4) for f in (0, 1)]
    color = looked_up(board, np.array(uv) / (4, 2), wp.float64, device)
    expected = [(0.1, 0.2, 0.3) if int(x + y) % 2 == 0 else (0.9,) * 3 for x, y in np.floor(uv)]
    np.testing.assert_allclose(color, expected, rtol=1e-6)


@pytest.mark.parametrize("wrap", WRAPS)
def test_centre_of_a_texel_is_the_texel(wrap, real, device, rng):
    pixels = rng.uniform(0, 7, (4, 8, 3)).astype(np.float32)
    column, row = np.meshgrid(np.arange(8), np.arange(4))
    uv = np.stack([(column + 0.5) / 8, 1 - (row + 0.5) / 4], axis=-1)
    color = looked_up(rt.Texture(pixels, wrap=wrap), uv, real, device)
    np.testing.assert_array_equal(color.reshape(4, 8, 3), pixels)


@pytest.mark.parametrize(
    "wrap, left, lower_left, beyond, far_beyond",
    [
        # Two rows [a b], [c d] with the values 0 1, 2 3; beyond: at u = 1.25, v = 0.75; far: u = -1.25, v = 0.75.
        pytest.param("repeat", 0.5, 1.5, 0, 1, id="repeat"),
        pytest.param("clamp", 0, 2, 1, 0, id="clamp"),
        pytest.param("mirror", 0, 2, 1, 1, id="mirror"),
    ],
)
def test_edges_and_corners(wrap, left, lower_left, beyond, far_beyond, real, device):
    texture = rt.Texture(np.repeat(np.arange(4.0).reshape(2, 2, 1), 3, axis=2), wrap=wrap)
    uv = [(0, 0.75), (0, 0), (1.25, 0.75), (-1.25, 0.75), (0.5, 0.5)]
    color = looked_up(texture, uv, real, device)
    np.testing.assert_array_equal(color[:, 1], [left, lower_left, beyond, far_beyond, 1.5])


def test_v_points_up(real, device):
    pixels = np.zeros((2, 1, 3), np.uint8)
    pixels[0] = 255  # the top row
    np.testing.assert_array_equal(looked_up(rt.Texture(pixels), [(0.5, 0.75), (0.5, 0.25)], real, device)[:, 0], [1, 0])


@pytest.mark.parametrize("is_srgb", [None, True, False])
def test_levels_are_decoded(is_srgb, real, device):
    levels = np.arange(256, dtype=np.uint8)
    uv = np.stack([(np.arange(256) + 0.5) / 256, np.full(256, 0.5)], axis=-1)
    pixels = np.stack([levels, levels[::-1], levels, levels // 2], axis=-1)[None]  # alpha does not count
    color = looked_up(rt.Texture(pixels, is_srgb), uv, real, device)
    light = levels / 255 if is_srgb is False else decoded(levels)
    np.testing.assert_allclose(color, np.stack([light, light[::-1], light], axis=-1), rtol=2 * U32)


@pytest.mark.parametrize("is_srgb, expected", [(None, 0.5), (False, 0.5), (True, ((0.5 + 0.055) / 1.055) ** 2.4)])
def test_floats_are_linear_unless_told_otherwise(is_srgb, expected, device):
    color = looked_up(rt.Texture(np.full((2, 3, 3), 0.5), is_srgb), (0.1, 0.9), wp.float32, device)
    np.testing.assert_allclose(color, np.full((1, 3), expected), rtol=2 * U32)


@pytest.mark.parametrize("value", [0.1, 1e30])
def test_constant_picture_is_constant(value, real, device, rng):
    color = looked_up(rt.Texture(np.full((5, 7, 3), value)), rng.uniform(-9, 9, (500, 2)), real, device)
    np.testing.assert_array_equal(color, np.full((500, 3), value, np.float32))


# ---------------------------------------------------------------------------------------------------- pictures


@pytest.mark.parametrize("wrap", WRAPS)
def test_textured_quad_shows_the_picture(wrap, tier, device, rng):
    pixels = noise(rng, 6, 5)
    stretch, shift = np.array([[1.5, 0.5], [-0.25, 2]]), np.array([-0.75, 0.3])
    mesh = rt.Mesh(QUAD, HALVES, uvs=CORNERS @ stretch + shift)
    material = rt.Material((1, 0.5, 0.25), texture=rt.Texture(pixels, wrap=wrap))
    color, points = seen([rt.Instance(mesh, material=material)], tier.value, device)
    is_inside = inside(points)
    expected = [sampled(decoded(pixels), wrap, *uv) for uv in points[is_inside] @ stretch + shift]
    # Weights within a triangle are off by up to 64 roundings; coordinates span 3, a texel is 1/6 of a picture.
    slack = 8 * U32 + 64 * 3 * 6 * (roundoff(tier.result) + U32 * (tier.value == "fast"))
    np.testing.assert_allclose(color[is_inside], expected * np.array([1, 0.5, 0.25]), rtol=0, atol=slack)
    assert 500 < is_inside.sum() < color[..., 0].size


def test_vertex_colours_are_interpolated(tier, device, rng):
    colors = rng.uniform(0, 3, (4, 3))
    instance = rt.Instance(rt.Mesh(QUAD, HALVES, colors=colors), material=rt.Material((1, 0.5, 0.25)))
    color, points = seen([instance], tier.value, device)
    is_inside = inside(points)
    x, y = points[is_inside].T[..., None]
    lower = (1 - x) * colors[0] + (x - y) * colors[1] + y * colors[2]
    upper = (1 - y) * colors[0] + x * colors[2] + (y - x) * colors[3]
    expected = np.where(x >= y, lower, upper) * [1, 0.5, 0.25]
    slack = 3 * (8 * U32 + 64 * (roundoff(tier.result) + U32 * (tier.value == "fast")))
    np.testing.assert_allclose(color[is_inside], expected, rtol=0, atol=slack)


def test_colour_and_picture_multiply_diffuse_and_mirror(accuracy, device):
    texture, sky = rt.Texture(np.full((1, 1, 3), (0.5, 0.25, 1.0))), (0.25, 0.5, 1)
    mesh = rt.Mesh(QUAD, HALVES, uvs=CORNERS, colors=[(0.5, 1, 0.25)] * 4)
    material = rt.Material(0.5, (0.25, 0.5, 1), texture)
    color, points = seen([rt.Instance(mesh, material=material)], accuracy, device, background=sky)
    tint = np.array([0.25, 0.25, 0.25])
    expected = tint * (0.5 + np.array([0.25, 0.5, 1]) * sky)
    np.testing.assert_allclose(color[inside(points)], np.tile(expected, (inside(points).sum(), 1)), rtol=1e-6)


def strips(count):
    """Matrices that put the quad, made narrow, into `count` strips side by side."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, 0, 0] = 1 / count
    matrices[:, 0, 3] = np.arange(count) / count
    return matrices


@pytest.mark.parametrize("grid", ["auto", None])
def test_copies_of_a_mesh_have_textures_of_many_sizes_and_kinds(grid, device, rng):
    sizes = [(1, 1), (7, 2), (3, 31), (64, 64), (2, 2)]
    textures = [rt.Texture(noise(rng, *size)) for size in sizes]
    textures[2] = rt.Texture(textures[2].pixels / 255.0)
    textures[3] = rt.Texture(textures[3].pixels, is_srgb=False, wrap="clamp")
    light = [decoded(texture.pixels) if texture.is_srgb else np.asarray(texture.pixels, float) for texture in textures]
    light[3] = light[3] / 255
    materials = [rt.Material(1, texture=texture) for texture in textures] + [rt.Material((0.1, 0.2, 0.3))]
    mesh = rt.Mesh(QUAD, HALVES, uvs=CORNERS, grid=grid)
    order = [3, 0, 5, 2, 1, 4, 3]
    color, points = seen([rt.Instances(mesh, strips(7), materials, order)], device=device, samples=1)
    checked = 0
    for (x, y), c in zip(points[inside(points)], color[inside(points)], strict=True):
        k, within = order[int(7 * x)], 7 * x % 1
        if abs(within - 0.5) < 0.499:
            expected = (0.1, 0.2, 0.3) if k == 5 else sampled(light[k], textures[k].wrap, within, y)
            np.testing.assert_allclose(c, expected, rtol=0, atol=64 * 64 * U32 * 8)
            checked += 1
    assert checked > 500


def test_plain_and_coloured_shapes_stand_side_by_side(device):
    red, picture = [(1, 0, 0)] * 4, rt.Texture(np.full((2, 2, 3), (0, 1.0, 0)))
    places = strips(5)
    objects = [
        rt.Instance(rt.Mesh(QUAD, HALVES, colors=red), places[0], rt.Material(0.5)),
        rt.Instance(rt.Mesh(QUAD, HALVES), places[1], rt.Material(0.5)),
        rt.Instance(rt.Mesh(QUAD, HALVES, uvs=CORNERS), places[2], rt.Material(0.5, texture=picture)),
        rt.Instance(rt.Mesh(QUAD, HALVES, uvs=CORNERS), places[3], rt.Material(0.25)),
        rt.Instance(rt.Box((0, 0, -1), (1, 1, 0)), places[4], rt.Material(0.75)),
    ]
    color, points = seen(objects, device=device)
    expected = np.array([(0.5, 0, 0), (0.5,) * 3, (0, 0.5, 0), (0.25,) * 3, (0.75,) * 3])
    is_inside = inside(points) & (np.abs(5 * points[..., 0] % 1 - 0.5) < 0.499)
    np.testing.assert_allclose(color[is_inside], expected[(5 * points[is_inside][:, 0]).astype(int)], rtol=1e-6)


@pytest.mark.parametrize("size", [1e6, 1e30, 1e300])
@pytest.mark.parametrize("wrap", WRAPS)
def test_huge_uvs_show_some_texel(size, wrap, tier, device):
    texture = rt.Texture(np.full((3, 3, 3), 0.5), wrap=wrap)
    mesh = rt.Mesh(QUAD, HALVES, uvs=np.array(CORNERS) * [size, -size])
    color, points = seen([rt.Instance(mesh, material=rt.Material(1, texture=texture))], tier.value, device)
    np.testing.assert_array_equal(color[inside(points)], 0.5)


def test_points_of_the_picture_lie_where_uvs_say_after_update(device, rng):
    pixels = noise(rng, 4, 4)
    mesh = rt.Mesh(np.array(QUAD) * 9.0, HALVES, uvs=CORNERS)
    instance = rt.Instance(mesh, material=rt.Material(1, texture=rt.Texture(pixels)))
    tracer = rt.Tracer(rt.Scene([instance], [flat_lit()], rt.Camera((0.5, 0.5, 2), (0.5, 0.5, 0))), device=device)
    before = tracer.render(size=(9, 9))["color"]
    mesh.update(QUAD)
    after = tracer.render(size=(9, 9))["color"]
    assert np.abs(after - before).max() > 0.01
    middle = sampled(decoded(pixels), "repeat", 0.5, 0.5)
    np.testing.assert_allclose(after[4, 4], middle, atol=1e-4)


# -------------------------------------------------------------------------------------------- what users give


def test_copies_of_meshes_keep_uvs_and_colours():
    mesh = rt.Mesh(QUAD, HALVES, uvs=CORNERS, colors=[(0, 1, 2)] * 4)
    for copy in (mesh.fit_unit_cube(), mesh.with_grid((2, 2, 2)), pickle.loads(pickle.dumps(mesh))):
        np.testing.assert_array_equal(copy.uvs, CORNERS)
        np.testing.assert_array_equal(copy.colors, [(0, 1, 2)] * 4)
    mesh.update(np.array(QUAD) * 2)
    assert mesh.uvs is not None
    assert mesh.colors is not None


def test_textures_are_told_apart_by_identity_and_can_be_pickled():
    one, other = (rt.Texture(np.ones((2, 3, 3), np.uint8), wrap="clamp") for _ in range(2))
    assert one != other
    assert len({one, other, one}) == 2
    assert rt.Material(1, texture=one) != rt.Material(1, texture=other)
    again = pickle.loads(pickle.dumps(rt.Material(1, texture=one))).texture
    np.testing.assert_array_equal(again.pixels, one.pixels)
    assert (again.size, again.is_srgb, again.wrap) == ((3, 2), True, "clamp")
    assert "3 x 2" in repr(one)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P", "LA", "1", "CMYK", "I;16"])
def test_pictures_of_any_mode_can_be_read(mode, tmp_path):
    image = PIL.Image.new("L", (3, 2), 0)
    image.putpixel((2, 0), 255)  # the top right corner
    image = PIL.Image.fromarray(np.asarray(image, np.uint16) * 257) if mode == "I;16" else image.convert(mode)
    path = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    image.save(path)
    for texture in (rt.Texture.from_file(path, wrap="clamp"), rt.Texture(path, wrap="clamp")):
        assert texture.size == (3, 2)
        color = looked_up(texture, [(5 / 6, 0.75), (1 / 6, 0.75)], wp.float32, "cpu")
        np.testing.assert_allclose(color, [(1, 1, 1), (0, 0, 0)], atol=0.2 if mode == "CMYK" else 1e-6)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P", "LA", "CMYK", "I;16", "I"])
def test_pictures_are_converted_in_strips(mode, rng, monkeypatch):
    monkeypatch.setattr(picture_files, "STRIP", 100)  # seven rows of 13 pixels
    if mode.startswith("I"):
        levels = rng.integers(0, 65536, (30, 13), dtype=np.uint16)
        image = PIL.Image.fromarray(levels.astype(np.int32) if mode == "I" else levels)
        expected = np.repeat((levels / 65535).astype(np.float32)[..., None], 3, axis=2)
    else:
        image = PIL.Image.fromarray(rng.integers(0, 256, (30, 13, 3), dtype=np.uint8)).convert(mode)
        expected = np.asarray(image if mode in ("RGB", "RGBA") else image.convert("RGB"))
    assert image.mode == mode
    np.testing.assert_array_equal(rt.Texture.from_pil(image).pixels, expected)
    assert not rt.Texture(image).pixels.flags.writeable


def test_textures_of_one_picture_store_it_once():
    picture = picture_files.Picture(noise(np.random.default_rng(2), 4, 6))
    textures = [rt.Texture(picture, wrap=wrap) for wrap in ("repeat", "clamp", "mirror")]
    textures += [rt.Texture(picture, is_srgb=False), rt.Texture(picture.pixels)]
    records, texels, _levels = pack_textures(textures, wp.get_device("cpu"))
    assert records["first"].tolist() == [0, 0, 0, 24, 48] and texels.size == 72


def test_pictures_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.png"):
        rt.Texture.from_file(tmp_path / "none.png")
    PIL.Image.fromarray(noise(np.random.default_rng(1), 64, 64)).save(tmp_path / "whole.png")
    (tmp_path / "half.png").write_bytes((tmp_path / "whole.png").read_bytes()[:900])
    (tmp_path / "text.png").write_text("no picture")
    for name in ("half.png", "text.png"):
        with pytest.raises(ValueError, match=f"cannot read .*{name}") as caught:
            rt.Texture.from_file(tmp_path / name)
        assert "\n" not in str(caught.value)


ONE = np.zeros((1, 1, 3))


@pytest.mark.parametrize(
    "make, words",
    [
        pytest.param(lambda: rt.Texture(np.zeros((2, 2))), r"Texture pixels .*\(2, 2\)", id="grey"),
        pytest.param(lambda: rt.Texture(np.zeros((2, 2, 2))), "Texture pixels", id="two channels"),
        pytest.param(lambda: rt.Texture(np.zeros((0, 2, 3))), "Texture pixels", id="no rows"),
        pytest.param(lambda: rt.Texture(np.zeros((2, 2, 3), int)), "uint8 or floats; got int64", id="integers"),
        pytest.param(lambda: rt.Texture([[(1.0, 2.0)], []]), "rows given differ", id="ragged"),
        pytest.param(lambda: rt.Texture("abc" * 2), "no file abcabc", id="no path"),
        pytest.param(lambda: rt.Texture(None), "Texture pixels", id="None"),
        pytest.param(lambda: rt.Texture(ONE - 1), "not negative.*row 0, column 0", id="negative"),
        pytest.param(lambda: rt.Texture(ONE + np.nan), "Texture pixels must be finite", id="nan"),
        pytest.param(lambda: rt.Texture(ONE + 1e39), "Texture pixels must be finite", id="beyond float32"),
        pytest.param(lambda: rt.Texture(ONE, wrap="tile"), "wrap must be one of repeat, clamp, mirror", id="wrap"),
        pytest.param(lambda: rt.Texture(ONE, wrap=None), "wrap", id="wrap None"),
        pytest.param(lambda: rt.Texture(ONE, filter="cubic"), "filter must be one of linear, nearest", id="filter"),
        pytest.param(lambda: rt.Texture(ONE, is_srgb="no"), "is_srgb", id="is_srgb"),
        pytest.param(lambda: rt.Texture.checker(-1), "Texture first must not be negative", id="checker color"),
        pytest.param(lambda: rt.Texture.checker(squares=8), "Texture squares must be", id="checker squares"),
        pytest.param(lambda: rt.Texture.checker(squares=(0, 8)), "Texture squares .* from 1 to 4096", id="no squares"),
        pytest.param(lambda: rt.Material(texture=ONE), "Material texture must be a Texture; got ndarray", id="array"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, uvs=CORNERS[:3]), "Mesh uvs.*4; got 3", id="uvs too few"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, uvs=[(0, np.inf)] * 4), r"Mesh uvs\[0\]", id="uvs infinite"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, colors=[(0, 0, 0)]), "Mesh colors.*4; got 1", id="colors too few"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, colors=np.ones((4, 4))), "Mesh colors must have shape", id="rgba"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, colors=[(0, -1, 0)] * 4), r"Mesh colors\[0\] .*negative", id="dark"),
        pytest.param(lambda: rt.Mesh(QUAD, HALVES, colors=[(0, np.nan, 0)] * 4), r"Mesh colors\[0\]", id="color nan"),
    ],
)
def test_bad_value_is_named(make, words):
    with pytest.raises((ValueError, OSError), match=words):
        make()


@pytest.mark.parametrize("shape", [rt.Sphere(), rt.Box(), rt.Plane(), rt.Mesh(QUAD, HALVES)], ids=lambda s: s.kind.name)
def test_texture_needs_uvs(shape):
    material = rt.Material(1, texture=rt.Texture(ONE))
    with pytest.raises(ValueError, match=r"Instance material has a texture.*uvs"):
        rt.Instance(shape, material=material)
    with pytest.raises(ValueError, match=r"Instances material has a texture.*uvs"):
        rt.Instances(shape, np.eye(4)[None], [rt.Material(), material])
