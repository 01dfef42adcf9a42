"""Mesh files: what is in them, in which order, and what is wrong with them."""

import mesh_texts
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_texts import BOTH, CORNERS, SOLID, V, read, triangles

import warprt as rt

# ----------------------------------------------------------------------------------------------- order of faces


def check_round_trip(folder, seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, polygons, expected = mesh_texts.random_polygons(rng, int(rng.integers(1, 12)), int(rng.choice([3, 4, 9])))
    count, index = rng.choice(["uchar", "char", "ushort", "int", "uint"]), rng.choice(["uchar", "short", "int", "uint"])
    styles = ("ascii", "binary_little_endian", "binary_big_endian")
    files = [("a.obj", mesh_texts.obj), ("a.off", mesh_texts.off), ("a.stl", mesh_texts.stl)]
    texts = [(name, make(vertices, polygons)) for name, make in files]
    real = rng.choice(["double", "float"])
    extra = {"face_extra": "quality", "extra": rng.integers(0, 256, len(polygons))} if rng.integers(2) else {}
    texts += [("a.ply", mesh_texts.ply(vertices, polygons, style, count, index, real, **extra)) for style in styles]
    for name, text in texts:
        np.testing.assert_array_equal(triangles(read(folder, name, text)), expected)


@pytest.fixture(scope="module")
def shared_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("meshes")


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_faces_are_those_of_the_file_in_its_order(shared_folder, seed):
    check_round_trip(shared_folder, seed)


@pytest.mark.long
@settings(max_examples=3000)
@given(seed=st.integers(0, 10**9))
def test_faces_of_many_files_are_in_order(shared_folder, seed):
    check_round_trip(shared_folder, seed)


@pytest.mark.parametrize("name", ["a.obj", "a.off", "a.ply"])
def test_concave_polygons_are_not_covered_beyond_their_sides(tmp_path, name):
    corners = [(0, 0, 1), (2, 2, 1), (0, 4, 1), (0.5, 2, 1)]
    make = getattr(mesh_texts, name[2:])
    mesh = read(tmp_path, name, make(corners, [(0, 1, 2, 3)]))
    hits = rt.Tracer(rt.Scene([mesh]), device="cpu").cast([(1, 2, 9), (0.2, 2, 9), (0.45, 1, 9)], (0, 0, -1))
    np.testing.assert_array_equal(hits.hit, [True, False, True])


def test_colours_of_polygons_are_those_of_their_triangles(tmp_path):
    polygons = [(0, 1, 2, 3), (0, 1, 2), (0, 2, 3)]
    text = mesh_texts.ply(CORNERS, polygons, face_extra="red", extra=[255, 128, 0])
    text = text.replace(b"uchar red\n", b"uchar red\nproperty uchar green\nproperty uchar blue\n")
    head, body = text.split(b"end_header\n")
    lines = body.splitlines()
    lines[4:] = [line + b" 0 7" for line in lines[4:]]
    mesh = read(tmp_path, "a.ply", head + b"end_header\n" + b"\n".join(lines))
    np.testing.assert_array_equal(triangles(mesh), np.concatenate([BOTH, BOTH]))
    reds = mesh.colors[mesh.faces][:, :, 0]
    np.testing.assert_allclose(reds, np.repeat([1, 1, ((128 / 255 + 0.055) / 1.055) ** 2.4, 0], 3).reshape(4, 3))


@pytest.mark.parametrize("style", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_texture_coordinates_of_corners_of_a_ply(tmp_path, style):
    order = ">" if "big" in style else "<"
    head = f"ply\nformat {style} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    head += "property uchar flags\nend_header\n"
    faces = [((0, 1, 2, 3), (0, 0, 1, 0, 1, 1, 0, 1)), ((0, 1, 2), (0, 0, 1, 0, 0.5, 0.5))]
    if style == "ascii":
        body = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
        body += "".join(" ".join(map(str, (len(v), *v, len(t), *t, 9))) + "\n" for v, t in faces)
        body = body.encode()
    else:
        body = CORNERS.astype(order + "f4").tobytes()
        for corners, uvs in faces:
            body += bytes([len(corners)]) + np.array(corners, order + "i4").tobytes()
            body += bytes([len(uvs)]) + np.array(uvs, order + "f4").tobytes() + b"\x09"
    mesh = read(tmp_path, "a.ply", head.encode() + body)
    np.testing.assert_array_equal(triangles(mesh), CORNERS[[[0, 1, 2], [0, 2, 3], [0, 1, 2]]])
    expected = [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)], [(0, 0), (1, 0), (0.5, 0.5)]]
    np.testing.assert_array_equal(mesh.uvs[mesh.faces], expected)
    assert len(mesh) == 5


