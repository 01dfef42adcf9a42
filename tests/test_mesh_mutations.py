"""Mesh files that are broken at random."""

import warnings

import mesh_texts
import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_texts import SOLID, textured_ply

import warprt as rt


@pytest.fixture(scope="module")
def shared_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    PIL.Image.new("RGB", (2, 3), (255, 0, 0)).save(folder / "red.png")
    return folder


def good_files(seed: int) -> dict[str, bytes]:
    rng = np.random.default_rng(seed)
    vertices, polygons, _ = mesh_texts.random_polygons(rng, 5, 7)
    uv = b"vt 0 0\nvt 1 0\nvt 1 1\nmtllib m.mtl\nusemtl a\nf 1/1 2/2/1 3/3\nusemtl b\nf -1/-1 -2/-2 -3//1\n"
    return {
        "obj": mesh_texts.obj(vertices, polygons) + uv,
        "off": mesh_texts.off(vertices, polygons),
        "stl": mesh_texts.stl(vertices, polygons),
        "text.stl": (SOLID * 2).encode(),
        "text.ply": mesh_texts.ply(vertices, polygons),
        "uv.ply": textured_ply("red.png").encode(),
        "little.ply": mesh_texts.ply(vertices, polygons, "binary_little_endian", face_extra="red", extra=[9] * 5),
        "big.ply": mesh_texts.ply(vertices, polygons, "binary_big_endian", "ushort", "short"),
        "mtl": b"newmtl a\nKd 1 0.5 1\nmap_Kd -s 1 1 1 red.png\nnewmtl b\nKd 1\nmap_Kd red.png\n",
    }


WORDS = [b"-1", b"0", b"99999999999", b"nan", b"1e999", b"/", b"//", b"\\\n", b"#", b"\n", b" ", b"element ", b"list "]
WORDS += [
    b"end_header\n",
    b"property ",
    b"f ",
    b"v ",
    b"usemtl ",
    b"solid ",
    b"endsolid\n",
    b"vertex ",
    b"\0",
    b"\xff\xff",
]


def mutated(rng, data: bytes) -> bytes:
    """With bytes flipped, cut out, given again, put in, or cut off."""
    data = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        k, size = int(rng.integers(len(data) + 1)), int(rng.choice([1, 1, 2, 4, 16, 200]))
        way = rng.integers(6)
        if way == 0:
            data[k : k + 1] = bytes([rng.integers(256)])
        elif way == 1:
            del data[k : k + size]
        elif way == 2:
            data[k:k] = data[k : k + size]
        elif way == 3:
            data[k:k] = WORDS[rng.integers(len(WORDS))]
        elif way == 4 and rng.random() < 0.3:
            del data[k:]
        elif k < len(data):
            data[k] ^= 1 << int(rng.integers(8))
        data = data or bytearray(b"\n")
    return bytes(data)


def check_mutated(folder, seed: int) -> bool:
    """Reads a broken file; whether it was refused."""
    rng = np.random.default_rng(seed)
    files = good_files(seed % 7)
    kind = list(files)[rng.integers(len(files))]
    files[kind] = mutated(rng, files[kind])
    name = "a." + (kind if kind != "mtl" else "obj")
    (folder / name).write_bytes(files[kind if kind != "mtl" else "obj"])
    (folder / "m.mtl").write_bytes(files["mtl"])
    refused = False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for load in (rt.Mesh.from_file, rt.load_scene):
            try:
                result = load(folder / name)
                mesh = result if load == rt.Mesh.from_file else result.objects[0].shape
                assert np.isfinite(mesh.vertices).all()
            except (ValueError, OSError) as error:
                assert name in str(error)
                assert len(str(error)) < 1000
                refused = True
    return refused


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6))
def test_broken_files_raise_nothing_else(shared_folder, seed):
    check_mutated(shared_folder, seed)


@pytest.mark.long
@settings(max_examples=20_000)
@given(seed=st.integers(0, 10**9))
def test_many_broken_files_raise_nothing_else(shared_folder, seed):
    check_mutated(shared_folder, seed)


def test_mutations_break_files_and_leave_some_whole(shared_folder):
    refused = sum(check_mutated(shared_folder, seed) for seed in range(40))
    assert 5 < refused < 35
