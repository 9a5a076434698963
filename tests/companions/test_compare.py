"""`cavirheo compare`: published values beside ours; nothing is dropped, and mistakes in the CSV file are named."""

import json
import sys
from pathlib import Path

import pytest
from answers import answer as answer_of
from answers import unanswered
from conftest import BDT, EXAMPLE, ROOT, code_of, done, refusal, refused, rows_of

from cavirheo import load, read_curves
from cavirheo.companions.comparison import AnswerSettings, compare
from cavirheo.companions.published_values import ReferenceSet, read_references
from cavirheo.inference.analysis import Analysis
from cavirheo.io import write_csv
from cavirheo.physics.bubble import FIELD

HEAD = "set,files,density,method,quantity,mean,std"
REFERENCES = f"""# by hand
{HEAD}
gel a,gel_a,1003,IMR,G_kPa,8,1.5

gel a,,,IMR,mu_Pa_s,0.020,0.009
gel a,,,BDT,G_kPa,6,
gel a,,,BDT,mu_mPa_s,35,10
gel a,,,rheometer,G_Pa,2000,
gone,nowhere/*.mat,,IMR,G_kPa,5,1
bare.csv,,,,,,
"""
ANSWERS = {"shot0": (5e3, 0.01, "ok"), "shot1": (7e3, 0.03, "ok"), "shot2": (9e3, 0.05, "ok")}


@pytest.fixture
def folder(tmp_path) -> Path:
    """gel_a: three shots, one that cannot be answered, a file that cannot be read and one that is no measurement."""
    data, gel = tmp_path / "data", tmp_path / "data" / "gel_a"
    gel.mkdir(parents=True)
    places = (gel / "shot0.csv", gel / "shot1.csv", gel / "shot2.csv", data / "bare.csv")
    for path, curve in zip(places, read_curves(EXAMPLE), strict=False):
        write_csv(path, curve)
    (gel / "three.csv").write_text("time_us,radius_um\n0,100\n1,90\n2,80\n")
    (gel / "torn.mat").write_bytes(b"")
    (gel / "protocol.docx").write_bytes(b"PK")
    (data / "published.csv").write_text(REFERENCES)
    return data


@pytest.fixture
def fake(monkeypatch):
    """Known answers instead of inference; returns the settings it was called with."""
    calls = []

    def answer(asked, curve, *_, **__):
        calls.append(asked)
        if len(curve.time) < 5:
            return unanswered("3 frames")
        shear, viscosity, verdict = ANSWERS.get(curve.name.rpartition("/")[2], (4e3, 0.02, "ok"))
        material = "newtonian" if asked.model == "bdt-viscous" else "nhkv"
        return answer_of(curve, shear, viscosity, verdict=verdict, material=material, draws=200)

    monkeypatch.setattr(Analysis, "answer", answer)
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # other processes would answer themselves
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    return calls


def test_the_command_answers_as_infer_does(run, folder, tmp_path):
    sets(folder, "gel,gel_a/shot1.csv,1003,IMR,G_kPa,6.44,1.64")
    done(run("compare", "data", *BDT, "--references", "data/sets.csv", "-o", "c"))
    run("infer", "data/gel_a/shot1.csv", *BDT, "--density", "1003", "-o", "i")
    here, there = (json.loads((tmp_path / name / "result.json").read_text()) for name in ("c", "i"))
    assert [c["shear_modulus_Pa"] for c in here["curves"]] == [c["shear_modulus_Pa"] for c in there["curves"]]
    (group,) = here["groups"]
    value = there["groups"][0]["population"]["shear_modulus_Pa"]["median"]
    assert group["population"]["shear_modulus_Pa"]["median"] == value
    assert group["published"]["IMR"]["shear_modulus"]["mean"] == 6440.0
    assert group["errors"]["IMR"]["cavirheo"]["shear_modulus"] == pytest.approx(abs(value - 6440) / 6440)


