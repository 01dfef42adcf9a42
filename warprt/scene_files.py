"""Scenes from files: Python, .cfg, glTF, and meshes."""

import importlib.util
import sys
import traceback
from pathlib import Path

from . import gltf
from .cfg import read_cfg
from .file_rules import FileRules
from .gltf_scene import read_gltf
from .lights import daylight
from .materials import Material
from .mesh import Mesh
from .mesh_files import SUFFIXES, read_parts
from .scene import Instance, Scene


def ready_scenes() -> dict[str, Path]:
    """The scenes that come with the package, by name."""
    spec = importlib.util.find_spec("warprt.scenes")
    folder = Path(spec.origin).parent
    files = [path for path in sorted(folder.iterdir()) if path.suffix in (".py", ".cfg")]
    return {path.stem: path for path in files if not path.stem.startswith("_")}


def find_scene(name: str | Path) -> Path:
    """The file that a path or the name of a ready scene means. Raises FileNotFoundError when there is none."""
    if not isinstance(name, (str, Path)):
        raise ValueError(f"a scene is a path or a name; got {name!r}")
    path, is_path = Path(name), "\0" not in str(name)
    if is_path and path.is_file():
        return path
    ready = ready_scenes()
    if str(name) in ready:
        return ready[str(name)]
    if is_path and path.exists():
        return path
    raise FileNotFoundError(f"there is no scene {str(name)!r}: no such file, and the ready ones are {', '.join(ready)}")


def load_scene(path: str | Path, trust: bool = False, **options) -> Scene:
    """A scene from a file, or a ready one by its name.

    .py: what its function scene(**options) returns, as in `load_scene("balls", size=5)`; it is a program, which may do
    anything. .cfg: see `warprt.cfg`. .glb and .gltf: see `warprt.gltf_scene`. Meshes (.obj .ply .stl .off): an instance
    for each material of the file, lit and framed.

    What is no program reads files of known kinds in its own folder or below only, and makes no more memory and objects
    of its bytes than any honest file does; `trust=True` lifts both.

    Raises FileNotFoundError, or ValueError that names the file and what is wrong with it.
    """
    path = find_scene(path)
    rules, suffix = FileRules(path, trust), path.suffix.lower()
    if suffix == ".py":
        return _python_scene(path, options)
    if options:
        raise ValueError(f"{path}: only scenes in Python take options; got {', '.join(options)}")
    if suffix == ".cfg":
        return read_cfg(rules)
    if suffix in gltf.SUFFIXES:
        return read_gltf(rules)
    if suffix in SUFFIXES:
        return _mesh_scene(rules)
    kinds = (".py", ".cfg", *gltf.SUFFIXES, *SUFFIXES)
    raise ValueError(f"cannot read {path}: scenes are {' '.join(kinds)}")


def _mesh_scene(rules: FileRules) -> Scene:
    """The meshes of a file in daylight; the camera sees all of them."""
    objects = [_part(mesh, material) for mesh, material in read_parts(rules.path, rules)]
    lights, sky = daylight()
    return Scene(objects, lights=lights, background=sky)


def _part(mesh: Mesh, material: Material | None) -> Instance:
    """A mesh of a file in the material that the file gives it; in clay if it gives neither that nor colours."""
    clay = Material((0.75, 0.7, 0.62) if mesh.colors is None else 1.0)
    return Instance(mesh, material=material or clay)


def _python_scene(path: Path, options: dict) -> Scene:
    """What scene(**options) of a file returns; its own folder can be imported from, as if Python ran it."""
    path = path.resolve()
    name = f"warprt_scene_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
        if not callable(getattr(module, "scene", None)):
            raise ValueError("there is no function scene()")
        scene = module.scene(**options)
    except (Exception, SystemExit) as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        place = f"{path}:{line}" if line else str(path)
        message = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"{place}: {message}") from error
    finally:
        sys.path.remove(str(path.parent))
    if not isinstance(scene, Scene):
        raise ValueError(f"{path}: scene() must return a Scene; it returned {type(scene).__name__}")
    return scene
