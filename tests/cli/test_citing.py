"""`cavirheo cite`: what a paper must say of a result."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import inf

import pytest
from conftest import BDT, ROOT

from cavirheo import infer_many, load, read_curves
from cavirheo.io import write_csv
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import WATER, ZHU2025, Medium, medium
from cavirheo.posterior import Evidence
from cavirheo.reporting import result
from cavirheo.reporting.answer import CurveRecord, OtherModel
from cavirheo.reporting.citation import MEDIA, methods, of_law, references
from cavirheo.reporting.material import PopulationRecord
from cavirheo.writing.document import Quantity

EXAMPLE = ROOT / "examples" / "soft_gel.csv"


@pytest.fixture
def answered(run, tmp_path):
    run("infer", EXAMPLE, *BDT, "--shots", "1,2", "--no-pictures", "-o", "r")
    return tmp_path / "r"


@pytest.fixture(scope="module")
def document():
    """Of two shots, by the paper's network."""
    curves = read_curves(EXAMPLE)[:2]
    return result(list(zip(curves, infer_many(curves, model=BDT[1]), strict=True)), "a script", date="2025-01-02")


def test_the_paragraph_says_the_model_and_cites_only_what_was_used(run, answered):
    status, out, _ = run("cite", answered)
    assert status == 0
    assert "2 bubbles (soft_gel: 2" in out
    keys, cited = set(re.findall(r"@\w+\{(\w+),", out)), set(re.findall(r"[\[ ](\w+\d{4})[\],]", out.partition("@")[0]))
    assert keys == cited
    assert {"Estrada2018", "Keller1980", "Bu2025"} <= keys
    assert "Cornuet2012" not in keys


def test_sources_of_every_law_of_a_sum_and_of_kinetic_contents(answered):
    found = load(answered)
    curve = found.curves[0].model_copy(update={"material": "fung + newtonian", "bubble": REAL, "method": "verified"})
    paragraph, sources = methods(found.model_copy(update={"curves": [curve, found.curves[1]]}))
    keys = [source.key for source in sources]
    assert {"Fung1967", "Fuller1966", "Cornuet2012", "Bu2025"} <= set(keys)
    assert len(set(keys)) == len(keys)
    assert "finite rate" in paragraph
    assert all(source.bibtex.count("{") == source.bibtex.count("}") for source in sources)