def test_a_result_is_compared_without_a_new_answer(run, fake, folder, tmp_path):
    compare(folder, folder / "published.csv", tmp_path / "c")
    before = json.loads((tmp_path / "c" / "result.json").read_text())
    groups = [group for group in before["groups"] if group["name"] != "gone"]
    before["groups"] = [{key: group[key] for key in group.keys() - {"published", "errors"}} for group in groups]
    answers = tmp_path / "answers.json"
    answers.write_text(json.dumps(before))
    fake.clear()
    words = ("compare", "answers.json", "--references", "data/published.csv")
    assert run(*words, "-o", "d")[0] == 1
    assert not fake
    one, other = (load(tmp_path / name) for name in ("c", "d"))
    assert [group.errors for group in one.groups] == [group.errors for group in other.groups]
    assert [group.name for group in other.groups] == ["gel a", "gone", "bare.csv"]
    assert (tmp_path / "d" / "comparison.csv").read_text() == (tmp_path / "c" / "comparison.csv").read_text()
    assert run(*words, "--material", "nhkv", "-o", "g")[0] == 2
    shown, *_ = compare(answers, sets(folder, "other name,,,IMR,G_kPa,8,"), tmp_path / "e")
    assert ["IMR" in group.published for group in shown.groups] == [True, True]  # the only set is that of all groups
    two = sets(folder, "this,,,IMR,G_kPa,8,", "that,,,IMR,G_kPa,9,")
    with refused("references.groups", "groups gel a", "--set GROUP=SET"):
        compare(answers, two, tmp_path / "f")
    for pair in ("gel a=those", "gel=this", "this"):
        with refused("references.pair", pair):
            compare(answers, two, tmp_path / "f", pairing=[pair])
    words = ("compare", "answers.json", "--references", "data/sets.csv", "--set", "bare.csv=that", "-o", "f")
    assert run(*words)[0] == 1
    published = {group.name: group.published for group in load(tmp_path / "f").groups}
    assert published["gel a"] == {}
    assert published["bare.csv"]["IMR"]["shear_modulus"].mean == 9e3
    assert "this" in published
    answers.write_text(json.dumps(before | {"groups": before["groups"][:1], "curves": before["curves"][:3]}))
    shown, *_ = compare(answers, two, tmp_path / "g", pairing=["this"])
    assert shown.groups[0].published["IMR"]["shear_modulus"].mean == 8e3


def test_a_folder_of_answers_is_no_folder_of_recordings(fake, run, folder, tmp_path):
    compare(folder, folder / "published.csv", tmp_path / "c")
    for source, named in (("c", "give c/result.json"), ("data", "give the folder that holds them")):
        values = sets(folder, *(f"set {k},none/*.mat,,IMR,G_kPa,8," for k in range(40)), "closed,-,,IMR,G_kPa,8,")
        refusal(run("compare", source, "--references", values, "-o", "d"), named)
    made, unread, _ = compare(tmp_path, sets(folder, "all,*/*.[cj]s*,,IMR,G_kPa,8,"), tmp_path / "e")
    assert {curve.source for curve in made.curves} == {str(tmp_path / "data" / "bare.csv")}
    assert (unread, "result.json" in " ".join(made.notes)) == (1, True)  # published.csv


def sets(folder: Path, *rows: str, head: str = HEAD) -> Path:
    (folder / "sets.csv").write_text("\n".join([head, *rows, ""]))
    return folder / "sets.csv"


EXPECTED = {  # of gel a, in the table of each comparison
    "shear_modulus_Pa": {
        "IMR_mean": 8e3, "IMR_std": 1.5e3, "BDT_mean": 6e3, "rheometer_mean": 2e3,
        "BDT_error_to_IMR": 0.25, "rheometer_error_to_IMR": 0.75, "IMR_error_to_rheometer": 3.0,
    },
    "viscosity_Pa_s": {"BDT_mean": 0.035, "BDT_std": 0.010, "BDT_error_to_IMR": 0.75},  # given in mPa s
}  # fmt: skip


def test_relative_errors_are_exact(fake, folder, tmp_path):
    compare(folder, folder / "published.csv", tmp_path / "c")
    rows = {(row["set"], row["quantity"]): row for row in rows_of(tmp_path / "c" / "comparison.csv")}
    for quantity, expected in EXPECTED.items():
        found = rows["gel a", quantity]
        assert {name: float(found[name]) for name in expected} == pytest.approx(expected)
    ours = {
        name: float(value) for name, value in rows["gel a", "shear_modulus_Pa"].items() if "cavirheo" in name and value
    }
    assert 5e3 < ours["cavirheo"] < 9e3  # of the population of three shots
    assert ours["cavirheo_error_to_IMR"] == pytest.approx(abs(ours["cavirheo"] / 8e3 - 1.0))
    assert ours["cavirheo_error_to_rheometer"] == pytest.approx(ours["cavirheo"] / 2e3 - 1.0)
    nothing = ("rheometer_mean", "cavirheo_error_to_rheometer")
    assert [rows["gel a", "viscosity_Pa_s"][name] for name in nothing] == ["", ""]
    assert rows["gel a", "shear_modulus_Pa"]["BDT_std"] == rows["gone", "shear_modulus_Pa"]["cavirheo"] == ""
    only, *_ = compare(folder, folder / "published.csv", tmp_path / "c", reference_methods=["BDT"])
    (errors,) = only.groups[0].errors.values()
    ours = abs(only.groups[0].value("shear_modulus").median / 6e3 - 1.0)
    expected = {"IMR": 1 / 3, "rheometer": 2 / 3, "cavirheo": ours}
    assert {method: of["shear_modulus"] for method, of in errors.items()} == pytest.approx(expected, abs=1e-12)


