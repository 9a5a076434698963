"""`infer --references` and `compare`: published values beside ours; mistakes in the CSV file are named."""

import re
from pathlib import Path

import pytest
from answers import answer as answer_of
from conftest import ANSWER, EXAMPLE, ROOT, done, refusal, refused
from files import write_curve

from cavirheo import load, read_curves
from cavirheo.companions.published_values import read_references

HEAD = "set,method,quantity,mean,std"
REFERENCES = f"""# by hand
{HEAD}
gel_a,IMR,G_kPa,8,1.5

gel_a,IMR,mu_Pa_s,0.020,0.009
gel_a,BDT,G_kPa,6,
gel_a,BDT,mu_mPa_s,35,10
gel_a,rheometer,G_Pa,2000,
gone,IMR,G_kPa,5,1
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
EXPECTED = {  # of gel_a, by quantity and method: value, our 7 kPa or 0.03 Pa s over it
    ("G, kPa", "IMR"): ("8.0 ± 1.5", 0.875),
    ("G, kPa", "BDT"): ("6.00", 7 / 6),
    ("G, kPa", "rheometer"): ("2.00", 3.5),
    ("µ, Pa s", "BDT"): ("0.035 ± 0.010", 6 / 7),  # given in mPa s
}


def test_values_stand_beside_the_group_of_their_name_and_others_are_named(run, folder, tmp_path):
    done(run(*INFER, "--references", "published.csv", "-o", "c"))
    made = load(tmp_path / "c")
    found = [(group.name, group.n, *group.published) for group in made.groups]
    assert found == [("gel_a", 3, "IMR", "BDT", "rheometer"), ("bare", 1)]
    assert any("gone" in note for note in made.notes)
    table = done(run("show", "c")).partition("over it")[2].partition("bare ")[0]
    rows = [re.split(" {2,}", line.removeprefix("gel_a").strip()) for line in table.splitlines()]
    cells = {tuple(row[:2]): row[2:] for row in rows}
    for place, (value, ratio) in EXPECTED.items():
        assert cells[place][0] == value
        assert float(cells[place][1]) == pytest.approx(ratio, rel=0.03)
    assert float(cells["G, kPa", "cavirheo"][0].split()[0]) == pytest.approx(7.0, rel=0.03)
    assert ("µ, Pa s", "rheometer") not in cells


def test_answers_that_exist_are_compared_alike(run, folder, tmp_path):
    done(run(*INFER, "--references", "published.csv", "-o", "c"))
    done(run(*INFER, "-o", "i"))
    assert "gone: no group here" in run("compare", "i", "--references", "published.csv", "-o", "d")[2]
    one, other = (load(tmp_path / name) for name in ("c", "d"))
    assert [group.published for group in one.groups] == [group.published for group in other.groups]
    alone = sets(tmp_path, "other name,IMR,G_kPa,8,")
    done(run("compare", "i", "--references", alone, "-o", "e"))  # the only set is that of all groups
    assert load(tmp_path / "e").groups[1].published["IMR"]["shear_modulus"].mean == 8e3
    two = sets(tmp_path, "this,IMR,G_kPa,8,", "that,IMR,G_kPa,9,")
    refusal(run("compare", "i", "--references", two, "-o", "f"), "this, that", "gel_a, bare")
    Path("shot.csv").write_text("time_us,radius_um\n0,200\n1,190\n", encoding="utf-8")
    refusal(run("compare", "i", "--references", "shot.csv", "-o", "f"), "set,method,quantity", "sweep of a rheometer")


def test_sweeps_of_a_rheometer_stand_beside_the_answers(run, folder, tmp_path):
    sweeps = [ROOT / "examples" / f"soft_gel_{kind}_sweep.csv" for kind in ("strain", "frequency")]
    done(run(*INFER[:2], *INFER[3:], "--references", sweeps[0], "--references", sweeps[1], "-o", "c"))
    ((method, values),) = load("c").groups[0].published.items()
    assert method.startswith("rheometer, ")
    assert values["shear_modulus"].mean == pytest.approx(1500, rel=0.01)
    assert values.keys() == {"shear_modulus", "viscosity_at_1_rad_per_s"}  # another frequency is another quantity


def test_published_values_can_be_read(tmp_path):
    by_name = read_references(ROOT / "examples" / "published_values.csv")
    assert len(by_name) == 13
    assert by_name["paam_alginate_0p3"]["IMR"]["shear_modulus"].mean == 6440.0
    (written,) = read_references(sets(tmp_path, '"gel, 1";IMR;G_kPa;6,44', head="set;method;quantity;mean")).items()
    assert (written[0], written[1]["IMR"]["shear_modulus"].mean) == ("gel, 1", 6440.0)


BAD = {  # text: (where, code, what is named)
    "": ("", "no_set_column", "no rows"),
    HEAD: ("", "no_set", ""),
    "set,files\na,1": ("line 1", "head", "files"),
    f"{HEAD}\n,IMR,G_Pa,1,": ("line 2, column set", "set", ""),
    f"{HEAD}\n# a comment\n\na,IMR,G,1,": ("line 4, column quantity", "quantity", "'G'"),
    f"{HEAD}\na,,G_Pa,1,": ("line 2, column method", "method", "''"),
    f"{HEAD}\na,cavirheo,G_Pa,1,": ("line 2, column method", "method", "'cavirheo'"),
    f"{HEAD}\na,IMR,G_Pa,6.4 kPa,": ("line 2, column mean", "mean", "'6.4 kPa'"),
    f"{HEAD}\na,IMR,G_Pa,1,-1": ("line 2, column std", "std", "'-1'"),
    f"{HEAD}\na,IMR,G_Pa,1,2,Bu, 2025": ("", "cells", "row 2 has 7 cells"),
    f"{HEAD}\na,IMR,G_Pa,1,\na,IMR,G_kPa,1,": ("line 3, column quantity", "quantity", "shear_modulus of 'a'"),
}


@pytest.mark.parametrize("text", BAD)
def test_mistakes_in_the_file_are_named(tmp_path, text):
    (tmp_path / "r.csv").write_text(text)
    where, code, what = BAD[text]
    with refused(f"references.{code}", "r.csv", where, what):
        read_references(tmp_path / "r.csv")
