"""Figures for a two-column paper: their files, their width, and what they never replace."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from conftest import ROOT

pytest.importorskip("matplotlib")

import cavirheo
from cavirheo import InputError
from cavirheo.io import write_csv
from cavirheo.reporting import figures, write_report

EXAMPLE = ROOT / "examples" / "soft_gel.csv"


@pytest.fixture(scope="module")
def pairs():
    """The network's own draws, taken as if simulations had weighed them."""
    curves = cavirheo.read_curves(EXAMPLE)[:2]
    answers = cavirheo.infer_many(curves, verify="none")
    return [
        (curve, replace(one, checks=replace(one.checks, verdict="ok")))
        for curve, one in zip(curves, answers, strict=True)
    ]


def test_files_of_a_column_or_a_page_and_none_of_the_users_is_replaced(pairs, tmp_path):
    for folder in ("a", "b"):
        write_report(tmp_path / folder, pairs, "x", ("paper",))
    made = {path.name: path.read_bytes() for path in (tmp_path / "a").glob("paper-*")}
    stems = ("paper-soft_gel_1", "paper-soft_gel_2", "paper-group-soft_gel")
    assert made.keys() == {f"{stem}.{kind}" for stem in stems for kind in ("pdf", "png", "svg")}
    assert all((tmp_path / "b" / name).read_bytes() == content for name, content in made.items())
    for stem, width in zip(stems, (84, 84, 174), strict=True):
        drawing = (tmp_path / "a" / f"{stem}.svg").read_text()
        assert float(re.search(r'width="([\d.]+)pt"', drawing)[1]) == pytest.approx(width * 72 / 25.4, abs=0.1)
    write_report(tmp_path / "a", pairs, "x")  # the same folder, without them
    assert not list((tmp_path / "a").glob("paper-*"))
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "paper-soft_gel_2.pdf").write_text("mine")
    with pytest.raises(InputError, match=r"paper-soft_gel_2\.pdf"):
        write_report(tmp_path / "c", pairs, "x", ("paper",))
    assert not (tmp_path / "c" / "result.json").exists()


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
    assert run("infer", EXAMPLE, "--figures", "poster", "-o", "out")[0] == 2
