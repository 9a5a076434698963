"""`cavirheo compare`: published values beside ours; nothing is dropped, and every mistake in the CSV file is named."""

from __future__ import annotations

import csv
import json
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cavirheo import read_curves
from cavirheo.companions import published
from cavirheo.companions.published import compare, picture
from cavirheo.companions.published.comparison import Comparison, print_table
from cavirheo.companions.published.references import MU, G, read_references
from cavirheo.errors import InputError
from cavirheo.inference import analysis, posterior_model
from cavirheo.inference.analysis import Analysis
from cavirheo.posterior import Checks, Posterior
from cavirheo.reading import write_csv
from cavirheo.reporting import result
from cavirheo.writing import style
from cavirheo.writing.document import Outputs, write_json

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "soft_gel.csv"
PUBLISHED = ROOT / "examples" / "published_values.csv"
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
ANSWERS = {"shot0": (5e3, 0.01, "ok"), "shot1": (7e3, 0.03, "ok"), "shot2": (9e3, 0.05, "model_does_not_fit")}


@pytest.fixture
def folder(tmp_path) -> Path:
    """gel_a: three shots, one that cannot be answered, a file that cannot be read and one that is no measurement."""
    curves = read_curves(EXAMPLE)
    (tmp_path / "data" / "gel_a").mkdir(parents=True)
    for k in range(3):
        write_csv(tmp_path / "data" / "gel_a" / f"shot{k}.csv", curves[k])
    (tmp_path / "data" / "gel_a" / "three.csv").write_text("time_us,radius_um\n0,100\n1,90\n2,80\n")
    (tmp_path / "data" / "gel_a" / "torn.mat").write_bytes(b"")
    (tmp_path / "data" / "gel_a" / "protocol.docx").write_bytes(b"PK")
    write_csv(tmp_path / "data" / "bare.csv", curves[3])
    (tmp_path / "data" / "published.csv").write_text(REFERENCES)
    return tmp_path / "data"


@pytest.fixture
def fake(monkeypatch):
    """Known answers instead of inference, and result.json alone as report; returns the settings it was called with."""
    calls = []

    def answered(curve, material="nhkv"):
        if len(curve.time) < 5:
            return Posterior((), (), np.empty((0, 0)), Checks("failed", "3 frames"), material, "bdt")
        shear, viscosity, verdict = ANSWERS.get(curve.name, (4e3, 0.02, "ok"))
        names, theta = ("log10_shear_modulus", "log10_viscosity"), np.log10([[shear, viscosity]])
        if material == "newtonian":
            names, theta = names[1:], theta[:, 1:]
        rmse = 0.01 * (1 + ("shot1", "shot2").index(curve.name) if curve.name in ("shot1", "shot2") else 0.5)
        return Posterior(names, ("Pa", "Pa s")[-len(names) :], theta, Checks(verdict, "", rmse), material, "bdt")

    def answer(asked, curve, *_, **__):
        calls.append(asked)
        return answered(curve, "newtonian" if asked.model == "bdt-viscous" else "nhkv")

    def write_report(out, pairs, command, *_, **how):
        Outputs(out, "result.json").write("result.json", write_json, written := result(pairs, command))
        return written

    monkeypatch.setattr(published, "write_report", write_report)
    monkeypatch.setattr(Analysis, "answer", answer)
    card = {"kind": "point", "material": "nhkv"}
    for module in (published, posterior_model):
        monkeypatch.setattr(module, "network_of", lambda name: SimpleNamespace(sha256="", card=card))
    monkeypatch.setattr(analysis, "path_of", Path)
    monkeypatch.setattr(analysis, "card", lambda path: card)
    return calls


@pytest.mark.needs("matplotlib")
def test_the_command_answers_as_infer_does(run, folder, tmp_path):
    (folder / "two.csv").write_text(f"{HEAD}\ngel,gel_a/shot[01].csv,1003,IMR,G_kPa,6.44,1.64\n")
    status, out, err = run("compare", "data", "--references", "data/two.csv", "-o", "c")
    assert status == 0, err
    assert max(map(len, out.splitlines())) <= 120
    assert "6.44 ± 1.64" in out
    assert (
        run(
            "infer",
            "--model",
            "bdt-viscoelastic",
            "data/gel_a/shot0.csv",
            "data/gel_a/shot1.csv",
            "--density",
            1003,
            "-o",
            "i",
        )[0]
        == 0
    )
    here, there = (json.loads((tmp_path / name / "result.json").read_text()) for name in ("c/gel", "i"))
    assert [c["shear_modulus_Pa"] for c in here["curves"]] == [c["shear_modulus_Pa"] for c in there["curves"]]
    (about,) = read(tmp_path / "c").sets
    (group,) = there["groups"]
    assert about.quantities[0].ours.mean == group["shear_modulus_Pa"]["mean"]
    assert about.quantities[1].ours.std == group["viscosity_Pa_s"]["std"]
    assert about.rmse_over_rmax.largest == max(c["rmse_over_rmax"] for c in there["curves"])
    assert (tmp_path / "c" / about.report).exists()
    assert (tmp_path / "c" / "comparison.png").read_bytes().startswith(b"\x89PNG")


