"""`cavirheo cite`: what a paper must say of a result."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import BDT

from cavirheo import InputError, load
from cavirheo.reporting.citing import methods

EXAMPLE = Path(__file__).parent.parent / "examples" / "soft_gel.csv"


@pytest.fixture
def answered(run, tmp_path):
    run("infer", EXAMPLE, *BDT, "--shots", "1,2", "--no-pictures", "-o", "r")
    return tmp_path / "r"


def test_the_paragraph_says_the_model_and_cites_only_what_was_used(run, answered):
    status, out, _ = run("cite", answered)
    assert status == 0
    assert "2 bubbles (soft_gel: 2" in out
    keys, cited = set(re.findall(r"@\w+\{(\w+),", out)), set(re.findall(r"[\[ ](\w+\d{4})[\],]", out.partition("@")[0]))
    assert keys == cited
    assert {"Estrada2018", "Keller1980", "Bu2025"} <= keys
    assert "Cornuet2012" not in keys


def test_sources_of_every_law_of_a_sum_and_of_kinetic_contents(answered):
    result = load(answered)
    curve = result.curves[0].model_copy(
        update={"material": "fung + newtonian", "contents": "kinetic", "method": "verified"}
    )
    paragraph, sources = methods(result.model_copy(update={"curves": [curve, result.curves[1]]}))
    keys = [source.key for source in sources]
    assert {"Fung1967", "Fuller1966", "Cornuet2012", "Bu2025"} <= set(keys)
    assert len(set(keys)) == len(keys)
    assert "finite rate" in paragraph
    assert all(source.bibtex.count("{") == source.bibtex.count("}") for source in sources)


def test_what_cannot_be_cited_is_refused_and_nothing_is_replaced(run, answered, tmp_path):
    assert run("cite", answered, "-o", "methods.txt")[0] == 0
    kept = Path("methods.txt").read_text()
    status, _, said = run("cite", answered, "-o", "methods.txt")
    assert status == 2
    assert "methods.txt" in said
    assert Path("methods.txt").read_text() == kept
    result = load(answered)
    failed = [curve.model_copy(update={"verdict": "failed"}) for curve in result.curves]
    with pytest.raises(InputError) as caught:
        methods(result.model_copy(update={"curves": failed}))
    assert caught.value.code == "cite.nothing"
    (tmp_path / "other.json").write_text('{"x": 1}')
    assert run("cite", "other.json")[0] == 2
