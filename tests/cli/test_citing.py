"""`cavirheo cite`: sources and numbers that a paper must name."""

import json
import re
from dataclasses import asdict, replace
from itertools import zip_longest
from math import inf
from pathlib import Path

import pytest
from answers import written
from conftest import BDT, EXAMPLE, FIELD, REAL, WATER, done, refusal
from files import write_curve

from cavirheo import Bubble, Medium, infer_many, load, read_curves
from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import ZHU2025


@pytest.fixture(scope="module")
def document(tmp_path_factory) -> dict:
    """Of two shots, as it is written."""
    folder = tmp_path_factory.mktemp("cited")
    curves = read_curves(EXAMPLE)[:2]
    written(folder, list(zip(curves, infer_many(curves, model=BDT[1]), strict=True)), date="2025-01-02", draw=False)
    return json.loads((folder / "result.json").read_text("utf-8"))


@pytest.fixture
def cited(run, document):
    """(the paragraph, its sources by their keys) of the document, whose first curves have these values."""

    def cite(*rows: dict, **changes: object) -> tuple[str, dict[str, str]]:
        curves = [curve | row for curve, row in zip_longest(document["curves"], rows, fillvalue={})]
        Path("result.json").write_text(json.dumps(document | {"curves": curves} | changes, default=asdict), "utf-8")
        paragraph, *entries = done(run("cite", "result.json")).strip().split("\n\n")
        sources = {entry[entry.index("{") + 1 : entry.index(",")]: entry for entry in entries}
        assert len(sources) == len(entries)
        assert {*re.findall(r"[\[ ](\w+\d{4})[\],]", paragraph.partition("Command:")[0])} == {*sources}
        return paragraph, sources

    return cite


def test_the_command_cites_only_what_was_used(run, cited, document):
    assert {"Estrada2018", "Keller1980", "Bu2025"} <= cited()[1].keys()
    failed = [curve | {"verdict": "failed"} for curve in document["curves"]]
    Path("result.json").write_text(json.dumps(document | {"curves": failed}), "utf-8")
    refusal(run("cite", "result.json"), "no curve of this result has an answer")
    Path("other.json").write_text('{"x": 1}')
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
def test_sources_are_those_of_wall_laws_contents_and_comparison(cited, sources):
    row = {"material": "power-law", **CITED[sources]}
    assert cited(row, row)[1].keys() & {*OPTIONAL.split()} == {*sources.split()}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_full_references(law, cited):
    row = {"material": law, "bubble": REAL}
    _, sources = cited(row, row)
    for doi in re.findall(r"doi:(\S+?)[.,;)]*(?=\s|$)", LAWS[law].__doc__ or ""):
        assert any(f"doi = {{{doi}}}" in source for source in sources.values())
    for source in sources.values():
        assert source.count("{") == source.count("}")
        fields = dict(re.findall(r"^  (\w+) = \{(.+)\},?$", source, re.MULTILINE))
        assert {"author", "title", "year"} < {*fields}
        if source.startswith("@article"):
            assert re.fullmatch(r"10\.\d{4,}/\S+", fields["doi"])
            assert "et al" not in fields["author"]


MEDIUMS = [
    (WATER, WATER, "density 998 kg/m3, sound speed 1484 m/s"),
    (ZHU2025, ZHU2025, "zhu2025 [Zhu2025]: density 998.2 kg/m3"),
    (Medium(sound_speed=inf), None, "density 998 kg/m3, sound speed inf m/s"),
]


@pytest.mark.parametrize(("first", "second", "named"), MEDIUMS)
def test_the_medium_is_that_of_each_answer_whatever_the_command_says(cited, first, second, named):
    command = "cavirheo infer 'a.csv --medium yang2020 --density 900"
    paragraph, _ = cited({"medium": first}, {"medium": second}, command=command)
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


def test_priors_and_common_errors_are_those_of_the_answer(run):
    run("infer", EXAMPLE, "--shots", "1", "--no-pictures", "--scale-error", "3", "-o", "one")
    row = load("one").curves[0]
    paragraph = done(run("cite", "one")).partition("Command:")[0]
    for name in ("shear_modulus", "viscosity"):
        low, high = row.provenance["prior"][name][:2]
        assert f"{10.0**low:g} to {10.0**high:g}" in paragraph
    assert "scale 3 %" in paragraph