def read(out: Path) -> Comparison:
    return Comparison.model_validate_json((out / "comparison.json").read_text(encoding="utf-8"))


def test_relative_errors_are_exact(fake, folder, tmp_path):
    result = compare(folder, folder / "published.csv", tmp_path / "c")
    assert (result.methods, result.reference_methods) == (["IMR", "BDT", "rheometer"], ["IMR", "rheometer"])
    modulus, viscosity = result.sets[0].quantities
    assert modulus.ours.model_dump(exclude={"source"}) == pytest.approx({"mean": 7e3, "std": 2e3, "n": 3})
    assert modulus.ours_ok.model_dump(exclude={"source"}) == pytest.approx({"mean": 6e3, "std": 2e3 / 2**0.5, "n": 2})
    assert modulus.relative_errors["IMR"] == pytest.approx({"BDT": 0.25, "rheometer": 0.75, "cavirheo": 0.125})
    assert modulus.relative_errors["rheometer"] == pytest.approx({"IMR": 3.0, "BDT": 2.0, "cavirheo": 2.5})
    assert viscosity.published["BDT"].mean == 0.035  # given in mPa s
    assert viscosity.published["BDT"].std == 0.010
    assert viscosity.relative_errors == {"IMR": pytest.approx({"BDT": 0.75, "cavirheo": 0.5})}
    only = compare(folder, folder / "published.csv", tmp_path / "c", reference_methods=["BDT"])
    assert only.sets[0].quantities[0].relative_errors == {
        "BDT": pytest.approx({"IMR": 1 / 3, "rheometer": 2 / 3, "cavirheo": 1 / 6})
    }


def test_nothing_is_dropped(fake, run, folder, tmp_path):
    status, out, _ = run("compare", "data", "--references", "data/published.csv", "-o", "c")
    assert status == 2
    gel, gone, bare = read(tmp_path / "c").sets
    assert (gel.n_shots, gel.n_answered) == (4, 3)
    assert gel.verdicts == {"ok": 2, "model_does_not_fit": 1, "failed": 1}
    assert gel.rmse_over_rmax.model_dump() == pytest.approx({"median": 0.01, "smallest": 0.005, "largest": 0.02})
    assert "torn.mat" in gel.problems[0]
    assert "protocol.docx" in gel.notes[0]
    assert gel.files == [f"gel_a/{name}" for name in ("shot0.csv", "shot1.csv", "shot2.csv", "three.csv", "torn.mat")]
    assert (gone.n_shots, gone.report, gone.quantities[0].ours.mean) == (0, None, None)
    assert "nowhere/*.mat" in gone.problems[0]
    assert gone.quantities[0].relative_errors == {"IMR": {}}
    assert [row.published for row in bare.quantities] == [{}, {}]
    for word in (
        "gone",
        "torn.mat",
        "protocol.docx",
        "3 of 4",
        "3 frames",
        "does not fit 1, failed 1",
    ):
        assert word in " ".join(out.split())
    (folder / "gel_a" / "torn.mat").unlink()
    (folder / "less.csv").write_text(f"{HEAD}\ngel_a,,,,,,\n")
    assert run("compare", "data", "--references", "data/less.csv", "-o", "less")[0] == 1
    (folder / "gel_a" / "three.csv").unlink()
    assert run("compare", "data", "--references", "data/less.csv", "-o", "less")[0] == 0