# ------------------------------------------------------------------------------------------------- ways to write


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(V + "f 1 2 3\nf 1 3 4\n", id="plain"),
        pytest.param((V + "f 1 2 3\nf 1 3 4").replace(" ", "\t"), id="tabs"),
        pytest.param((V + "f 1 2 3\nf 1 3 4\n").replace("v", "  v").replace("f", " \t f"), id="leading blanks"),
        pytest.param((V + "f 1 2 3 # one\nf 1 3 4# two\n# f 1 1 1\n").replace("v 1 1 0", "v 1 1 0 # 9"), id="comments"),
        pytest.param(V + "f 1 \\\n 2 3\nf 1 3\\\n 4\n", id="lines that go on"),
        pytest.param("# made in C:\\models\\\n" + V + "f 1 2 \\\n3\nf 1 3 4\n", id="comment with a folder"),
        pytest.param(V + "f 1 2 3 # c:\\tmp\\\nf 1 3 4\n", id="folder behind a face"),
        pytest.param("o c:\\tmp\\\n" + V + "usemtl c:\\tmp\\\nf 1 \\\n2 \\\n3\nf 1 3 4\n", id="name of a folder"),
        pytest.param(V.replace("\n", "\r\n") + "f 1 \\\r\n2 3\r\nf 1 3 4", id="CR LF"),
        pytest.param((V + "f 1 2 3\nf 1 3 4\n").replace("\n", "\r"), id="CR"),
        pytest.param("\ufeff" + V + "f 1 2 3\nf 1 3 4\n", id="byte order mark"),
        pytest.param("f 1 2 3\nf 1 3 4\n" + V, id="faces first"),
        pytest.param(V[:24] + "f -3 -2 -1\n" + V[24:] + "f -4 -2 -1\n", id="counted back"),
        pytest.param(V + "vn 0 0 1\nvt 0 0\nf 1//1 2//1 3//-1\nf 1/1/1 3/1 4\n", id="all ways of a corner"),
        pytest.param(V + "l 1 2\np 3\ng a\no b\ns off\nf 1 2 3\nvp 1 2\nf 1 3 4\n", id="other statements"),
        pytest.param(V.replace(" 0\n", " 0 1\n") + "f 1 2 3\nf 1 3 4\n", id="weights"),
        pytest.param(V + "f 1 2 3 4\n", id="quad"),
        pytest.param("v 9 9 inf\n" + V + "f 2 3 4\nf 2 4 5\nv nan 0 0\n", id="not finite where no face is"),
    ],
)
def test_obj_in_many_ways(tmp_path, text):
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.obj", text)), BOTH)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("change", [str, str.upper, lambda text: text.replace("endsolid a", ""), lambda text: text * 2])
def test_stl_texts(tmp_path, end, change):
    text = change(SOLID).replace("\n", end)
    mesh = read(tmp_path, "a.stl", text)
    np.testing.assert_array_equal(triangles(mesh), np.repeat(BOTH[:1], text.lower().count("facet normal"), axis=0))
    assert len(rt.load_scene(tmp_path / "a.stl").objects) == text.lower().count("facet normal")


