"""Hooks of mkdocs: pages link to the repository's own files, and snippets of several libraries stand side by side.

Pages are written for a reader of the repository as well. A link such as `../kernels/spec.py` leads to that file there;
in the site it leads to a page that shows the file, a notebook to a page with its text, code and outputs, a picture to
its copy, and a folder to a list of its files.
"""

import json
import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File, InclusionLevel

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(?<=\]\()(\.\./[^)\s#]*)(?=[)#])")
PICTURES = {".png", ".jpg"}
SHOWN = {".py": "python", ".cfg": "text", ".toml": "toml", ".md": "markdown", "": "text"}
OPEN, HALF, CLOSE = '<div class="grid" markdown>', "<div markdown>", "</div>"
LIBRARY = re.compile(r"^\*\*([^*\n]+)\*\*\n\n(```python\n.*?\n```)\n+", re.MULTILINE | re.DOTALL)


def on_files(files, config):
    """Adds a page, or a copy, for each file of the repository that a page links to."""
    for page in list(files.documentation_pages()):
        for _, target in _outward(page.src_uri, page.content_string):
            uri = _site_uri(target)
            if files.get_file_from_path(uri) is not None:
                continue
            source = ROOT / target
            if source.suffix in PICTURES:
                files.append(File.generated(config, uri, abs_src_path=str(source)))
            else:
                text = _listing(source) if source.is_dir() else _shown(source)
                files.append(File.generated(config, uri, content=text, inclusion=InclusionLevel.NOT_IN_NAV))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turns links out of docs/ to what `on_files` has added, and snippets of libraries into columns."""
    here = posixpath.dirname(page.file.src_uri)
    for link, target in set(_outward(page.file.src_uri, markdown)):
        uri = posixpath.relpath(_site_uri(target), here or ".")
        markdown = re.sub(rf"(?<=\]\(){re.escape(link)}(?=[)#])", uri, markdown)
    return _side_by_side(markdown) if page.meta.get("snippets") == "side by side" else markdown


def _outward(src_uri, markdown):
    """(link, file of the repository) of each relative link that leaves docs/. What does not exist is left to mkdocs."""
    for link in LINK.findall(markdown):
        target = posixpath.normpath(posixpath.join("docs", posixpath.dirname(src_uri), link))
        if not target.startswith(("docs/", "..")) and (ROOT / target).exists():
            yield link, target


def _site_uri(target):
    """Where a file of the repository comes to lie among the pages."""
    return f"source/{target}" if Path(target).suffix in PICTURES else f"source/{target}.md"


def _shown(source):
    """A page with the text of a file."""
    text = source.read_text(encoding="utf-8")
    if source.suffix == ".ipynb":
        return _notebook(json.loads(text))
    return f"# {source.relative_to(ROOT)}\n\n{_fenced(text, SHOWN[source.suffix])}\n"


def _notebook(notebook):
    """A page with the cells of a notebook, and what they gave."""
    parts = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            # Notebooks link to each other by the names of their files.
            parts.append(re.sub(r"(?<=\]\()(\w+\.ipynb)(?=\))", r"\1.md", text))
        else:
            parts += [_fenced(text, "python"), *map(_output, cell["outputs"])]
    return "\n\n".join(parts) + "\n"


def _output(output):
    """What a cell gave: a picture, Markdown, or text."""
    data = output.get("data", {"text/plain": output.get("text", "")})
    if "image/png" in data:
        return f'<img alt="" src="data:image/png;base64,{"".join(data["image/png"]).strip()}">'
    if "text/markdown" in data:
        return "".join(data["text/markdown"])
    return _fenced("".join(data["text/plain"]), "text")


def _fenced(text, language):
    fence = "`" * 4
    return f"{fence} {language}\n{text.rstrip()}\n{fence}"


def _listing(folder):
    """A page with the names of a folder's files."""
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith(("_", ".")))
    return f"# {folder.relative_to(ROOT)}\n\n" + "".join(f"- {name}\n" for name in names)


def _side_by_side(markdown):
    """Runs of a bold library name and a block of code: ours in one column, the others as tabs in the other."""

    def columns(run):
        blocks = dict(LIBRARY.findall(run.group()))
        ours = blocks.pop("warprt")
        tabs = "".join(_tab(*block) for block in blocks.items())
        return "".join(f"{line}\n\n" for line in (OPEN, HALF, tabs, CLOSE, HALF, _tab("warprt", ours), CLOSE, CLOSE))

    return re.sub(f"(?:{LIBRARY.pattern}){{2,}}", columns, markdown + "\n", flags=LIBRARY.flags)


def _tab(name, block):
    """A tab that shows a block of code."""
    return f'=== "{name}"\n\n' + "\n".join("    " + line for line in block.split("\n")) + "\n\n"