def test_markdown_and_csv_say_what_the_record_says(fake, folder, tmp_path):
    text = (folder / "published.csv").read_text().replace("gel a,", "gel | a,")
    (folder / "published.csv").write_text(text)
    result = compare(folder, folder / "published.csv", tmp_path / "c")
    assert read(tmp_path / "c") == result
    lines = (tmp_path / "c" / "comparison.md").read_text(encoding="utf-8").replace("\\|", "¦").splitlines()
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    assert {len(row) for row in cells} == {len(cells[0])}
    rows = [dict(zip(cells[0], row, strict=True)) for row in cells[2:]]
    assert [(row["Set"], row["Quantity"]) for row in rows] == [
        ("gel ¦ a", "G (kPa)"), ("gel ¦ a", "µ (Pa s)"), ("gone", "G (kPa)"), ("bare.csv", "G (kPa)"),
        ("bare.csv", "µ (Pa s)"),
    ]  # fmt: skip
    assert rows[0] == {
        "Set": "gel ¦ a", "Quantity": "G (kPa)", "IMR": "8.0 ± 1.5", "BDT": "6", "rheometer": "2",
        "cavirheo, trusted": "6.0 ± 1.4", "cavirheo, all": "7.0 ± 2.0",
        "BDT to IMR, %": "25", "rheometer to IMR, %": "75", "cavirheo, trusted to IMR, %": "25",
        "cavirheo, all to IMR, %": "12", "IMR to rheometer, %": "300", "BDT to rheometer, %": "200",
        "cavirheo, trusted to rheometer, %": "200", "cavirheo, all to rheometer, %": "250",
        "Shots": "3 of 4", "trusted": "2", "RMSE, % of R_max": "1.0 (0.5–2.0)",
    }  # fmt: skip
    assert rows[3]["cavirheo, trusted"] == rows[3]["cavirheo, all"] == "4.00"
    assert rows[1]["IMR"] == "0.020 ± 0.009"
    with (tmp_path / "c" / "comparison.csv").open(newline="", encoding="utf-8") as file:
        table_rows = list(csv.DictReader(file))
    for (about, row), line in zip(result.rows(), table_rows, strict=True):
        assert (line["set"], line["quantity"]) == (about.name, row.quantity)
        assert int(line["n_failed"]) == about.verdicts.get("failed", 0)
        assert number(line["cavirheo_mean"]) == row.ours.mean
        for method, value in row.published.items():
            assert (number(line[f"{method}_mean"]), number(line[f"{method}_std"])) == (value.mean, value.std)
        for reference, errors in row.relative_errors.items():
            for method, value in errors.items():
                assert number(line[f"{method}_error_to_{reference}"]) == value


def number(text: str) -> float | None:
    return float(text) if text else None


@pytest.mark.needs("matplotlib")
def test_a_liquid_has_no_shear_modulus(fake, folder, tmp_path):
    (folder / "liquid.csv").write_text(
        "set,files,model,method,quantity,mean,std\nPEG,gel_a/shot?.csv,bdt-viscous,IMR,mu_Pa_s,0.06,0.01\n"
        "odd,gel_a/shot0.csv,bdt-viscous,IMR,G_kPa,1,\n"
    )
    result = compare(folder, folder / "liquid.csv", tmp_path / "c")
    peg, odd = result.sets
    assert [row.quantity for row in peg.quantities] == [MU]
    assert peg.quantities[0].relative_errors == {"IMR": {"cavirheo": pytest.approx(0.5)}}
    assert [row.ours.mean is None for row in odd.quantities] == [True, False]
    assert [axes.get_xlabel() for axes in picture.figure(result).axes] == ["G (kPa)", "µ (Pa s)"]
    result.sets = [peg]
    assert [axes.get_xlabel() for axes in picture.figure(result).axes] == ["µ (Pa s)"]


def test_settings_reach_the_inference(fake, folder, tmp_path):
    (folder / "s.csv").write_text(
        "set,model,window,stretch,rmax_um,medium,density,sound_speed,surface_tension,pressure,temperature\n"
        "bare.csv,own.onnx,2,7.5,210,zhu2025,1040,1500,0,90000,300\n"
        "gel_a/shot0.csv,,,,,,,,,,\n"
    )
    result = compare(folder, folder / "s.csv", tmp_path / "c", model="other")
    first, second = fake
    assert (first.model, first.window, first.stretch) == ("own.onnx", 2, 7.5)
    medium = first.medium
    assert (medium.density, medium.sound_speed, medium.surface_tension) == (1040, 1500, 0)
    assert (medium.pressure, medium.temperature) == (90000, 300)
    record = json.loads((tmp_path / "c" / "bare.csv" / "result.json").read_text())
    assert record["curves"][0]["max_radius_m"] == pytest.approx(210e-6)
    assert (second.model, second.window, second.medium.density) == ("other", None, 998.0)
    assert "no relative errors" in result.notes[0]