@pytest.mark.parametrize("begin, end", [("\ufeff", ""), ("", "\0\0"), (" " * 90, ""), ("\ufeff" + "\n" * 90, "\n\0")])
def test_stl_texts_with_something_around(tmp_path, begin, end):
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.stl", begin + SOLID + end)), BOTH[:1])


@pytest.mark.parametrize("begin", ["\ufeffply", "PLY", "\ufeffPly"])
def test_ply_begins_in_many_ways(tmp_path, begin):
    mesh = read(tmp_path, "a.ply", ply_of().replace("ply", begin, 1))
    np.testing.assert_array_equal(triangles(mesh), BOTH[:1])


@pytest.mark.parametrize("name, text", [("a.obj", V + "f 1 2 3\n"), ("a.stl", SOLID), ("a.off", "OFF\n3 1 0\n")])
@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf16_is_named(tmp_path, name, text, code):
    with pytest.raises(ValueError, match="it is a text in UTF-16; save it as UTF-8"):
        read(tmp_path, name, text.encode(code))


@pytest.mark.parametrize("begin", [b"\0", b"solid"])
@pytest.mark.parametrize("behind", [b"", b"\0", b"trailing junk"])
def test_stl_with_bytes_behind(tmp_path, begin, behind):
    data = mesh_texts.stl(CORNERS, [(0, 1, 2, 3)])
    mesh = read(tmp_path, "a.stl", begin + data[len(begin) :] + behind)
    np.testing.assert_array_equal(triangles(mesh), BOTH)


def test_signalling_nan_of_a_binary_file(tmp_path):
    signal = (0x7FA00000).to_bytes(4, "little")
    text = mesh_texts.ply([*CORNERS, CORNERS[0]], [(0, 1, 2, 3)], "binary_little_endian", real="float")
    head, body = text.split(b"end_header\n")
    mesh = read(tmp_path, "a.ply", head + b"end_header\n" + body[:48] + signal * 3 + body[60:])
    np.testing.assert_array_equal(triangles(mesh), BOTH)
    data = mesh_texts.stl(CORNERS, [(0, 1, 2)])
    with pytest.raises(ValueError, match=r"face 0 uses vertex 0 .* not finite"):
        read(tmp_path, "a.stl", data[:96] + signal + data[100:])


def test_stl_with_triangles_behind_warns(tmp_path):
    data = mesh_texts.stl(CORNERS, [(0, 1, 2, 3)])
    with pytest.warns(UserWarning, match=r"a\.stl: 120 bytes behind the 2 triangles that it announces are left out"):
        read(tmp_path, "a.stl", data + bytes(120))


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("OFF\n4 2 5\n{}3 0 1 2\n3 0 2 3\n", id="plain"),
        pytest.param("OFF 4 2 0\n\n# c\n{}\n3 0 1 2 # d\n\n\n 3 0 2 3", id="counts on the first line"),
        pytest.param("# c\nCOFF\n4 2\n{}3 0 1 2 255 0 0\n3\t0 2 3 0.5 0.5 0.5 1\nbehind\n", id="colours"),
        pytest.param("OFF\r\n4 1 0\r\n{}4 0 1 2 3\r\n", id="CR LF"),
    ],
)
def test_off_in_many_ways(tmp_path, text):
    rows = "".join(f"{x} {y} {z}" + (" 255 0 0 255" if "COFF" in text else "") + "\n" for x, y, z in CORNERS)
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.off", text.format(rows))), BOTH)


