"""What a user holds can be pickled, copied and handed to other libraries, and is then the same."""

import copy
import inspect
import pickle
from typing import Any

import numpy as np
import pytest
from answers import same, shots, unanswered
from conftest import EXAMPLE, refused

import cavirheo
from cavirheo import InputError, Medium, SolverError
from cavirheo.physics.materials import LAWS, Material, parse
from cavirheo.physics.media import Pulse, Trace
from cavirheo.posterior import Bubble, Evidence
from cavirheo.reporting import result, table
from cavirheo.writing.document import write_rows

WAYS = {"pickle": lambda one: pickle.loads(pickle.dumps(one, protocol=2)), "copy": copy.copy, "deepcopy": copy.deepcopy}


def law_of(name: str) -> Material:
    """The law with a value of 2 for each parameter without one, which every law allows."""
    needed = [one for one in inspect.signature(LAWS[name]).parameters.values() if one.default is one.empty]
    return LAWS[name](**{one.name: (2.0,) if "tuple" in str(one.annotation) else 2.0 for one in needed})


@pytest.fixture(scope="module")
def held() -> dict[str, Any]:
    """An object of every public kind."""
    curve, time = cavirheo.read_curves(EXAMPLE)[0], np.linspace(0.0, 5e-5, 20)
    answers, gel = shots(4), parse("neo-hookean(8e3)+newtonian(0.05)")
    curves = [curve, *(curve.with_notes(str(k)) for k in range(3))]
    seen = {name: Medium(temperature=300.0) if name == "medium" else law_of(name) for name in ("medium", *LAWS)}
    return seen | {
        "curve": curve, "answer": answers[0], "failed answer": unanswered(),
        "population": cavirheo.population(answers), "empty population": cavirheo.population(answers[:1]),
        "simulation": cavirheo.simulate(gel, max_radius=2e-4, stretch=6.0, time=time),
        "pulse": Pulse(1e5, 1e6, 1e-6), "trace": Trace(time, 1e5 * time), "bubble": Bubble("kinetic"),
        "rig": cavirheo.Rig(frames=64),
        "evidence": Evidence(-3.0, 0.1), "errors": cavirheo.CommonErrors(0.02),
        "document": result(list(zip(curves, answers, strict=True)), "cavirheo infer"),
        "input error": InputError("no file", "reading.missing"), "solver error": SolverError("too many steps"),
    }  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_copies_are_the_same(held, way):
    assert held["curve"].max_radius > 0  # what was computed is kept with the curve
    assert [name for name, one in held.items() if not same(one, WAYS[way](one))] == []
    assert WAYS[way](held["curve"]).with_max_radius(1e-4).max_radius == 1e-4
    with pytest.raises(ValueError, match="read-only"):
        held["curve"].radius[0] = 1.0
    assert not same(held["curve"], held["curve"].with_notes("another"))  # `same` sees a difference
    kinds = {one for one in (getattr(cavirheo, name) for name in cavirheo.__all__) if inspect.isclass(one)}
    assert kinds | {*LAWS.values()} <= {type(one) for one in held.values()}  # every exported class is tried


COLUMNS = {
    "curve": "time_s radius_m radius_std_m",
    "simulation": "time_us radius_um velocity_m_per_s pressure_Pa stress_Pa strain strain_rate_per_s",
    "answer": "shear_modulus_Pa viscosity_Pa_s weight",
    "population": "shear_modulus_Pa shear_modulus_spread_decades viscosity_Pa_s viscosity_spread_decades",
}


def test_draws_and_documents_are_tables_and_drawn(held, tmp_path):
    pandas = pytest.importorskip("pandas")
    frames = {name: held[name].to_dataframe() for name in COLUMNS}
    assert {name: " ".join(frame.columns) for name, frame in frames.items()} == COLUMNS
    np.testing.assert_array_equal(frames["curve"]["radius_m"], held["curve"].radius)
    population, drawn = held["population"], frames["population"]
    quantiles = drawn["viscosity_Pa_s"].quantile([0.05, 0.95])
    assert quantiles.tolist() == pytest.approx(population.interval("mu"))
    assert drawn["viscosity_Pa_s"].median() == pytest.approx(population.median("mu"))
    assert drawn["viscosity_spread_decades"].median() == pytest.approx(population.scatter("viscosity")[1])
    write_rows(tmp_path / "result.csv", *table.csv_rows(held["document"]))
    frame, read = held["document"].to_dataframe(), pandas.read_csv(tmp_path / "result.csv")
    assert list(frame.columns) == list(read.columns)
    assert frame["viscosity_Pa_s"].tolist() == pytest.approx(read["viscosity_Pa_s"].tolist(), rel=1e-5)
    pytest.importorskip("arviz")
    material = population.to_arviz()["posterior"]["viscosity"]
    assert material.attrs["units"] == "Pa s"
    np.testing.assert_array_equal(material.values[0], population.draws("mu"))  # of equal weight
    pytest.importorskip("matplotlib")
    assert {axes.get_xlabel() for axes in population.corner().axes} - {""} == {"G (kPa)", "µ (Pa s)"}
    for method in ("to_dataframe", "to_arviz", "corner"):
        with refused("population.no_draws"):
            getattr(held["empty population"], method)()
