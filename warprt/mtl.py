"""Material files of OBJ files: the diffuse colour and its picture."""

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from .brief import brief
from .file_rules import ADVICE, FileRules
from .materials import Material
from .mesh_part import warn
from .picture_files import SUFFIXES as PICTURE_SUFFIXES
from .picture_files import read_ruled_picture
from .text_lines import name, plain
from .texture import Texture

SUFFIXES = (".mtl",)
MOST_NAMES = 1000
"""Material files that a file may name without trust: each is looked for."""
_ENDS = re.compile(r'(?:(?<=\.mtl)|(?<=\.mtl")) +', re.IGNORECASE)
_ABSOLUTE = re.compile(r'"?(?:[A-Za-z]:)?[\\/]')
_NUMBERS = {"-o": 3, "-s": 3, "-t": 3}
"""Options of map_Kd with up to so many numbers behind them; those named below have as many words."""
_WORDS = {"-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2}
_WORDS |= {"-texres": 1, "-type": 1}


class _Look(NamedTuple):
    """What a material file says of a material."""

    library: Path
    color: list[str] | None = None
    picture: str | None = None


class MaterialLibrary:
    """The material files that an OBJ file names. They are read when the first material is asked for, each once."""

    def __init__(self, names: list[str], rules: FileRules):
        self._names, self._rules = names, rules
        self._looks: dict[str, _Look] | None = None
        self._textures: dict[Path, Texture] = {}

    def material(self, material: str, has_uvs: bool) -> Material | None:
        """None where the files say nothing of its colour. Its picture matters to meshes with texture coordinates alone.

        Raises ValueError for files that the rules forbid, for a picture that is missing, and for a bad colour.
        """
        if self._looks is None:
            self._looks = {}
            for path in self._paths():
                self._looks |= _read(path)
        look = self._looks.get(material) or self._looks.get(_without_comment(material))
        if look is None or (look.color is None and look.picture is None):
            return None
        texture = self._texture(look) if look.picture is not None and has_uvs else None
        color = 1.0 if look.color is None else self._color(material, look)
        if texture is None and look.color is None:
            return None
        return Material(color, texture=texture)

    def _paths(self) -> list[Path]:
        """Files, each once. One that is missing is not missed, wherever it should be: many an OBJ file goes without."""
        found: dict[Path, Path] = {}
        for number, given in enumerate(self._given()):
            if number == MOST_NAMES and not self._rules.is_trusted:
                raise ValueError(f"mtllib names more than {MOST_NAMES} files; {ADVICE}")
            file = self._rules.near(given)
            if file is not None:
                path = self._rules.file(file, SUFFIXES, "mtllib")
                found.setdefault(path.resolve(), path)
        return list(found.values())

    def _given(self) -> Iterator[str]:
        """Several names may stand on a line, each of which ends with .mtl; so names may have spaces."""
        for line in self._names:
            yield from (part for part in _ENDS.split(line) if part and not part.startswith("#"))

    def _color(self, material: str, look: _Look) -> float | list[float]:
        """Three numbers, or one of grey."""
        try:
            numbers = [float(word) for word in look.color[:3]]
        except ValueError:
            numbers = []
        if len(numbers) not in (1, 3):
            text = brief(" ".join(look.color))
            warn(self._rules, f"Kd {text} of material {brief(material)} in {look.library.name} is left out")
            return 1.0
        return numbers[0] if len(numbers) == 1 else numbers

    def _texture(self, look: _Look) -> Texture | None:
        """None for a missing picture whose name is one of another machine."""
        picture, options = _without_options(look.picture)
        if options:
            warn(self._rules, f"options of map_Kd in {look.library.name} are left out: {brief(options)}")
        what = f"map_Kd in {look.library.name}"
        folder = look.library.parent
        file = self._rules.near(picture, folder) or self._rules.near(_without_comment(picture), folder)
        if file is None:
            missing = f"there is no picture {brief(picture)}, which {look.library.name} asks for"
            if not _ABSOLUTE.match(picture):
                raise ValueError(missing)
            warn(self._rules, missing)
            return None
        path = self._rules.file(file, PICTURE_SUFFIXES, what, folder)
        key = path.resolve()
        if key not in self._textures:
            self._textures[key] = Texture(read_ruled_picture(path, what, self._rules))
        return self._textures[key]


def _read(path: Path) -> dict[str, _Look]:
    """The materials of a file by name."""
    looks: dict[str, _Look] = {}
    material = None
    for line in io.BytesIO(plain(path.read_bytes())):
        word, _, rest = line.strip(b" \n").partition(b" ")
        key, rest = word.lower(), rest.strip()
        if not rest:
            continue
        if key == b"newmtl":
            material = name(b" ".join(rest.split()))
            looks[material] = _Look(path)
        elif key == b"kd" and material is not None:
            looks[material] = looks[material]._replace(color=name(rest).split())
        elif key == b"map_kd" and material is not None:
            looks[material] = looks[material]._replace(picture=name(rest))
    return looks


def _without_comment(text: str) -> str:
    return text.partition(" #")[0].rstrip()


def _without_options(text: str) -> tuple[str, str]:
    """(name, options before it) of a picture; names may have spaces."""
    words = [(match.group(), match.start()) for match in re.finditer(r"\S+", text)]
    k, last = 0, len(words) - 1  # the last word is a name in any case
    while k < last and words[k][0] in _NUMBERS | _WORDS:
        option = words[k][0]
        end = min(k + 1 + (_NUMBERS | _WORDS)[option], last)
        k += 1
        while k < end and (option in _WORDS or _is_number(words[k][0])):
            k += 1
    return (text[words[k][1] :].strip() if words else ""), " ".join(word for word, _ in words[:k])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