@pytest.mark.parametrize("style", ["ascii", "binary_little_endian"])
def test_ply_with_other_elements_and_bytes_behind(tmp_path, style):
    text = mesh_texts.ply(CORNERS, [(0, 1, 2, 3)], style) + b"\nbehind 1 2"
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.ply", text)), BOTH)
    other = (
        b"element other 2\nproperty list uchar uchar list\nproperty uchar x\nelement none 99999999999\nelement vertex"
    )
    text = text.replace(b"element vertex", other, 1)
    rows = b"2 3 4 5\n0 6\n" if style == "ascii" else bytes([2, 3, 4, 5, 0, 6])
    text = text.replace(b"end_header\n", b"end_header\n" + rows)
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.ply", text)), BOTH)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_ply_header_in_any_line_ends(tmp_path, end):
    head, body = mesh_texts.ply(CORNERS, [(0, 1, 2, 3)], "binary_little_endian").split(b"end_header\n")
    head = (head + b"end_header\n").replace(b"\n", end.encode())
    np.testing.assert_array_equal(triangles(read(tmp_path, "a.ply", head + body)), BOTH)


# ------------------------------------------------------------------------------------------------ what is wrong


def ply_of(vertex_count=4, face_count=1, index="3 0 1 2", row="0 0 0\n1 0 0\n1 1 0\n0 1 0\n", more="") -> str:
    head = f"ply\nformat ascii 1.0\nelement vertex {vertex_count}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    return head + f"element face {face_count}\nproperty list uchar int vertex_indices\n{more}end_header\n{row}{index}\n"