@pytest.mark.parametrize(
    ("bubble", "said", "keys"),
    [
        (FIELD, "equation of Keller and Miksis [Keller1980], with heat", {"Keller1980", "Estrada2018"}),
        (Bubble(motion="gilmore"), "equation of Gilmore [Gilmore1952], with heat", {"Gilmore1952", "Estrada2018"}),
        (
            Bubble(motion="rayleigh-plesset", exponent=1.4),
            "equation of Rayleigh and Plesset [Plesset1949], with a polytropic gas of exponent 1.4.",
            {"Plesset1949"},
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Bubble) else "",
)
def test_the_equation_of_the_wall_is_the_one_that_was_used(document, bubble, said, keys):
    curves = [curve.model_copy(update={"material": "power-law", "bubble": bubble}) for curve in document.curves]
    paragraph, sources = methods(document.model_copy(update={"curves": curves}))
    assert said in paragraph
    found = {source.key for source in sources}
    assert found & {"Keller1980", "Gilmore1952", "Plesset1949", "Estrada2018"} == keys


def test_rows_of_an_older_file_have_the_usual_motion_and_gas(answered):
    file = answered / "result.json"
    row = json.loads(file.read_text(encoding="utf-8"))
    for curve in row["curves"]:
        assert (curve["bubble"].pop("motion"), curve["bubble"].pop("exponent")) == ("keller-miksis", None)
    file.write_text(json.dumps(row), encoding="utf-8")
    assert [curve.bubble for curve in load(answered).curves] == [FIELD, FIELD]


def test_models_that_were_compared_by_evidence_are_said(document):
    rival = OtherModel(material="newtonian", bubble=FIELD, log_evidence=30.0)
    told = {"other_models": [rival], "evidence": Evidence(2.0), "verdict": "other_model_preferred"}
    worse = document.curves[0].model_copy(update=told)
    paragraph, sources = methods(document.model_copy(update={"curves": [worse, document.curves[1]]}))
    assert "it prefers newtonian, field's bubble in 1 of 1 curve" in paragraph
    assert "1 of 2 curves passed" in paragraph
    assert "Kass1995" in [source.key for source in sources]


def test_one_shot_is_said_with_its_interval_and_only_if_it_counts(document):
    curve = document.curves[0].model_copy(update={
        "shear_modulus_Pa": Quantity(median=6435.1, q05=5124.0, q95=7461.0),
        "viscosity_Pa_s": Quantity(median=0.02942, q05=0.0274, q95=0.03163),
    })  # fmt: skip
    said = "soft_gel: G = 6.4 kPa [5.1, 7.5], µ = 0.0294 Pa s [0.0274, 0.0316]."
    for trusted, verdict in ((1, "ok"), (0, "check_input")):
        group = document.groups[0].model_copy(update={"n": 1, "n_trusted": trusted})
        rows = {"curves": [curve.model_copy(update={"verdict": verdict})], "groups": [group]}
        assert (said in methods(document.model_copy(update=rows))[0]) == bool(trusted)


def fields(bibtex: str) -> dict[str, str]:
    """Of an entry, by name; every value in braces that are closed."""
    assert bibtex.count("{") == bibtex.count("}")
    return dict(re.findall(r"^  (\w+) = \{(.+)\},?$", bibtex, re.MULTILINE))


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_full_references(law, document):
    curves = [curve.model_copy(update={"material": law, "bubble": REAL}) for curve in document.curves]
    paragraph, sources = methods(document.model_copy(update={"curves": curves}))
    assert {source.key for source in of_law(law)} <= {source.key for source in sources}
    assert len(of_law(law)) == len(re.findall("doi:", LAWS[law].__doc__ or ""))
    for source in [*sources, *(references()[key] for key in MEDIA.values())]:
        known = fields(source.bibtex)
        assert {"author", "title", "year"} < set(known)
        if source in sources:
            assert f"[{source.key}" in paragraph or f", {source.key}" in paragraph
        if source.bibtex.startswith("@article"):
            assert re.fullmatch(r"10\.\d{4,}/\S+", known["doi"])
            assert "et al" not in known["author"]


def test_a_group_is_said_by_its_material_else_by_mean_and_deviation(document):
    paragraph, sources = methods(document)
    (group,) = document.groups
    G, mu = group.shear_modulus_Pa, group.viscosity_Pa_s
    table = f"G = {G.mean / 1e3:.2f} +- {G.std / 1e3:.2f} kPa, µ = {mu.mean:.3f} +- {mu.std:.3f} Pa s"
    assert f"soft_gel: {table} (mean and standard deviation of 2 shots)." in paragraph
    assert "Hogg2010" not in paragraph
    line = "G = 5.8 kPa [90 %: 5.1, 6.6], µ = 0.040 Pa s [90 %: 0.035, 0.046]; 8 of 8 shots count"
    spreads = {"shear_modulus": Quantity(median=0.1)}
    material = PopulationRecord(line=line, model="nhkv, equilibrium", n=8, spreads_decades=spreads)
    paragraph, sources = methods(
        document.model_copy(update={"groups": [group.model_copy(update={"population": material})]})
    )
    assert f"soft_gel: {line}." in paragraph
    assert "mean" not in paragraph
    assert "Hogg2010" in {source.key for source in sources}
    none = material.model_copy(update={"line": "no material: too few intervals", "spreads_decades": {}})
    paragraph, _ = methods(document.model_copy(update={"groups": [group.model_copy(update={"population": none})]}))
    assert table in paragraph


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        (WATER, WATER, "the medium are those of water: density 998 kg/m3, sound speed 1484 m/s"),
        (WATER, medium("water", density=1050), "of soft_gel are those of water with changes: density 1050 kg/m3"),
        (ZHU2025, ZHU2025, "those of zhu2025 [Zhu2025]: density 998.2 kg/m3"),
        (
            Medium(sound_speed=inf),
            None,
            "the medium are those of water with changes: density 998 kg/m3, sound speed inf m/s",
        ),
        (None, None, ""),  # of an older version
    ],
)
def test_the_medium_is_that_of_each_answer_whatever_the_command_says(document, first, second, said):
    rows = zip(document.curves, (first, second), strict=True)
    curves = [row.model_copy(update={"medium": liquid}) for row, liquid in rows]
    command = "cavirheo infer 'a.csv --medium yang2020 --density 900"
    read_back = [CurveRecord.model_validate_json(curve.model_dump_json()) for curve in curves]
    assert [curve.medium for curve in read_back] == [first, second]
    paragraph, sources = methods(document.model_copy(update={"command": command, "curves": read_back}))
    assert said in paragraph
    assert ("Constants of the medium" in paragraph) == bool(said)
    assert "900" not in paragraph.partition("Command:")[0]
    for source in sources:
        assert source.key in paragraph


def test_what_cannot_be_cited_is_refused(run, answered, tmp_path):
    found = load(answered)
    failed = [curve.model_copy(update={"verdict": "failed"}) for curve in found.curves]
    assert methods(found.model_copy(update={"curves": failed})) == ("", [])
    (tmp_path / "other.json").write_text('{"x": 1}')
    assert run("cite", "other.json")[0] == 2


def test_a_prior_that_the_file_states_is_named_and_can_be_left_out(run, tmp_path):
    curve = read_curves(EXAMPLE)[0]
    write_csv(tmp_path / "stated.csv", replace(curve, meta={**curve.meta, "stretch": 9.0, "stretch_std": 0.4}))
    (again,) = read_curves(tmp_path / "stated.csv")
    assert (again.stretch, again.stretch_std) == (9.0, 0.4)
    words = ["infer", "stated.csv", "--verify", "map", "--no-pictures"]
    _, out, _ = run(*words)
    (row,) = load("cavirheo-result").curves
    assert row.stretch_prior["mean"] == 9.0
    assert row.stretch_prior["std"] >= 0.4
    paragraph = methods(load("cavirheo-result"))[0]
    assert "stretch_prior.file" in [one.code for one in row.messages]
    assert all("9, taken as ±" in " ".join(said.split()) for said in (out, row.message, paragraph))
    assert "λ" not in paragraph.partition("uniform in the logarithm")[2].partition(")")[0]
    run(*words, "--stretch", "free", "-o", "free")
    (free,) = load("free").curves
    assert free.stretch_prior == {}
    assert "file states" not in methods(load("free"))[0]
    assert free.stretch.median != row.stretch.median
    laws = ("which-law", "stated.csv", "--laws", "nhkv,newtonian", "--stretch", "free", "--no-pictures", "-o", "laws")
    assert run(*laws)[0] in (0, 1)
    assert load("laws/result.json").curves[0].stretch_prior == {}
