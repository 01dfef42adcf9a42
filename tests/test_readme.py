"""What README.md says is true."""

import re
from pathlib import Path

import numpy as np
import pytest

from warprt.benchmarks import page

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1), names)
    assert (tmp_path / "rings.png").stat().st_size > 10_000
    assert np.isfinite(names["hits"].t).all()


@pytest.mark.parametrize("name", page.PAGES)
def test_tables_are_those_of_the_results(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    assert "<!-- table: " in text
    assert page.filled(text) == text, "run python -m warprt.benchmarks.page"


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\((?!https?:)([^)]+)\)", README))))
def test_link_leads_somewhere(link):
    assert (ROOT / link).exists()
