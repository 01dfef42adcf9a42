"""The folder of a .cfg file: the meshes and pictures in it, each read once and shared."""

from pathlib import Path

from . import mesh_files, picture_files
from .file_rules import ADVICE, FileRules
from .mesh import Mesh
from .texture import Texture

MOST_CELLS = 2**24
"""Cells of a grid that a file may ask for, 256 along each axis: more take minutes, and trust."""


class CfgFolder:
    """Meshes and pictures beside a scene, under its rules."""

    def __init__(self, rules: FileRules):
        self._rules = rules
        self._textures: dict[Path, Texture] = {}
        self._meshes: dict[tuple[Path, bool, bool], Mesh] = {}

    def texture(self, name: str, what: str) -> Texture:
        """The picture that `what` names. Raises ValueError, or FileNotFoundError if there is none."""
        path = self._rules.file(name, picture_files.SUFFIXES, what)
        if path not in self._textures:
            self._textures[path] = Texture(picture_files.read_ruled_picture(path, what, self._rules))
        return self._textures[path]

    def mesh(self, name: str, grid: str | tuple[int, int, int] | None, is_smooth: bool, is_fitted: bool) -> Mesh:
        """The mesh in a file. Raises ValueError, or FileNotFoundError if there is none."""
        path = self._rules.file(name, mesh_files.SUFFIXES, "file")
        self._require_few_cells(grid)
        mesh = self._mesh(path, is_smooth, is_fitted)
        return mesh if mesh.grid == grid else mesh.with_grid(grid)

    def _mesh(self, path: Path, is_smooth: bool, is_fitted: bool) -> Mesh:
        key = path, is_smooth, is_fitted
        if key not in self._meshes:
            if is_fitted:
                self._meshes[key] = self._mesh(path, is_smooth, False).fit_unit_cube()
            elif is_smooth:
                self._meshes[key] = self._mesh(path, False, False).smooth()
            else:
                self._meshes[key] = mesh_files.read_mesh(path, self._rules)
        return self._meshes[key]

    def _require_few_cells(self, grid) -> None:
        cells = 1
        for count in grid if isinstance(grid, tuple) else ():
            cells *= count
        if cells > MOST_CELLS and not self._rules.is_trusted:
            raise ValueError(f"grid_resolution has more than {MOST_CELLS} cells, which take long to make; {ADVICE}")
