"""The pictures of the method pages are made as the pages say."""

from __future__ import annotations

import pytest
from conftest import ROOT, load_benchmark

pytestmark = [pytest.mark.slow, pytest.mark.repository, pytest.mark.needs("matplotlib")]
PICTURES = sorted((ROOT / "docs" / "method").glob("*.png"))
LARGEST = 150_000  # bytes


@pytest.mark.parametrize("picture", PICTURES, ids=lambda path: path.stem)
def test_a_picture_is_made(picture, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    monkeypatch.setattr("sys.argv", ["method_figures.py", picture.stem])
    script = load_benchmark("method_figures")
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    script.main()
    assert max((tmp_path / picture.name).stat().st_size, picture.stat().st_size) < LARGEST