def test_nothing_is_dropped(fake, run, folder, tmp_path):
    status, out, _ = run("compare", "data", "--references", "data/published.csv", "-o", "c")
    assert status == 2
    assert {(one.model, one.material, one.bubble) for one in fake} == {("posterior", "nhkv", FIELD)}
    made = load(tmp_path / "c")
    gel, gone, bare = made.groups
    assert (gel.n, gel.n_failed) == (3, 1)
    assert gel.verdicts == {"ok": 3, "failed": 1}
    assert (gone.n, gone.n_failed, gone.population, list(gone.errors)) == (0, 0, None, ["IMR"])
    assert bare.published == {}
    for word in ("torn.mat", "nowhere/*.mat"):
        assert any(word in note for note in made.notes)
    for word in ("gone", "torn.mat", "3 of 4"):
        assert word in " ".join(out.split())
    sets(folder, "gel_a,,,,,,")
    for removed, expected in (("torn.mat", 1), ("three.csv", 0)):
        (folder / "gel_a" / removed).unlink()
        assert run("compare", "data", "--references", "data/sets.csv", "-o", removed)[0] == expected


def test_published_values_can_be_read(tmp_path):
    by_name = {about.name: about for about in read_references(ROOT / "examples" / "published_values.csv")}
    assert (len(by_name), sum(not about.recorded for about in by_name.values())) == (13, 7)
    assert by_name["PAAm-alginate 0.3 %"].values["IMR"]["shear_modulus"].mean == 6440.0
    assert not by_name["PEG 8000 40 w/v %"].solid
    assert by_name["agarose 2.5 %"].medium.density == 1025
    (about,) = read_references(sets(tmp_path, '"gel, 1";IMR;G_kPa;6,44', head="set;method;quantity;mean"))
    assert (about.name, about.values["IMR"]["shear_modulus"].mean) == ("gel, 1", 6440.0)
    names = [about.name for about in read_references(sets(tmp_path, "gel 1 %", "gel 2 %", head="set"))]
    assert names == ["gel 1 %", "gel 2 %"]


def test_a_liquid_has_no_shear_modulus(fake, folder, tmp_path):
    head = "set,files,model,method,quantity,mean,std"
    values = ("PEG,gel_a/shot?.csv,bdt-viscous,IMR,mu_Pa_s,0.06,0.01", "odd,gel_a/shot0.csv,bdt-viscous,IMR,G_kPa,1,")
    made, *_ = compare(folder, sets(folder, *values, head=head), tmp_path / "c")
    rows = rows_of(tmp_path / "c" / "comparison.csv")
    quantities = [("PEG", "viscosity_Pa_s"), ("odd", "shear_modulus_Pa"), ("odd", "viscosity_Pa_s")]
    assert [(one["set"], one["quantity"]) for one in rows] == quantities
    viscosity = made.groups[0].value("viscosity").median
    assert made.groups[0].errors["IMR"]["cavirheo"]["viscosity"] == pytest.approx(abs(viscosity / 0.06 - 1.0))
    assert rows[1]["cavirheo"] == ""


def test_settings_reach_the_inference(fake, folder, tmp_path):
    head = "set,files,model,material,window,stretch,rmax_um,medium,density,sound_speed,surface_tension,"
    head += "pressure,temperature"
    values = ("bare.csv,,posterior,power-law,2,7.5,210,zhu2025,1040,1500,0,90000,300", "all,*.csv,,,,,,,,,,,")
    (folder / "published.csv").unlink()
    how = AnswerSettings("bdt-viscoelastic")
    made, unread, _ = compare(folder, sets(folder, *values, head=head), tmp_path / "c", settings=how)
    first, second = fake
    assert (first.model, first.window, first.stretch) == ("posterior", 2, 7.5)
    assert (first.material, first.bubble) == ("power-law", FIELD)
    medium = first.medium
    assert (medium.density, medium.sound_speed, medium.surface_tension) == (1040, 1500, 0)
    assert (medium.pressure, medium.temperature) == (90000, 300)
    assert (second.model, second.window, second.medium.density) == ("bdt-viscoelastic", None, 998.0)
    assert made.curves[0].max_radius_m == pytest.approx(210e-6)
    assert ([curve.name for curve in made.curves], unread) == (["bare.csv/bare", "all/bare"], 0)