def test_the_file_of_values_is_no_measurement(fake, folder, tmp_path):
    (folder / "published.csv").write_text(f"{HEAD}\nall,*.csv,,,,,\n")
    (about,) = compare(folder, folder / "published.csv", tmp_path / "c").sets
    assert (about.files, about.problems) == (["bare.csv"], [])


BAD = {  # text: (where, code, what is named)
    "name,mean\na,1": ("", "no_set_column", "'name', 'mean'"),
    "": ("", "no_set_column", "no rows"),
    HEAD: ("", "no_set", ""),
    "set,densty\na,1": ("line 1, column densty", "head", "density"),
    "set,set\na,b": ("line 1, column set", "head", "2 times"),
    f"{HEAD}\n,x,,IMR,G_Pa,1,": ("line 2, column set", "set", ""),
    f"{HEAD}\n# a comment\n\na,,,IMR,G,1,": ("line 4, column quantity", "quantity", "'G'"),
    f"{HEAD}\na,,,,G_Pa,1,": ("line 2, column method", "method", "''"),
    f"{HEAD}\na,,,cavirheo,G_Pa,1,": ("line 2, column method", "method", "'cavirheo'"),
    f"{HEAD}\na,,,IMR,G_Pa,6.4 kPa,": ("line 2, column mean", "mean", "'6.4 kPa'"),
    f"{HEAD}\na,,,IMR,G_Pa,,1": ("line 2, column mean", "mean", "''"),
    f"{HEAD}\na,,,IMR,G_Pa,nan,1": ("line 2, column mean", "mean", "'nan'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,-1": ("line 2, column std", "std", "'-1'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,2,Bu, 2025": ("", "cells", "row 2 has 9 cells"),
    f"{HEAD}\na,,,IMR,G_Pa,1,\na,,,IMR,G_kPa,1,": ("line 3, column quantity", "quantity", "shear_modulus_Pa of 'a'"),
    f"{HEAD}\na,,,IMR,G_Pa,1,\na,,,imr,mu_Pa_s,1,": ("line 3, column method", "method", "'IMR' as in"),
    f"{HEAD}\na,,998,IMR,G_Pa,1,\na,,999,,,,": ("line 3, column density", "density", "r.csv, line 2"),
    f"{HEAD}\na,,heavy,,,,": ("line 2, column density", "density", "'heavy'"),
    "set,window\na,1.5": ("line 2, column window", "window", "'1.5'"),
    "set,medium\na,honey": ("line 2, set 'a'", None, "'honey'"),
    "set,temperature\na,400": ("line 2, set 'a'", None, "400"),
    "set,model\na,\na,nobody": ("line 3, column model", None, "'nobody'"),
    "set,stretch\na,0.5": ("line 2, column stretch", None, "0.5"),
}


@pytest.mark.parametrize("text", BAD)
def test_mistakes_in_the_file_are_named(tmp_path, text):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        compare(tmp_path, tmp_path / "r.csv", tmp_path / "c")
    where, code, what = BAD[text]
    assert f"r.csv, {where}" in str(caught.value) if where else True
    assert code is None or caught.value.code == f"references.{code}"
    assert what in str(caught.value)
    assert not (tmp_path / "c").exists()


def test_other_dialects_of_the_file(tmp_path):
    """Semicolons with decimal commas, UTF-16, a name with a comma in quotes, one column alone."""
    (tmp_path / "a.csv").write_text('set;method;quantity;mean\n"gel, 1";IMR;G_kPa;6,44\n', encoding="utf-16")
    (about,) = read_references(tmp_path / "a.csv")
    assert (about.name, about.values["IMR", G].mean) == ("gel, 1", 6440.0)
    (tmp_path / "b.csv").write_text("set\ngel 1 %\ngel 2 %\n")
    assert [about.name for about in read_references(tmp_path / "b.csv")] == ["gel 1 %", "gel 2 %"]


def test_other_mistakes(fake, folder, tmp_path):
    for arguments, options, code in [
        ((folder, tmp_path / "none.csv"), {}, "reading.missing"),
        ((folder / "bare.csv", folder / "published.csv"), {}, "compare.folder"),
        ((folder, folder / "published.csv"), {"reference_methods": ["imr"]}, "compare.method"),
    ]:
        with pytest.raises(InputError) as caught:
            compare(*arguments, tmp_path / "c", **options)
        assert caught.value.code == code
    with pytest.raises(InputError, match=r"bare\.csv"):
        compare(folder, folder / "published.csv", folder / "bare.csv")


def test_without_matplotlib_the_tables_are_complete(fake, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available", lambda: False)
    result = compare(folder, folder / "published.csv", tmp_path / "c")
    assert not (tmp_path / "c" / "comparison.png").exists()
    assert "matplotlib is not installed" in (tmp_path / "c" / "comparison.md").read_text(encoding="utf-8")
    assert "matplotlib is not installed" in result.notes[0]


@pytest.mark.needs("matplotlib")
def test_the_table_fits_and_the_picture_shows_every_value(fake, folder, tmp_path, monkeypatch, capsys):
    result = compare(folder, folder / "published.csv", tmp_path / "c")
    for width in (80, 120):
        monkeypatch.setenv("COLUMNS", str(width))
        print_table(result)
        text = capsys.readouterr().out
        assert max(map(len, text.splitlines())) <= width
        assert len(text.splitlines()) < 47
        assert "(0.5–2.0)" in text
    (trusted,) = (line for line in text.splitlines() if "cavirheo, trusted" in line and "6.0 ± 1.4" in line)
    (everything,) = (line for line in text.splitlines() if "cavirheo, all" in line and "7.0 ± 2.0" in line)
    assert "3 of 4" in trusted
    assert trusted.split()[5:7] == ["25", "200"]  # errors to IMR and to the rheometer, %
    assert everything.split()[5:7] == ["12", "250"]
    assert all(about.name in text for about in result.sets)
    drawn = picture.figure(result)
    assert [axes.get_xscale() for axes in drawn.axes] == ["log", "log"]
    legend = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert legend == [
        "IMR",
        "BDT",
        "rheometer",
        "cavirheo, trusted",
        "cavirheo: shot, trusted",
        "cavirheo: shot, not trusted",
    ]
    for wide in (1.0, 5.0, 200.0, 1e4):  # numbers of an axis never touch, from one decade to many
        result.sets[0].quantities[0].published["IMR"].mean = 8e3 * wide
        drawn = picture.figure(result)
        style.drawn(drawn, 100)
        for axes in drawn.axes:
            boxes = [one.get_window_extent() for one in axes.get_xticklabels() if one.get_text()]
            inside = sorted((one.x0, one.x1) for one in boxes if axes.bbox.x0 <= one.x1 and one.x0 <= axes.bbox.x1)
            assert len(inside) > 1
            assert all(a[1] + 3 < b[0] for a, b in pairwise(inside)), (wide, axes.get_xlabel())
    result.sets[0].quantities[0].ours_ok.std = 8e3
    legend = [text.get_text() for text in picture.figure(result).legends[0].get_texts()]
    assert "std reaches below 0" in legend


def test_a_set_without_a_recording_has_its_published_values(fake, run, folder, tmp_path):
    """It is no mistake, and no shot of it is missing."""
    (folder / "two.csv").write_text(
        f"{HEAD}\nopen,gel_a/shot?.csv,,IMR,G_kPa,8,1.5\nclosed,-,,IMR,G_kPa,30,4\nclosed,,,BDT,G_kPa,39,12\n"
    )
    status, out, err = run("compare", "data", "--references", "data/two.csv", "-o", "c")
    assert status == 0, err
    _, closed = read(tmp_path / "c").sets
    assert (closed.n_shots, closed.problems, closed.report) == (0, [], None)
    assert closed.quantities[0].relative_errors == {"IMR": {"BDT": pytest.approx(0.3)}}
    (note,) = closed.notes
    assert note in " ".join(out.split())
    text = (tmp_path / "c" / "comparison.md").read_text(encoding="utf-8")
    assert "0 of 0" not in out + text
    assert f"- closed: {note}\n" in text


def test_published_values_can_be_read():
    sets = {about.name: about for about in read_references(PUBLISHED)}
    assert [name for name, about in sets.items() if not about.recorded] == [
        "agarose 1.0 %", "agarose 5.0 %", "gelatin 6 %", "gelatin 10 %", "gelatin 14 %", "PAAm 3 %", "PAAm 8 %",
    ]  # fmt: skip
    assert len(sets) == 13
    assert sets["stiff polyacrylamide"].medium.name == "estrada2018"
    assert sets["PAAm-alginate 0.3 %"].values["IMR", G].mean == 6440.0
    assert ("IMR", G) not in sets["PEG 8000 40 w/v %"].values
    assert sets["agarose 2.5 %"].medium.density == 1025


def published_cells() -> dict[str, dict[tuple[str, str], str]]:
    """'6.44 ± 1.64' by set and (method, quantity), as the file has them; 'files' by set."""
    with PUBLISHED.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if line[0] != "#"))
    found: dict[str, dict[tuple[str, str], str]] = {row["set"]: {} for row in rows}
    for row in rows:
        found[row["set"]][row["method"], row["quantity"]] = " ± ".join(filter(None, (row["mean"], row["std"])))
    return found


@pytest.mark.repository
def test_the_page_has_the_published_values():
    """docs/reproduction.md: all of them, with errors to IMR and the mark of sets that have no open recording."""
    text = (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part.splitlines() for part in text.split("\n## ")}
    whole, real = (
        [[cell.strip() for cell in line.strip("|").split("|")] for line in sections[name] if line[:2] == "| "][1:]
        for name in ("The paper's tables", "Real measurements")
    )
    cells, recorded = published_cells(), {about.name: about.recorded for about in read_references(PUBLISHED)}

    def error(of: dict[tuple[str, str], str], quantity: str) -> str:
        imr, bdt = (float(of[m, quantity].split()[0]) if (m, quantity) in of else None for m in ("IMR", "BDT"))
        percent = None if imr is None or bdt is None else 100 * abs(bdt - imr) / imr
        return "–" if percent is None else f"{percent:.0f}" if percent >= 9.95 else f"{percent:.2g}"

    assert whole == [
        [
            name,
            *(of.get(("IMR", "G_kPa"), "–"), of.get(("BDT", "G_kPa"), "–"), error(of, "G_kPa")),
            *(of["IMR", "mu_Pa_s"], of["BDT", "mu_Pa_s"], error(of, "mu_Pa_s")),
            "yes" if recorded[name] else "none",
        ]
        for name, of in cells.items()
        if ("BDT", "mu_Pa_s") in of
    ]
    assert {row[0] for row in real} == {name for name in cells if recorded[name]}
    for name, label, imr, bdt, rheometer, *_, errors, _, _ in real:
        quantity = {"G (kPa)": "G_kPa", "µ (Pa s)": "mu_Pa_s"}[label]
        of = cells[name]
        assert [imr, bdt] == [of.get((method, quantity), "–") for method in ("IMR", "BDT")]
        assert number(rheometer.replace("–", "")) == number(of.get(("rheometer", quantity), ""))
        assert errors.split(", ")[0] == error(of, quantity)


def test_published_sets_are_found(fake, real_data, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available", lambda: False)
    result = compare(real_data, PUBLISHED, tmp_path / "c")
    assert [about.n_shots for about in result.sets if about.recorded] == [5, 20, 20, 11, 11, 20]
    assert not any(about.problems for about in result.sets)


@pytest.mark.slow
def test_sets_can_be_fitted_in_the_place_of_networks(tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available", lambda: False)
    write_csv(tmp_path / "gel.csv", read_curves(EXAMPLE)[2])
    (tmp_path / "refs.csv").write_text(
        "set,files,window,model,method,quantity,mean\ngel,gel.csv,1,,IMR,G_kPa,3\nliquid,gel.csv,1,bdt-viscous,,,\n"
    )
    gel, liquid = compare(tmp_path, tmp_path / "refs.csv", tmp_path / "c", fit="qkv").sets
    assert (gel.model, liquid.model) == ("least squares, qkv", "least squares, newtonian")
    assert gel.quantities[0].ours.n == gel.n_shots
    assert [row.quantity for row in liquid.quantities] == [MU]
    record = json.loads((tmp_path / "c" / "gel" / "result.json").read_text())["curves"][0]
    assert (record["method"], record["window"]["collapses"]) == ("least_squares", 1)
    with pytest.raises(InputError, match="jelly"):
        compare(tmp_path, tmp_path / "refs.csv", tmp_path / "c", fit="jelly")


def test_the_posterior_network_takes_the_law_from_what_is_published():
    sets = {
        name: published.ReferenceSet(name, name, settings={"model": "posterior"}, values={("IMR", quantity): None})
        for name, quantity in (("gel", "shear_modulus_Pa"), ("liquid", "viscosity_Pa_s"))
    }
    made = {name: published._analysis(one, "posterior", None, False)[1] for name, one in sets.items()}
    assert {name: one.material for name, one in made.items()} == {"gel": "nhkv", "liquid": "newtonian"}
    assert published._analysis(sets["liquid"], "x", "nhkv", False)[1].material == "newtonian"
