"""Good .glb, .gltf and .cfg files, changed at random: a scene or a ValueError of one line, and nothing else."""

import base64
import json
import re
import warnings
from contextlib import suppress
from copy import deepcopy
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_cfg import EXAMPLE, MESH
from test_gltf import PIXELS, png
from test_gltf_broken import full_glb, places

import warprt as rt
from warprt import file_rules

resource = pytest.importorskip("resource")
MOST_MIB = 400
"""What one file may add to the memory of the process, under the small budget of these tests."""
QUICK = settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
LONG = settings(QUICK, max_examples=20_000, derandomize=False)
NUMBERS = (0, 1, 2, 3, -1, 255, 5126, 2**16, 2**22, 2**31, 2**53, 10**30, 0.5, 1e300, 1e999)
ODD = (*NUMBERS, None, True, "", "a.bin", "../a", "a\0", "POSITION", "VEC3", "data:,", [], {}, [[]], [0], {"a": 0})
WORDS = (
    *(
        "{",
        "}",
        "(",
        ")",
        "=",
        ";",
        ",",
        '"',
        "/*",
        "*/",
        "//",
        "#",
        "\n",
        "true",
        "1e999",
        "-0",
        "1e-300",
        "nan",
        "9" * 400,
    ),
    *(
        "sphere",
        "material",
        "background",
        "geometry_instance",
        "triangle_mesh",
        "camera",
        "a",
        "picture",
        "texture",
        "file",
    ),
    *(
        '"red.png"',
        '"bunny.off"',
        '"../bunny.off"',
        '"."',
        '"scene.cfg"',
        "grid_resolution",
        "(1, 2, 3)",
        "(0, 0, 0)",
        "\ud7ff",
    ),
)
TEXT = (
    EXAMPLE + 'material m { texture = "red.png"; mirror = 0.1; } background { picture = "red.png"; rotation = 30; }'
    "spot_light { position = (0, 1, 0); direction = (0, -1, 0); } cone { } plane { }"
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A small budget, so that what exceeds it is found soon."""
    monkeypatch.setattr(file_rules, "FREE_BYTES", 2**26)
    monkeypatch.setattr(file_rules, "FREE_OBJECTS", 20_000)
    (tmp_path / "bunny.off").write_text(MESH)
    (tmp_path / "red.png").write_bytes(png(PIXELS))
    (tmp_path / "a.bin").write_bytes(full_glb().binary)
    return tmp_path


def begin_peak() -> int:
    """KiB of the process now, or at its most where the system cannot begin anew."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return peak()


def peak() -> int:
    """KiB of the process at its most since `begin_peak`."""
    with suppress(OSError):
        found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
        if found:
            return int(found[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def require_scene_or_error(path):
    """A scene, or an error of one line that names the file; in little memory."""
    before = begin_peak()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert isinstance(rt.load_scene(path), rt.Scene)
    except (ValueError, OSError) as error:
        assert str(error).startswith(str(path)) and "\n" not in str(error) and len(str(error)) < 1000
    assert peak() - before < MOST_MIB * 1024


@st.composite
def changed_json(draw):
    """The JSON of a file, of which one to four values are replaced, removed, repeated or copied elsewhere."""
    value = full_glb().json
    for _ in range(draw(st.integers(1, 4))):
        found = [path for path in places(value) if path]
        *path, key = draw(st.sampled_from(found))
        owner = at(value, path)
        action = draw(st.sampled_from(["odd", "number", "remove", "repeat", "copy"]))
        if action == "remove":
            del owner[key]
        elif action == "repeat" and isinstance(owner, list):
            owner[key:key] = [owner[key]] * draw(st.sampled_from([1, 2, 300]))
        elif action == "copy":
            owner[key] = deepcopy(at(value, draw(st.sampled_from(found))))
        else:
            owner[key] = deepcopy(draw(st.sampled_from(NUMBERS if action == "number" else ODD)))
        if not isinstance(value, dict):
            break
    return value


def at(value, path):
    """What stands there, as far as there is something."""
    for key in path:
        if not (isinstance(value, dict) and key in value) and not (
            isinstance(value, list) and isinstance(key, int) and key < len(value)
        ):
            return value
        value = value[key]
    return value


def check_gltf(folder, value, where):
    glb = full_glb()
    glb.json = value
    if where == "glb":
        return require_scene_or_error(glb.save(folder / "a.glb"))
    buffers = value.get("buffers")
    if isinstance(buffers, list) and buffers and isinstance(buffers[0], dict):
        data = "data:;base64," + base64.b64encode(glb.binary).decode()
        buffers[0]["uri"] = "a.bin" if where == "file" else data
    (folder / "a.gltf").write_text(json.dumps(value))
    return require_scene_or_error(folder / "a.gltf")


@st.composite
def changed_text(draw):
    """The text of a .cfg file with some places cut out, repeated or filled with words of the format."""
    text = TEXT
    for _ in range(draw(st.integers(1, 5))):
        first = draw(st.integers(0, len(text)))
        last = min(len(text), first + draw(st.sampled_from([0, 0, 1, 5, 50])))
        word = draw(st.sampled_from(WORDS) | st.text(max_size=4))
        repeat = draw(st.sampled_from([0, 1, 1, 1, 2, 2000]))
        text = text[:first] + word * repeat + text[draw(st.sampled_from([first, last])) :]
    return text


def check_cfg(folder, text):
    (folder / "scene.cfg").write_text(text, encoding="utf-8", errors="surrogatepass")
    require_scene_or_error(folder / "scene.cfg")


WHERE = st.sampled_from(["glb", "file", "data"])


def test_the_text_is_good_as_it_is(folder):
    (folder / "scene.cfg").write_text(TEXT)
    assert rt.load_scene(folder / "scene.cfg").instance_count == 5


@given(changed_json(), WHERE)
@QUICK
def test_changed_gltf(folder, value, where):
    check_gltf(folder, value, where)


@given(changed_text())
@QUICK
def test_changed_cfg(folder, text):
    check_cfg(folder, text)


@pytest.mark.long
@given(changed_json(), WHERE)
@LONG
def test_changed_gltf_many(folder, value, where):
    check_gltf(folder, value, where)


@pytest.mark.long
@given(changed_text())
@LONG
def test_changed_cfg_many(folder, text):
    check_cfg(folder, text)