BAD = {  # text: (where, code, what is named)
    "": ("", "no_set_column", "no rows"),
    HEAD: ("", "no_set", ""),
    "set,densty\na,1": ("line 1, column densty", "head", "density"),
    "set,set\na,b": ("line 1, column set", "head", "2 times"),
    f"{HEAD}\n,x,,IMR,G_Pa,1,": ("line 2, column set", "set", ""),
    f"{HEAD}\n# a comment\n\na,,,IMR,G,1,": ("line 4, column quantity", "quantity", "'G'"),
    f"{HEAD}\na,,,,G_Pa,1,": ("line 2, column method", "method", "''"),
    f"{HEAD}\na,,,cavirheo,G_Pa,1,": ("line 2, column method", "method", "'cavirheo'"),
    f"{HEAD}\na,,,IMR,G_Pa,6.4 kPa,": ("line 2, column mean", "mean", "'6.4 kPa'"),
    f"{HEAD}\na,,,IMR,G_Pa,nan,1": ("line 2, column mean", "mean", "'nan'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,-1": ("line 2, column std", "std", "'-1'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,2,Bu, 2025": ("", "cells", "row 2 has 9 cells"),
    f"{HEAD}\na,,,IMR,G_Pa,1,\na,,,IMR,G_kPa,1,": ("line 3, column quantity", "quantity", "shear_modulus of 'a'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,\na,,,imr,mu_Pa_s,1,": ("line 3, column method", "method", "'IMR' as in"),
    f"{HEAD}\na,,998,IMR,G_Pa,1,\na,,999,,,,": ("line 3, column density", "density", "r.csv, line 2"),
    f"{HEAD}\na,,heavy,,,,": ("line 2, column density", "density", "'heavy'"),
    "set,window\na,1.5": ("line 2, column window", "window", "'1.5'"),
    "set,medium\na,honey": ("line 2, set 'a'", "physics.unknown_medium", "'honey'"),
    "set,model\na,\na,nobody": ("line 2, set 'a'", "model.unknown", "'nobody'"),
    "set,stretch\na,0.5": ("line 2, set 'a'", "option.stretch", "0.5"),
}


@pytest.mark.parametrize("text", BAD)
def test_mistakes_in_the_file_are_named(tmp_path, text):
    (tmp_path / "r.csv").write_text(text)
    where, code, what = BAD[text]
    with refused(code if "." in code else f"references.{code}", "r.csv", where, what):
        compare(tmp_path, tmp_path / "r.csv", tmp_path / "c")
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("source", "values", "out", "methods", "code"),
    [
        (".", "none.csv", "../c", (), "reading.missing"),
        ("bare.csv", "published.csv", "../c", (), "compare.folder"),
        (".", "published.csv", "../c", ("imr",), "compare.method"),
        (".", "published.csv", "bare.csv", (), "document.folder"),
    ],
)
def test_other_mistakes(fake, folder, source, values, out, methods, code):
    assert code_of(compare, folder / source, folder / values, folder / out, reference_methods=methods) == code


def test_a_set_without_a_recording_has_its_published_values(fake, run, folder, tmp_path):
    sets(folder, "open,gel_a/shot?.csv,,IMR,G_kPa,8,1.5", "closed,-,,IMR,G_kPa,30,4", "closed,,,BDT,G_kPa,39,12")
    done(run("compare", "data", "--references", "data/sets.csv", "-o", "c"))
    made = load(tmp_path / "c")
    _, closed = made.groups
    assert (closed.name, closed.n, closed.n_failed) == ("closed", 0, 0)
    assert closed.errors == {"IMR": {"BDT": {"shear_modulus": pytest.approx(0.3)}}}
    assert len([note for note in made.notes if note.startswith("closed: ")]) == 1
    names = ("..", "/", "bare.csv")
    odd, *_ = compare(folder, sets(folder, *(f"{name},,,IMR,G_kPa,8,1" for name in names)), tmp_path / "d")
    assert [group.n for group in odd.groups] == [0, 0, 1]


def test_the_law_is_taken_from_what_is_published():
    gel, liquid = (ReferenceSet(x, x, values={"IMR": {x: None}}) for x in ("shear_modulus", "viscosity"))
    assert [AnswerSettings().analysis(one).material for one in (gel, liquid)] == ["nhkv", "newtonian"]
    networks = [AnswerSettings("bdt-viscoelastic").analysis(one).model for one in (gel, liquid)]
    assert networks == ["bdt-viscoelastic", "bdt-viscous"]
    assert AnswerSettings(material="zener").analysis(liquid).material == "zener"
