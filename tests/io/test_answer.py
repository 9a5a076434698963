"""A Posterior in Python: what it shows of itself, and its draws in the formats of other libraries."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from cavirheo import load
from cavirheo.errors import InputError
from cavirheo.posterior import Checks, Posterior

CHECKS = Checks("ok", (), 0.0064, 0.005, 0.02, 4, 4.02, *np.zeros((4, 9000)))


@pytest.fixture
def posterior() -> Posterior:
    rng = np.random.default_rng(0)
    theta = np.column_stack([3.8 + 0.05 * rng.standard_normal(900), 8.5 + 0.2 * rng.standard_normal(900)])
    return Posterior(
        ("log10_shear_modulus", "stretch"), ("Pa", "1"), theta, CHECKS, "nhkv", "verified",
        {"long": list(range(9000))}, log_q=np.zeros(900), log_weight=0.5 * rng.standard_normal(900) - 700.0,
    )  # fmt: skip


def test_it_shows_its_answer_and_not_its_arrays(posterior):
    text = repr(posterior)
    assert len(text) < 400
    first, modulus, _ = text.splitlines()
    assert all(word in first for word in ("nhkv", "verified", "900 draws", "ok", "0.64 %"))
    told = [posterior.median("shear_modulus"), *posterior.interval("shear_modulus")]
    assert [float(part.strip("[],")) for part in modulus.split()[1:4]] == pytest.approx(told, rel=0.02)
    assert len(repr(CHECKS)) < 100


def test_dataframe_has_the_draws_in_natural_units(posterior):
    pytest.importorskip("pandas")
    frame = posterior.to_dataframe()
    assert list(frame.columns) == ["shear_modulus_Pa", "stretch", "weight"]
    assert frame["shear_modulus_Pa"].to_numpy() == pytest.approx(10.0 ** posterior.theta[:, 0])
    assert frame["weight"].sum() == pytest.approx(1.0)  # though the largest weight is exp(-698)
    assert frame["weight"].idxmax() == np.argmax(posterior.log_weight)
    assert frame.attrs["verdict"] == "ok"
    assert replace(posterior, log_weight=None).to_dataframe()["weight"].std() == 0.0


def test_arviz_gets_draws_units_and_weights(posterior):
    pytest.importorskip("arviz")
    data = posterior.to_arviz()
    assert data["posterior"]["shear_modulus"].attrs["units"] == "Pa"
    assert data["posterior"]["shear_modulus"].dims == ("chain", "draw")
    assert data["posterior"]["stretch"].values[0] == pytest.approx(posterior.theta[:, 1])
    assert data["posterior"].attrs["material"] == "nhkv"
    assert float(data["sample_stats"]["weight"].sum()) == pytest.approx(1.0)
    assert data["sample_stats"]["log_weight"].values[0] == pytest.approx(posterior.log_weight)


@pytest.mark.parametrize(("name", "method"), [("pandas", "to_dataframe"), ("arviz", "to_arviz")])
def test_a_missing_library_is_named(posterior, monkeypatch, name, method):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError) as refused:
        getattr(posterior, method)()
    assert refused.value.code == "posterior.missing_library"
    assert f"pip install {name}" in str(refused.value)


def test_plot_has_marginals_and_pairs(posterior, tmp_path):
    pytest.importorskip("corner")
    figure = posterior.plot()
    assert [axes.get_xlabel() for axes in figure.axes if axes.get_xlabel()] == ["shear_modulus (Pa)", "stretch"]
    marks = [line.get_xdata()[0] for line in figure.axes[0].lines]
    low, high = posterior.interval("shear_modulus")
    assert marks == pytest.approx([low, posterior.median("shear_modulus"), high], rel=2e-3)
    figure.savefig(tmp_path / "a.png")


def test_a_point_has_nothing_to_plot(posterior):
    with pytest.raises(InputError) as refused:
        replace(posterior, theta=posterior.theta[:1]).plot()
    assert refused.value.code == "posterior.no_draws"


# --- cavirheo.load ----------------------------------------------------------------------------------------------------


HEAD = {"schema": 1, "version": "0", "command": "cavirheo"}
EMPTY = {"mean": None, "std": None, "median": None}
LAW = {"log_evidence": -3.0, "standard_error": None, "probability": 1.0}
RANKED = {"name": "a", "shots": 1, "chosen": "nhkv", "contenders": ["nhkv"], "laws": {"nhkv": LAW}}
DOCUMENTS = {
    "Result": {"curves": [], "groups": []},
    "Laws": {"curves": [RANKED], "groups": []},
    "Rheometry": {
        "material": "", "tolerance": 0.1, "at_rad_per_s": 1.0, "shear_modulus_Pa": EMPTY, "shear_modulus_from": "",
        "viscosity_Pa_s": EMPTY, "sweeps": [],
    },
    "CollapseTimes": {"material": "nhkv", "medium": {}, "groups": []},
}  # fmt: skip


KINDS = {"Result": "result", "Laws": "laws", "Comparison": "comparison", "Rheometry": "rheometer"}
KINDS |= {"CollapseTimes": "collapse-time"}


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("kind", DOCUMENTS)
def test_load_tells_documents_apart_by_what_they_say_and_old_ones_by_their_name(kind, old, tmp_path):

    said = {} if old else {"kind": KINDS[kind]}
    name = f"{KINDS[kind]}.json" if old else "any.json"
    (tmp_path / name).write_text(json.dumps(said | HEAD | DOCUMENTS[kind]), encoding="utf-8")
    found = load(tmp_path / name)
    assert type(found).__name__ == kind
    assert found.kind == KINDS[kind]
    assert found.command == "cavirheo"


def test_load_takes_the_one_document_of_a_folder(tmp_path):

    (tmp_path / "result.json").write_text(json.dumps(HEAD | DOCUMENTS["Result"]), encoding="utf-8")
    assert load(tmp_path) == load(tmp_path / "result.json")
    (tmp_path / "laws.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        load(tmp_path)
    assert refused.value.code == "loading.folder"
    assert "result.json, laws.json" in str(refused.value)


def test_load_refuses_another_kind_than_the_one_wanted(tmp_path):
    from cavirheo.reporting.laws import Laws
    from cavirheo.reporting.record import Result

    (tmp_path / "result.json").write_text(json.dumps(HEAD | DOCUMENTS["Result"]), encoding="utf-8")
    assert load(tmp_path, Result) == load(tmp_path)
    for kind, code, told in ((Laws, "loading.kind", "is a Result, not a Laws"), ("Laws", "input.type", "'Laws'")):
        with pytest.raises(InputError, match=told) as refused:
            load(tmp_path, kind)
        assert refused.value.code == code


def test_load_reads_a_training_set(tmp_path):
    from cavirheo.training.dataset import generate
    from cavirheo.training.recipe import read_recipe

    recipe = read_recipe(ROOT / "recipes" / "laptop.toml")
    generate(recipe.problem, 2, tmp_path, progress=False)
    assert load(tmp_path).theta.shape[0] == 2


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (None, "files.unreadable"),
        (b"\xff\xfe\x00", "document.other"),
        (b"time_us,radius_um\n", "document.other"),
        ([], "document.other"),
        ({"a": 1}, "document.other"),
        (HEAD | {"kind": "poem"}, "document.other"),
        (HEAD | {"kind": ["result"]}, "document.other"),
        (HEAD | {"kind": "result"}, "document.other"),  # without rows
        (HEAD | DOCUMENTS["Result"], "document.kind"),  # of an older version, under another name
        (HEAD | {"curves": [{"name": 1}], "groups": []}, "document.kind"),
    ],
)
def test_load_refuses_what_we_did_not_write(content, code, tmp_path):
    if content is not None:
        (tmp_path / "x.json").write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    with pytest.raises(InputError) as refused:
        load(tmp_path / "x.json")
    assert refused.value.code == code
    assert "x.json" in str(refused.value)
