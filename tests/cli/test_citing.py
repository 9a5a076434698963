"""`cavirheo cite`: sources and numbers that a paper must name."""

import re
from dataclasses import replace
from itertools import zip_longest
from math import inf

import pytest
from conftest import BDT, EXAMPLE, FIELD, REAL, WATER, done, refusal
from files import write_curve

from cavirheo import Bubble, Medium, infer_many, load, read_curves
from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import ZHU2025
from cavirheo.reporting import result
from cavirheo.reporting.citation import MEDIUM_KEYS, methods_paragraph, references, references_of_law
from cavirheo.writing.document import write_json


@pytest.fixture(scope="module")
def document():
    curves = read_curves(EXAMPLE)[:2]
    return result(list(zip(curves, infer_many(curves, model=BDT[1]), strict=True)), "a script", date="2025-01-02")


def cited(document, *rows: dict, **changes) -> tuple[str, set[str]]:
    """The paragraph of the document, whose first curves have these values, and the keys of its sources."""
    curves = [curve.model_copy(update=row) for curve, row in zip_longest(document.curves, rows, fillvalue={})]
    paragraph, sources = methods_paragraph(document.model_copy(update={"curves": curves, **changes}))
    keys = {source[source.index("{") + 1 : source.index(",")] for source in sources}
    assert len(keys) == len(sources)
    assert [key for key in keys if key not in paragraph] == []
    return paragraph, keys


def test_the_command_cites_only_what_was_used(run, document, tmp_path):
    write_json(tmp_path / "result.json", document)
    out = done(run("cite", "result.json"))
    keys, named = set(re.findall(r"@\w+\{(\w+),", out)), set(re.findall(r"[\[ ](\w+\d{4})[\],]", out.partition("@")[0]))
    assert keys == named
    assert {"Estrada2018", "Keller1980", "Bu2025"} <= keys
    failed = [curve.model_copy(update={"verdict": "failed"}) for curve in document.curves]
    assert methods_paragraph(document.model_copy(update={"curves": failed})) == ("", [])
    (tmp_path / "other.json").write_text('{"x": 1}')
    refusal(run("cite", "other.json"))


OPTIONAL = "Keller1980 Gilmore1952 Plesset1949 Estrada2018 Fung1967 Fuller1966 Cornuet2012 Kass1995"
CITED = {  # an answer's sources among these, and what it has
    "Keller1980 Estrada2018": {"bubble": FIELD},
    "Gilmore1952 Estrada2018": {"bubble": Bubble(motion="gilmore")},
    "Plesset1949": {"bubble": Bubble(motion="rayleigh-plesset", exponent=1.4)},
    "Keller1980 Estrada2018 Fung1967 Fuller1966": {"material": "fung + newtonian", "bubble": REAL},
    "Keller1980 Estrada2018 Cornuet2012": {"method": "verified"},
}


@pytest.mark.parametrize("sources", CITED)
def test_sources_are_those_of_wall_laws_contents_and_comparison(document, sources):
    row = {"material": "power-law", **CITED[sources]}
    assert cited(document, row, row)[1] & {*OPTIONAL.split()} == {*sources.split()}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_full_references(law, document):
    row = {"material": law, "bubble": REAL}
    assert {*references_of_law(law)} <= cited(document, row, row)[1]
    assert len(references_of_law(law)) == len(re.findall("doi:", LAWS[law].__doc__ or ""))
    for source in (references()[key] for key in [*references_of_law(law), *MEDIUM_KEYS.values()]):
        assert source.count("{") == source.count("}")
        fields = dict(re.findall(r"^  (\w+) = \{(.+)\},?$", source, re.MULTILINE))
        assert {"author", "title", "year"} < set(fields)
        if source.startswith("@article"):
            assert re.fullmatch(r"10\.\d{4,}/\S+", fields["doi"])
            assert "et al" not in fields["author"]


MEDIUMS = [
    (WATER, WATER, "density 998 kg/m3, sound speed 1484 m/s"),
    (ZHU2025, ZHU2025, "zhu2025 [Zhu2025]: density 998.2 kg/m3"),
    (Medium(sound_speed=inf), None, "density 998 kg/m3, sound speed inf m/s"),
]


@pytest.mark.parametrize(("first", "second", "named"), MEDIUMS)
def test_the_medium_is_that_of_each_answer_whatever_the_command_says(document, first, second, named):
    command = "cavirheo infer 'a.csv --medium yang2020 --density 900"
    paragraph, _ = cited(document, {"medium": first}, {"medium": second}, command=command)
    assert named in paragraph
    assert "900" not in paragraph.partition("Command:")[0]


def test_a_prior_that_the_file_states_is_named_and_can_be_left_out(run, tmp_path):
    curve = read_curves(EXAMPLE)[0]
    write_curve(tmp_path / "stated.csv", replace(curve, meta={**curve.meta, "stretch": 9.0, "stretch_std": 0.4}))
    words = ["infer", "stated.csv", "--material", "nhkv", "--bubble", "field", "--no-pictures"]
    run(*words)
    run(*words, "--stretch", "free", "-o", "free")
    (row,), (free,) = load("cavirheo-result").curves, load("free").curves
    assert (row.stretch_prior["mean"], free.stretch_prior) == (9.0, {})
    assert row.stretch_prior["std"] >= 0.4
    assert "stretch_prior.file" in [one.code for one in row.messages]
    assert free.stretch.median != row.stretch.median
