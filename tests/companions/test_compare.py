"""`infer --references` and `compare`: published values beside ours; mistakes in the CSV file are named."""

from pathlib import Path

import pytest
from answers import answer as answer_of
from conftest import ANSWER, EXAMPLE, ROOT, done, refusal, refused, rows_of
from files import write_curve

from cavirheo import load, read_curves
from cavirheo.companions.published_values import read_references

HEAD = "set,files,method,quantity,mean,std"
REFERENCES = f"""# by hand
{HEAD}
gel a,gel_a,IMR,G_kPa,8,1.5

gel a,,IMR,mu_Pa_s,0.020,0.009
gel a,,BDT,G_kPa,6,
gel a,,BDT,mu_mPa_s,35,10
gel a,,rheometer,G_Pa,2000,
gone,nowhere/*.mat,IMR,G_kPa,5,1
bare.csv,,,,,
"""
ANSWERS = {"shot0": (6e3, 0.025), "shot1": (7e3, 0.03), "shot2": (8e3, 0.035)}


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """gel_a with three shots, bare.csv and published.csv; answers are known."""

    def answer(asked, curve, *_, **__):
        return answer_of(curve, *ANSWERS.get(curve.name, (4e3, 0.02)), verdict="ok", material="nhkv", draws=200)

    monkeypatch.setattr(ANSWER, answer)
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # other processes would answer themselves
    data = tmp_path / "data"
    (data / "gel_a").mkdir(parents=True)
    places = (*(data / "gel_a" / f"shot{k}.csv" for k in range(3)), data / "bare.csv")
    for path, curve in zip(places, read_curves(EXAMPLE), strict=False):
        write_curve(path, curve)
    (tmp_path / "published.csv").write_text(REFERENCES)
    return data


def sets(folder: Path, *rows: str, head: str = HEAD) -> Path:
    (folder / "sets.csv").write_text("\n".join([head, *rows, ""]))
    return folder / "sets.csv"


INFER = ("infer", "data/gel_a", "data/bare.csv", "--no-pictures", "--quiet")
EXPECTED = {  # of gel a, by quantity and method: value, standard deviation, errors to IMR and to the rheometer
    ("shear_modulus_Pa", "IMR"): (8e3, 1.5e3, "", 3.0),
    ("shear_modulus_Pa", "BDT"): (6e3, "", 0.25, 2.0),
    ("shear_modulus_Pa", "rheometer"): (2e3, "", 0.75, ""),
    ("viscosity_Pa_s", "BDT"): (0.035, 0.010, 0.75, ""),  # given in mPa s
}


def test_relative_errors_are_exact_and_no_set_is_dropped(run, folder, tmp_path):
    done(run(*INFER, "--references", "published.csv", "-o", "c"))
    made = load(tmp_path / "c")
    assert {group.name: group.n for group in made.groups} == {"gel a": 3, "gone": 0, "bare.csv": 1}
    rows = {(row["set"], row["quantity"], row["method"]): row for row in rows_of(tmp_path / "c" / "comparison.csv")}
    columns = ("value", "std", "error_to_IMR", "error_to_rheometer")
    for (quantity, method), expected in EXPECTED.items():
        cells = [rows["gel a", quantity, method][column] for column in columns]
        assert [cell == "" for cell in cells] == [value == "" for value in expected]
        numbers = [value for value in expected if value != ""]
        assert [float(cell) for cell in cells if cell] == pytest.approx(numbers)
    ours = rows["gel a", "shear_modulus_Pa", "cavirheo"]
    value = float(ours["value"])
    assert 6e3 < value < 8e3  # of the population of three shots
    assert float(ours["q05"]) < value < float(ours["q95"])
    assert float(ours["error_to_IMR"]) == pytest.approx(abs(value / 8e3 - 1.0))
    assert float(ours["error_to_rheometer"]) == pytest.approx(value / 2e3 - 1.0)
    assert rows["gel a", "viscosity_Pa_s", "cavirheo"]["error_to_rheometer"] == ""
    assert ("gone", "shear_modulus_Pa", "IMR") in rows
    assert ("gone", "shear_modulus_Pa", "cavirheo") not in rows


