"""Figures for a two-column paper: their size, type and files, legible in grey, nothing cut off."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import cavirheo
from cavirheo import InputError
from cavirheo.io import write_csv
from cavirheo.reporting import figures, write_report
from cavirheo.reporting.laws import ComparedLaws, WeighedLaw, WeighedLaws
from cavirheo.reporting.record import result
from cavirheo.writing import style

EXAMPLE = Path(__file__).parent.parent / "examples" / "soft_gel.csv"
MM = 72 / 25.4  # pt


@pytest.fixture(scope="module")
def pairs():
    """The network's own draws, taken as if simulations had weighed them."""
    curves = cavirheo.read_curves(EXAMPLE)
    answers = cavirheo.infer_many(curves, verify="none")
    return [
        (curve, replace(one, checks=replace(one.checks, verdict="ok")))
        for curve, one in zip(curves, answers, strict=True)
    ]


def weighed(**evidence):
    laws = {
        name.replace("_", " "): WeighedLaw(log_evidence=value, standard_error=0.4, probability=None)
        for name, value in evidence.items()
    }
    return WeighedLaws(
        name="gel", shots=1, chosen=next(iter(laws)), contenders=[], laws=laws, pairs=list[ComparedLaws]()
    )


@pytest.fixture(scope="module")
def drawn(pairs):
    """(name, figure) of all kinds."""
    laws = weighed(nhkv=-10.0, newtonian=-400.0, a_law_with_a_name_that_goes_on_and_on=-12.5)
    document = result(pairs, "x")
    stems = figures.paper_names([row.name for row in document.curves], [one.name for one in document.groups])
    made = [draw() for _, draw in figures.drawn(pairs, document, figures.PAPER)]
    return [*zip(stems, made, strict=True), ("paper-laws", figures.laws_figure(laws))]


def test_every_answer_and_group_is_drawn(pairs, drawn):
    assert [name for name, _ in drawn] == [
        *(f"paper-soft_gel_{k}" for k in range(1, 6)), "paper-group-soft_gel", "paper-laws"
    ]  # fmt: skip


def test_one_or_two_columns_wide(drawn):
    widths = [25.4 * figure.get_size_inches()[0] for _, figure in drawn]
    assert widths == pytest.approx([84.0] * 5 + [174.0, 84.0])
    assert max(25.4 * figure.get_size_inches()[1] for _, figure in drawn) < 100.0


def test_type_of_7_and_8_pt_and_nothing_cut_off(drawn):
    from matplotlib.text import Text

    for name, figure in drawn:
        image = style.drawn(figure, 150)
        sizes = {one.get_fontsize() for one in figure.findobj(Text) if one.get_text()}
        assert sizes == {7.0, 8.0}, name
        edge = np.asarray(image)[[0, -1]].min(), np.asarray(image)[:, [0, -1]].min()
        assert edge == (255, 255), name
        box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
        assert min(box.x0, box.y0, width - box.x1, height - box.y1) > 0.0, (name, box)


def test_legible_in_grey(drawn):
    from matplotlib.colors import to_rgb

    def grey(colour):
        return float(np.dot(to_rgb(colour), (0.299, 0.587, 0.114)))

    for name, figure in drawn[:5]:  # points and line differ in shape; both are dark on white
        measured, simulated = (figure.axes[0].get_lines()[k] for k in (1, 2))
        assert (measured.get_linestyle(), simulated.get_linestyle()) == ("None", "-"), name
        assert max(grey(measured.get_markeredgecolor()), grey(simulated.get_color())) < 0.5
    lines = dict(drawn)["paper-group-soft_gel"].axes[0].get_lines()
    tones = sorted(grey(line.get_color()) for line in lines)
    assert len(tones) == 5
    assert min(np.diff(tones)) > 0.04
    assert tones[-1] < 0.75


def test_the_order_of_laws_is_that_of_their_evidence():
    figure = figures.laws_figure(weighed(best=-5.0, worst=-90.0, middle=-9.0))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["worst", "middle", "best"]


@pytest.mark.slow
def test_files(pairs, tmp_path):
    from PIL import Image

    for folder in ("a", "b"):
        write_report(tmp_path / folder, pairs, "x", ("paper",))
    stem = tmp_path / "a" / "paper-soft_gel_1"
    with Image.open(stem.with_suffix(".png")) as image:
        assert image.size[0] == pytest.approx(84 / 25.4 * 300, abs=1)
        assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", stem.with_suffix(".pdf").read_bytes())
    assert float(box[1]) == pytest.approx(84 * MM, abs=0.1)
    drawing = stem.with_suffix(".svg").read_text()
    assert float(re.search(r'width="([\d.]+)pt"', drawing)[1]) == pytest.approx(84 * MM, abs=0.1)
    assert ">measured<" in drawing
    made = sorted(path.name for path in (tmp_path / "a").glob("paper-*"))
    assert len(made) == 6 * 3
    assert all((tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in made)
    write_report(tmp_path / "a", pairs, "x")  # the same folder, without them
    assert not list((tmp_path / "a").glob("paper-*"))


def test_a_figure_of_evidence_that_fails_costs_nothing_but_itself(run, tmp_path, monkeypatch):
    def fails(_):
        raise RuntimeError("no font")

    monkeypatch.setattr(figures, "laws_figure", fails)
    write_csv(tmp_path / "shot.csv", cavirheo.read_curves(EXAMPLE)[0])
    words = ("--laws", "newtonian,nhkv", "--bubble", "field", "--window", 1, "--figures", "paper", "-o", "laws")
    status, _, err = run("which-law", "shot.csv", *words)
    assert status == 0, err
    assert "no font" in " ".join(cavirheo.load(tmp_path / "laws" / "laws.json").notes)
    assert (tmp_path / "laws" / "report.html").is_file()


def test_a_users_file_is_not_replaced(pairs, tmp_path):
    (tmp_path / "paper-soft_gel_2.pdf").write_text("mine")
    with pytest.raises(InputError, match=r"paper-soft_gel_2\.pdf"):
        write_report(tmp_path, pairs, "x", ("paper",))
    assert not (tmp_path / "result.json").exists()


@pytest.mark.parametrize("verb", ["infer", "fit", "which-law"])
def test_another_word_is_refused(verb, run):
    status, _, said = run(verb, EXAMPLE, "--figures", "poster", "-o", "out")
    assert (status, said) == (2, "error: --figures must be of png, svg, pdf, paper, got 'poster'\n")


def test_names_do_not_collide():
    assert len(set(figures.paper_names(["a", "group-a", "a"], ["a"]))) == 4
