"""What a user holds can be pickled, copied and handed to other libraries, and is then the same."""

import copy
import inspect
import pickle
from typing import Any

import numpy as np
import pytest
from answers import document_of, same, shots, unanswered, with_evidence
from conftest import EXAMPLE

import cavirheo
from cavirheo import Bubble, InputError, Medium, SolverError
from cavirheo.physics.materials import LAWS, Material, parse
from cavirheo.physics.media import Pulse, Trace

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
        "evidence": with_evidence(answers[0], -3.0).evidence, "errors": cavirheo.CommonErrors(0.02),
        "document": document_of(list(zip(curves, answers, strict=True))),
        "input error": InputError("no file", "reading.missing"), "solver error": SolverError("too many steps"),
    }  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_copies_are_the_same(held, way):
    assert held["curve"].max_radius > 0  # what was computed is kept with the curve
    assert [name for name, one in held.items() if not same(one, WAYS[way](one))] == []
    assert WAYS[way](held["curve"]).with_max_radius(1e-4).max_radius == 1e-4
    with pytest.raises(ValueError, match="read-only"):
        WAYS[way](held["curve"]).radius[0] = 1.0
    assert not same(held["curve"], held["curve"].with_notes("another"))  # `same` sees a difference
    kinds = {one for one in (getattr(cavirheo, name) for name in cavirheo.__all__) if inspect.isclass(one)}
    assert kinds | {*LAWS.values()} <= {type(one) for one in held.values()}  # every exported class is tried