def test_answers_that_exist_are_compared_alike(run, folder, tmp_path):
    done(run(*INFER, "--references", "published.csv", "-o", "c"))
    for files, out in (("data/gel_a", "gel"), ("data/bare.csv", "bare")):
        done(run("infer", files, "--no-pictures", "--quiet", "--references", "published.csv", "-o", out))
    done(run("compare", "gel", "bare", "--references", "published.csv", "-o", "d"))
    one, other = (load(tmp_path / name) for name in ("c", "d"))
    assert {group.name: group.published for group in one.groups} == {one.name: one.published for one in other.groups}
    refusal(run("compare", "gel", "gel/result.json", "--references", "published.csv", "-o", "e"), "'gel a'")
    alone = sets(tmp_path, "other name,,IMR,G_kPa,8,")
    done(run("infer", "data/bare.csv", "--no-pictures", "--quiet", "-o", "i"))
    done(run("compare", "i", "--references", alone, "-o", "e"))  # the only set is that of all groups
    assert load(tmp_path / "e").groups[0].published["IMR"]["shear_modulus"].mean == 8e3
    two = sets(tmp_path, "this,,IMR,G_kPa,8,", "that,,IMR,G_kPa,9,")
    refusal(run("compare", "i", "--references", two, "-o", "f"), "this, that", "bare", "files")


def test_a_recording_belongs_to_one_set(run, folder, tmp_path):
    both = sets(tmp_path, "gel,gel_a,IMR,G_kPa,8,", "soft,gel_?/shot0.csv,IMR,G_kPa,8,")
    refusal(run(*INFER, "--references", both, "-o", "c"), "shot0.csv", "gel, soft")


def test_sweeps_of_a_rheometer_stand_beside_the_answers(run, folder, tmp_path):
    sweeps = [ROOT / "examples" / f"soft_gel_{kind}_sweep.csv" for kind in ("strain", "frequency")]
    done(run(*INFER[:2], *INFER[3:], "--references", sweeps[0], "--references", sweeps[1], "-o", "c"))
    rows = {(row["quantity"], row["method"].partition(" ")[0]): row["value"] for row in rows_of("c/comparison.csv")}
    assert float(rows["shear_modulus_Pa", "rheometer,"]) == pytest.approx(1500, rel=0.01)
    assert ("viscosity_at_1_rad_per_s", "rheometer,") in rows  # another frequency is another quantity
    assert {method for quantity, method in rows if quantity == "viscosity_Pa_s"} == {"cavirheo"}


def test_published_values_can_be_read(tmp_path):
    by_name = {about.name: about for about in read_references(ROOT / "examples" / "published_values.csv")}
    assert len(by_name) == 13
    assert by_name["PAAm-alginate 0.3 %"].values["IMR"]["shear_modulus"].mean == 6440.0
    (about,) = read_references(sets(tmp_path, '"gel, 1";IMR;G_kPa;6,44', head="set;method;quantity;mean"))
    assert (about.name, about.values["IMR"]["shear_modulus"].mean) == ("gel, 1", 6440.0)
    names = [about.name for about in read_references(sets(tmp_path, "gel 1 %", "gel 2 %", head="set"))]
    assert names == ["gel 1 %", "gel 2 %"]


BAD = {  # text: (where, code, what is named)
    "": ("", "no_set_column", "no rows"),
    HEAD: ("", "no_set", ""),
    "set,density\na,1": ("line 1", "head", "density"),
    f"{HEAD}\n,x,IMR,G_Pa,1,": ("line 2, column set", "set", ""),
    f"{HEAD}\n# a comment\n\na,,IMR,G,1,": ("line 4, column quantity", "quantity", "'G'"),
    f"{HEAD}\na,,,G_Pa,1,": ("line 2, column method", "method", "''"),
    f"{HEAD}\na,,cavirheo,G_Pa,1,": ("line 2, column method", "method", "'cavirheo'"),
    f"{HEAD}\na,,IMR,G_Pa,6.4 kPa,": ("line 2, column mean", "mean", "'6.4 kPa'"),
    f"{HEAD}\na,,IMR,G_Pa,1,-1": ("line 2, column std", "std", "'-1'"),
    f"{HEAD}\na,,IMR,G_Pa,1,2,Bu, 2025": ("", "cells", "row 2 has 8 cells"),
    f"{HEAD}\na,,IMR,G_Pa,1,\na,,IMR,G_kPa,1,": ("line 3, column quantity", "quantity", "shear_modulus of 'a'"),
    f"{HEAD}\na,a.csv,IMR,G_Pa,1,\na,b.csv,,,,": ("line 3, column files", "files", "a.csv"),
}


@pytest.mark.parametrize("text", BAD)
def test_mistakes_in_the_file_are_named(tmp_path, text):
    (tmp_path / "r.csv").write_text(text)
    where, code, what = BAD[text]
    with refused(f"references.{code}", "r.csv", where, what):
        read_references(tmp_path / "r.csv")
