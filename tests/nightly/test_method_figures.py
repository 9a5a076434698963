"""The pictures of the method pages are made as the pages say, and their captions have the numbers of today."""

from __future__ import annotations

import re
from itertools import chain

import pytest
from conftest import ROOT, load_benchmark

pytestmark = [pytest.mark.slow, pytest.mark.repository, pytest.mark.needs("matplotlib")]
PAGES = ROOT / "docs" / "method"
LARGEST = 150_000  # bytes
OF = r"([\d.]+)"
TOLD = {  # picture: its page; where the script prints the numbers of the caption, and their factors there
    "contents": ("physics", {rf"rebound to {OF}": 1.0, rf"after {OF} us": 1.0}),
    "laws": ("physics", {}),
    "draws": ("posterior", {rf"shear_modulus \S+ \[ *{OF} +{OF}": 1e-3, rf"viscosity \S+ \[ *{OF} +{OF}": 1.0}),
    "ridge": ("posterior", {rf"viscosity \[ *{OF} +{OF}": 1.0}),
    "verdicts": ("verdicts", {rf"RMSE {OF} %": 1.0, rf"model_does.*shear_modulus \[ *{OF} +{OF}": 1e-3}),
    "material": ("population", {rf"G = {OF} kPa \[90 %: {OF}, {OF}": 1.0, rf"µ = {OF} Pa s \[90 %: {OF}, {OF}": 1.0}),
}


def caption(page: str, name: str) -> str:
    """What follows a picture, up to how it is made again."""
    return page.partition(f"]({name}.png)")[2].partition(f"`python benchmarks/method_figures.py {name}`")[0]


@pytest.mark.parametrize("name", TOLD)
def test_a_picture_is_made_and_its_caption_is_true(name, monkeypatch, tmp_path, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    monkeypatch.setattr("sys.argv", ["method_figures.py", name])
    script = load_benchmark("method_figures")
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    script.main()
    assert max((folder / f"{name}.png").stat().st_size for folder in (tmp_path, PAGES)) < LARGEST
    page, numbers = TOLD[name]
    text, said = caption((PAGES / f"{page}.md").read_text("utf-8"), name), capsys.readouterr().out
    shown = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]
    for pattern, factor in numbers.items():
        found = [factor * float(number) for number in chain(*map(_each, re.findall(pattern, said)))]
        assert found
        assert [one for one in found if not any(other == pytest.approx(one, rel=0.05) for other in shown)] == []


def _each(found: str | tuple[str, ...]) -> tuple[str, ...]:
    return (found,) if isinstance(found, str) else found


def test_every_picture_of_the_method_is_tested():
    assert {path.stem for path in PAGES.glob("*.png")} == set(TOLD)
    pages = {name: caption((PAGES / f"{page}.md").read_text("utf-8"), name) for name, (page, _) in TOLD.items()}
    assert [name for name, text in pages.items() if len(text) < 100] == []
