"""Snippets of the documentation run, its links lead somewhere, and every public name is in the reference."""

import importlib.util
import re
from pathlib import Path

import pytest
import warp as wp

import warprt

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCK = re.compile(r"(?:^\*\*(?P<library>[^*\n]+)\*\*\n\n)?^```python\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL)
IMPORTED_AS = {"Open3D": "open3d", "Mitsuba": "mitsuba", "trimesh": "embreex", "wp.Mesh": "warp", "PyTorch": "torch"}
"""What the snippets below such a heading need. trimesh has rays of its own, for which it needs more than we install."""


def name_of(path):
    return str(path.relative_to(DOCS))


def blocks(page):
    """(library or None, line before the code, code) of each block of Python."""
    text = page.read_text(encoding="utf-8")
    return [(m["library"], text.count("\n", 0, m.start("code")), m["code"]) for m in BLOCK.finditer(text)]


def runs():
    """Each page that has snippets, and again for each other library that it has snippets of."""
    for page in PAGES:
        for library in dict.fromkeys(library for library, _, _ in blocks(page)):
            yield pytest.param(page, library, id=f"{name_of(page)}-{library}" if library else name_of(page))


@pytest.mark.filterwarnings("default")  # peers and their dependencies warn as they like
@pytest.mark.parametrize(("page", "library"), list(runs()))
def test_snippets_run(page, library, tmp_path, monkeypatch):
    """From top to bottom in one namespace: those of the library, and those of none."""
    if importlib.util.find_spec(IMPORTED_AS.get(library, "warprt")) is None:
        pytest.skip(f"{library} is not installed")
    monkeypatch.chdir(tmp_path)
    if library == "wp.Mesh":
        # Its kernels are compiled here alone, and run for a moment.
        monkeypatch.setattr(wp.config, "optimization_level", 0)
    names = {"__name__": f"snippets_of_{page.stem}"}
    for whose, line, code in blocks(page):
        if whose in (None, library):
            # Errors name the line of the page, where Warp also finds the source of kernels.
            exec(compile("\n" * line + code, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link


def test_public_names_are_in_the_reference():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    documented = set(re.findall(r"^::: warprt\.(?:\w+\.)*(\w+)$", text, re.MULTILINE))
    public = {name for name, value in vars(warprt).items() if getattr(value, "__module__", "").startswith("warprt.")}
    assert public <= documented
