"""Committed notebooks are small, whole and tell nothing of the machine that ran them. CI runs them by nbmake."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MOST_BYTES = 500_000


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture
def notebook(path):
    return json.loads(path.read_text(encoding="utf-8"))


def code_cells(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_there_are_some():
    assert [path.stem[:2] for path in NOTEBOOKS] == ["01", "02", "03", "04", "05", "06"]


def test_is_small(path):
    assert path.stat().st_size < MOST_BYTES


def test_every_cell_ran_once_and_in_order(notebook):
    cells = code_cells(notebook)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))


def test_outputs_hold_no_errors_or_warnings(notebook):
    outputs = [output for cell in code_cells(notebook) for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert all(output["output_type"] != "error" and output.get("name") != "stderr" for output in outputs)


def test_outputs_name_no_place_on_the_machine(notebook):
    texts = [
        json.dumps({**output, "data": {**output.get("data", {}), "image/png": ""}})
        for cell in code_cells(notebook)
        for output in cell["outputs"]
    ]
    assert not [
        text
        for text in texts
        if re.search(r"(?<![\w.])/(?:home|root|tmp|usr|var|opt|work)/|[A-Z]:\\\\|site-packages", text)
    ]


def test_metadata_is_what_any_machine_needs(notebook):
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    assert set(notebook["metadata"]) <= {"kernelspec", "language_info"}
    assert all(cell["metadata"] == {} for cell in notebook["cells"])


def test_links_lead_somewhere(path, notebook):
    text = "\n".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown")
    for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text):
        assert (path.parent / link).exists(), link
