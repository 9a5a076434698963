"""A Posterior in Python: its draws in the formats of other libraries; documents that are loaded."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from answers import answer, bubble, document_of, seen, unanswered
from conftest import code_of, refused

from cavirheo import Posterior, load, table
from cavirheo.reporting.measured import Measured
from cavirheo.reporting.record import Result


@pytest.fixture
def posterior() -> Posterior:
    rng = np.random.default_rng(0)
    theta = np.column_stack([3.8 + 0.05 * rng.standard_normal(900), 8.5 + 0.2 * rng.standard_normal(900)])
    return Posterior(
        ("log10_shear_modulus", "stretch"), ("Pa", "1"), theta, answer(bubble()).checks, "nhkv", "verified",
        {"long": list(range(9000))}, log_weight=0.5 * rng.standard_normal(900) - 700.0,
    )  # fmt: skip


def test_draws_have_natural_units_and_their_weights(posterior):
    pytest.importorskip("pandas")
    frame = posterior.to_dataframe()
    assert list(frame.columns) == ["shear_modulus_Pa", "stretch", "weight"]
    assert frame["shear_modulus_Pa"].to_numpy() == pytest.approx(10.0 ** posterior.theta[:, 0])
    assert frame["weight"].sum() == pytest.approx(1.0)  # though the largest weight is exp(-698)
    assert frame["weight"].idxmax() == np.argmax(posterior.log_weight)
    assert frame.attrs["verdict"] == "ok"
    assert replace(posterior, log_weight=None).to_dataframe()["weight"].std() == 0.0
    assert max(len(repr(posterior)), len(repr(posterior.checks))) < 400  # their arrays are not shown
    assert "6100 Pa (5100 to 7300)" in repr(seen(np.log10([6100.0, 0.02]), 0.05))  # equal digits: not 7316
    pytest.importorskip("arviz")
    data = posterior.to_arviz()
    assert data["posterior"]["shear_modulus"].attrs["units"] == "Pa"
    assert data["posterior"]["shear_modulus"].dims == ("chain", "draw")
    counts = [np.count_nonzero(data["posterior"]["stretch"].values == value) for value in posterior.theta[:, 1]]
    assert np.max(np.abs(counts - 900 * posterior.weights)) <= 1.0  # resampled by their weights
    assert code_of(posterior.without_draws().to_arviz) == "posterior.no_draws"


@pytest.mark.parametrize(("name", "method"), [("pandas", "to_dataframe"), ("arviz", "to_arviz")])
def test_a_missing_library_is_named(posterior, monkeypatch, name, method):
    monkeypatch.setitem(sys.modules, name, None)
    with refused("posterior.missing_library", f'pip install "{name}"'):
        getattr(posterior, method)()


def test_corner_has_marginals_and_pairs_but_not_of_a_point(posterior, tmp_path):
    pytest.importorskip("corner")
    figure = posterior.corner()
    assert [axes.get_xlabel() for axes in figure.axes if axes.get_xlabel()] == ["G (kPa)", "λ"]
    figure.savefig(tmp_path / "a.png")
    assert len(posterior.corner("lambda").axes) == 1
    assert code_of(replace(posterior, theta=posterior.theta[:1]).corner) == "posterior.no_draws"
    assert code_of(posterior.corner, "E") == "posterior.parameter"


def test_an_answer_draws_its_curve(posterior, tmp_path):
    pytest.importorskip("matplotlib")
    curve = bubble("gel[2]")
    checks = answer(curve).checks
    ends = np.column_stack([checks.residual_over_rmax - 0.01, checks.residual_over_rmax + 0.02])
    drawn = replace(posterior, curve=curve, checks=replace(checks, predicted_over_rmax=ends))
    assert (drawn.name, posterior.name) == ("gel[2]", "")
    drawn.plot().savefig(tmp_path / "a.png")
    replace(unanswered(), curve=curve).plot().savefig(tmp_path / "b.png")
    assert code_of(posterior.plot) == "posterior.no_curve"


def test_answers_are_a_table_in_which_a_bound_is_no_median():
    pandas = pytest.importorskip("pandas")
    known, bounded = seen([3.8, -1.4], 0.05), seen([3.8, -3.7], [0.05, 0.3])
    curves = [bubble(f"gel[{k}]") for k in range(3)]
    answers = [replace(one, curve=curve) for one, curve in zip([known, bounded, unanswered()], curves, strict=True)]
    frame = table(answers)
    assert frame["name"].tolist() == ["gel[0]", "gel[1]", "gel[2]"]
    assert frame["viscosity_Pa_s"].mean() == pytest.approx(known.median("mu"))
    assert frame["viscosity_Pa_s_q95"][1] == pytest.approx(bounded.interval("mu")[1])
    assert frame["viscosity_Pa_s_bound"][1] == bounded.bound("mu") == "upper"
    assert pandas.isna([frame["viscosity_Pa_s"][1], bounded.median("mu")]).all()
    assert frame["shear_modulus_Pa"].count() == 2
    assert frame["verdict"].tolist() == ["ok", "ok", "failed"]
    result = document_of([(curves[0], known)])
    for wrong, code in ([known], "posterior.no_curve"), *((one, "input.type") for one in (["gel"], known, result)):
        assert code_of(table, wrong) == code


HEAD, EMPTY = {"schema": 1, "version": "0", "command": "cavirheo"}, {"curves": [], "groups": []}


def test_load_takes_the_one_document_of_a_folder_and_refuses_another_kind(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps(HEAD | EMPTY | {"kind": "result"}), encoding="utf-8")
    assert load(tmp_path, Result) == load(tmp_path) == load(tmp_path / "result.json")
    for kind, code in ((Measured, "loading.kind"), ("Measured", "input.type")):
        assert code_of(load, tmp_path, kind) == code
    (tmp_path / "measure.json").write_text("{}", encoding="utf-8")
    assert code_of(load, tmp_path) == "loading.folder"


OTHER = [b"\xff\xfe\x00", b"time_us,radius_um\n", b"[]", b'{"a": 1}', json.dumps(HEAD | EMPTY).encode()]
OTHER += [json.dumps(HEAD | {"kind": kind}).encode() for kind in ("poem", ["result"], "result")]  # the last has no rows


@pytest.mark.parametrize("content", OTHER)
def test_load_refuses_what_we_did_not_write(content, tmp_path):
    (tmp_path / "x.json").write_bytes(content)
    with refused("files.json" if content in OTHER[:3] else "document.other", "x.json"):
        load(tmp_path / "x.json")
    with refused("reading.missing", "y.json"):
        load(tmp_path / "y.json")