@pytest.mark.parametrize(
    "name, data, words",
    [
        pytest.param("a.obj", V + "f 1 2 3\nf 0 1 2\n", "face 1 has a vertex 0; the first", id="obj 0"),
        pytest.param("a.obj", V + "f 1 2 5\n", r"face 0 has a vertex 4 \(from 0\), and there are 4", id="obj beyond"),
        pytest.param("a.obj", "v 0 0 0\nf 1 -2 1\n" + V, "face 0 has a vertex -1", id="obj before the first"),
        pytest.param("a.obj", V + "f 1 2 99999999999999999999\n", "'99999999999999999999' is not", id="obj huge"),
        pytest.param("a.obj", V + "f 1 2 x\n", "corner of a face: 'x' is not a whole number", id="obj word"),
        pytest.param("a.obj", V + "f 1 2 3/1/1/1\n", "'3/1/1/1' is not v, v/t", id="obj slashes"),
        pytest.param("a.obj", V + "f 1 2 /3\n", "no vertex before its /", id="obj slash first"),
        pytest.param("a.obj", V + "f 1 2 1.5\n", "'1.5' is not a whole number", id="obj fraction"),
        pytest.param("a.obj", "v 0 0\n" + V + "f 1 2 3\n", "vertex 0 needs 3 numbers; got '0 0'", id="obj 2-D"),
        pytest.param("a.obj", "v 0 0 o\n" + V + "f 1 2 3\n", "vertex: 'o' is not a number", id="obj letter"),
        pytest.param("a.obj", V + "v nan 0 0\nf 1 2 3\nf 1 2 5\n", r"face 1 uses vertex 4 .*finite", id="obj nan"),
        pytest.param("a.obj", V, "has no triangles", id="obj points"),
        pytest.param("a.obj", b"\0\1\2", "has no triangles", id="obj bytes"),
        pytest.param("a.off", "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n", "announces 4 .* 2 faces", id="off"),
        pytest.param("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "not as many corners", id="off short"),
        pytest.param("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "has a vertex 3", id="off beyond"),
        pytest.param("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "has a vertex -1", id="off negative"),
        pytest.param("a.off", "OFF\n-3 1 0\n", "no counts", id="off negative count"),
        pytest.param("a.off", "OFF\n", "no counts", id="off empty"),
        pytest.param("a.off", "OFF BINARY\n", "binary", id="off binary"),
        pytest.param("a.off", "nothing", "does not begin with OFF", id="off other"),
        pytest.param("a.stl", b"\0" * 80 + b"\xff" * 4 + b"\0" * 50, "4294967295 triangles, .* bytes for 1", id="stl"),
        pytest.param("a.stl", b"\0" * 40, "nor long enough", id="stl short"),
        pytest.param("a.stl", SOLID.replace("vertex 0 0 0", ""), "2 vertices of a solid", id="stl two corners"),
        pytest.param("a.stl", SOLID.replace("vertex 0 0 0", "vertex 0 0"), "needs 3 numbers", id="stl two numbers"),
        pytest.param("a.stl", SOLID.replace("vertex 0", "vertex nan"), "not finite", id="stl nan"),
        pytest.param("a.ply", ply_of(10**12), "announces 1000000000000 rows of 'vertex'", id="ply vertices"),
        pytest.param("a.ply", ply_of(face_count=10**12), "announces 1000000000000 rows of 'face'", id="ply faces"),
        pytest.param("a.ply", ply_of(index="3 0 1 4"), "has a vertex 4", id="ply beyond"),
        pytest.param("a.ply", ply_of(index="3 0 1 -1"), "has a vertex -1", id="ply negative"),
        pytest.param("a.ply", ply_of(index="3 0 1 1.5"), "has a vertex -1", id="ply fraction"),
        pytest.param("a.ply", ply_of(index="4000000000 0 1 2"), "ends before", id="ply long list"),
        pytest.param("a.ply", ply_of(index="-3 0 1 2"), "a list has -3", id="ply negative list"),
        pytest.param("a.ply", ply_of(index="3 0 one 2"), "ends before", id="ply word"),
        pytest.param("a.ply", ply_of(more="property complex a\n"), "'property complex a'", id="ply type"),
        pytest.param("a.ply", ply_of().replace("ascii", "baudot"), "its format is none of", id="ply format"),
        pytest.param("a.ply", ply_of().replace("property float z\n", ""), "x, y and z", id="ply flat"),
        pytest.param("a.ply", ply_of()[:100], "does not end", id="ply half a header"),
        pytest.param("a.ply", ply_of(face_count=0), "has no triangles", id="ply points"),
    ],
)
def test_broken_files_are_named(tmp_path, name, data, words):
    for load in (lambda: read(tmp_path, name, data), lambda: rt.load_scene(tmp_path / name)):
        with pytest.raises(ValueError, match=words) as caught:
            load()
        assert str(tmp_path / name) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.obj", "a.off", "a.ply"])
def test_faces_of_fewer_than_three_corners_are_left_out(tmp_path, name):
    text = getattr(mesh_texts, name[2:])(CORNERS, [(0, 1), (0, 1, 2, 3), (1,)])
    with pytest.warns(UserWarning, match=rf"a\.{name[2:]}: faces of fewer than 3 corners are left out: 2"):
        mesh = read(tmp_path, name, text)
    np.testing.assert_array_equal(triangles(mesh), BOTH)


def test_texture_coordinates_that_are_not_finite_are_left_out_where_used(tmp_path):
    text = V + "vt 0 0\nvt 1 0\nvt nan inf\nusemtl a\nf 1/1 2/2 3/{}\nusemtl b\nf 1/1 3/1 4/2\n"
    with pytest.warns(UserWarning, match=r"a\.obj: texture coordinates that are not finite are left out"):
        read(tmp_path, "a.obj", text.format(3))
    with pytest.warns(UserWarning, match="not finite"):
        first, second = rt.load_scene(tmp_path / "a.obj").objects
    assert first.shape.uvs is None and second.shape.uvs is not None
    assert read(tmp_path, "a.obj", text.format(2)).uvs is not None


def test_texture_coordinates_that_there_are_not_are_left_out(tmp_path):
    with pytest.warns(UserWarning, match="texture coordinates that there are not"):
        mesh = read(tmp_path, "a.obj", V + "vt 0 0\nf 1/1 2/1 3/2\nf 1/1 3/1 4/1\n")
    np.testing.assert_array_equal(triangles(mesh), BOTH)
    assert mesh.uvs is None
