"""The face of the package in Python: names, documentation, and one sentence for each wrong call."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cavirheo
from cavirheo import InputError, Medium, NeoHookeanKelvinVoigt, Posterior, RadiusCurve
from cavirheo.inference.budget import Budget
from cavirheo.inference.verify import Verification, VerificationOptions, verify
from cavirheo.inference.verify.evidence import rank_laws
from cavirheo.physics import laws
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.driving import Pulse
from cavirheo.physics.media import MEDIA, medium
from cavirheo.physics.simulate import SimulationOptions
from cavirheo.posterior import Checks
from cavirheo.problem import TrainingProblem
from cavirheo.training.recipe import Recipe
from cavirheo.video.measurement import MeasureOptions, measure

GEL = NeoHookeanKelvinVoigt(8e3, 0.05)
TIME = np.arange(100) * 1e-6
RADIUS = 50e-6 + 150e-6 * np.abs(np.cos(TIME / 15e-6)) * np.exp(-TIME / 60e-6)
CURVE = RadiusCurve(TIME, RADIUS)
BUBBLE = {"max_radius": 2e-4, "stretch": 6.0, "time": TIME[:3]}
ANSWER = Posterior(
    ("log10_shear_modulus", "log10_viscosity"), ("Pa", "Pa s"), np.array([[3.9, -1.3], [4.0, -1.2], [4.1, -1.1]]),
    Checks("ok"), "nhkv", "laplace", best={"shear_modulus": 1e4, "viscosity": 0.06, "stretch": 7.0}, stretch=7.0,
)  # fmt: skip
NAMES_AND_UNITS = "shear_modulus, viscosity"


def simulate(material=GEL, **changes):
    return cavirheo.simulate(material, **(BUBBLE | changes))


def many(materials, **changes):
    return cavirheo.simulate_many(materials, **(BUBBLE | changes))


WRONG = [  # a call, and what its error must name: the value given, or the mend
    (lambda: cavirheo.infer("shot.csv"), "read_curves"),
    (lambda: cavirheo.infer(Path("shot.csv")), "read_curves"),
    (lambda: cavirheo.infer([CURVE]), "infer_many"),
    (lambda: cavirheo.infer(RADIUS), "RadiusCurve"),
    (lambda: cavirheo.infer(None), "None"),
    (lambda: cavirheo.infer_many("shot.csv"), "read_curves"),
    (lambda: cavirheo.infer_many(CURVE), "infer_many"),
    (lambda: cavirheo.infer_many(["a.csv", "b.csv"]), "read_curves"),
    (lambda: cavirheo.infer(CURVE, model="gel"), "bdt-viscoelastic"),
    (lambda: cavirheo.infer(CURVE, model=3), "bdt-viscoelastic"),
    (lambda: cavirheo.infer(CURVE, medium="honey"), "honey"),
    (lambda: cavirheo.infer(CURVE, medium=1000.0), "Medium"),
    (lambda: cavirheo.infer(CURVE, stretch="7"), "'7'"),
    (lambda: cavirheo.infer(CURVE, stretch=[7]), "[7]"),
    (lambda: cavirheo.infer(CURVE, stretch=0.5), "0.5"),
    (lambda: cavirheo.infer(CURVE, window="2"), "'2'"),
    (lambda: cavirheo.infer(CURVE, window=0), "0"),
    (lambda: cavirheo.infer(CURVE, window=1.5), "1.5"),
    (lambda: cavirheo.infer(CURVE, verify="all"), "none, map or full"),
    (lambda: cavirheo.infer(CURVE, verify=True), "none, map or full"),
    (lambda: cavirheo.infer(CURVE, verify="full", seed=-1), "-1"),
    (lambda: cavirheo.infer(CURVE, seed="x"), "'x'"),
    (lambda: cavirheo.infer_many([CURVE], workers="2"), "'2'"),
    (lambda: cavirheo.infer_many([CURVE], workers=0), "0"),
    (lambda: cavirheo.fit("shot.csv"), "read_curves"),
    (lambda: cavirheo.fit([CURVE]), "fit_many"),
    (lambda: cavirheo.fit_many(CURVE), "fit_many"),
    (lambda: cavirheo.fit(CURVE, "honey"), "honey"),
    (lambda: cavirheo.fit(CURVE, GEL), "nhkv"),
    (lambda: cavirheo.fit(CURVE, window="2"), "'2'"),
    (lambda: cavirheo.fit(CURVE, end="10"), "'10'"),
    (lambda: cavirheo.fit(CURVE, stretch="seven"), "plateau"),
    (lambda: cavirheo.fit(CURVE, free="clock"), "t0, scale, rmax"),
    (lambda: cavirheo.fit(CURVE, free=3), "t0, scale, rmax"),
    (lambda: cavirheo.fit(CURVE, free=[1, "t0"]), "t0, scale, rmax"),
    (lambda: cavirheo.fit(CURVE, t0_bound="1"), "'1'"),
    (lambda: cavirheo.fit(CURVE, scale_bound=1.5), "1.5"),
    (lambda: cavirheo.fit(CURVE, weights=None), "equal"),
    (lambda: cavirheo.fit(CURVE, seed=1.5), "1.5"),
    (lambda: cavirheo.fit(CURVE, medium=["water"]), "water"),
    (lambda: verify("shot.csv", ANSWER), "read_curves"),
    (lambda: verify(CURVE, "nhkv"), "nhkv"),
    (lambda: verify(CURVE, ANSWER, budget=Budget(draws="many")), "'many'"),
    (lambda: verify(CURVE, ANSWER, ranges=[1, 2]), "[1, 2]"),
    (lambda: rank_laws([CURVE], "nhkv"), "nhkv"),
    (lambda: rank_laws(CURVE, ["nhkv", "zener"]), "RadiusCurve"),
    (lambda: simulate("nhkv"), "NeoHookeanKelvinVoigt"),
    (lambda: simulate(NeoHookeanKelvinVoigt), "NeoHookeanKelvinVoigt"),
    (lambda: simulate(max_radius=250), "0.00025 m"),
    (lambda: simulate(max_radius=0.25), "0.00025 m"),
    (lambda: simulate(max_radius="250 um"), "'250 um'"),
    (lambda: simulate(max_radius=[1e-4, 2e-4]), "[0.0001, 0.0002]"),
    (lambda: simulate(stretch="6"), "'6'"),
    (lambda: simulate(stretch=float("nan")), "nan"),
    (lambda: simulate(time=np.arange(100.0)), "9.9e-05 s"),
    (lambda: simulate(time="100 us"), "100 us"),
    (lambda: dataclasses.replace(simulate(), radius=np.full(3, 200.0)), "0.0002 m"),
    (lambda: dataclasses.replace(simulate(), time=np.arange(100.0)), "9.9e-05 s"),
    (lambda: simulate(time=[[0.0, 1e-6]]), "(1, 2)"),
    (lambda: simulate(time=[1e-6, 0.0]), "ascend"),
    (lambda: simulate(medium="honey"), "honey"),
    (lambda: simulate(driving=1e5), "Pulse"),
    (lambda: simulate(bubble="field"), "'field'"),
    (lambda: simulate(accuracy=1e-5), "1e-05"),
    (lambda: Bubble(motion="gilmor"), "gilmor"),
    (lambda: Bubble(exponent="air"), "'air'"),
    (lambda: Accuracy(relative_error="fine"), "'fine'"),
    (lambda: Accuracy(cells=100.5), "100.5"),
    (lambda: many(GEL), "[NeoHookeanKelvinVoigt"),
    (lambda: many("nhkv"), "NeoHookeanKelvinVoigt"),
    (lambda: many([GEL, GEL], max_radius=["a", "b"]), "max_radius"),
    (lambda: many([GEL, GEL], max_radius=[1e-4] * 3), "(3,)"),
    (lambda: NeoHookeanKelvinVoigt("8 kPa", 0.05), "'8 kPa'"),
    (lambda: NeoHookeanKelvinVoigt(8e3, None), "None"),
    (lambda: NeoHookeanKelvinVoigt(-8e3, 0.05), "-8000"),
    (lambda: Pulse("1 MPa", 1e6, 0.0), "'1 MPa'"),
    (lambda: RadiusCurve(TIME, RADIUS * 1e6), "um"),
    (lambda: RadiusCurve(TIME, RADIUS * 1e3), "mm"),
    (lambda: RadiusCurve(TIME * 1e6, RADIUS), "us"),
    (lambda: RadiusCurve(TIME * 1e9, RADIUS), "ns"),
    (lambda: RadiusCurve("time", "radius"), "'time'"),
    (lambda: RadiusCurve(TIME, [["a"]]), "[['a']]"),
    (lambda: RadiusCurve(TIME, RADIUS[None]), "(1, 100)"),
    (lambda: RadiusCurve(TIME[None], RADIUS[None]), "(1, 100)"),
    (lambda: RadiusCurve(TIME, RADIUS[:50]), "(50,)"),
    (lambda: RadiusCurve(TIME, RADIUS, meta="shot 1"), "'shot 1'"),
    (lambda: CURVE.with_max_radius(250), "0.00025 m"),
    (lambda: CURVE.with_max_radius("250"), "'250'"),
    (lambda: ANSWER.median("G"), NAMES_AND_UNITS),
    (lambda: ANSWER.draws("stretch"), NAMES_AND_UNITS),
    (lambda: ANSWER.interval("mu"), NAMES_AND_UNITS),
    (lambda: ANSWER.interval("viscosity", 95), "0.95"),
    (lambda: ANSWER.interval("viscosity", "0.9"), "'0.9'"),
    (lambda: ANSWER.interval("viscosity", 1.0), "1.0"),
    (lambda: cavirheo.read_curves(["a.csv", "b.csv"]), "a.csv"),
    (lambda: cavirheo.read_curves(None), "None"),
    (lambda: cavirheo.read_curves("nowhere.csv"), "nowhere.csv"),
    (lambda: cavirheo.load(7), "7"),
]


@pytest.mark.parametrize(("call", "named"), WRONG)
def test_a_wrong_call_is_told_what_was_given_or_how_to_mend_it(call, named):
    with pytest.raises(InputError) as error:
        call()
    assert named in str(error.value)
    assert "\n" not in str(error.value)
    assert error.value.code != "input"


CONSTANTS = [  # as a user may give them, and the value that was meant
    ("temperature", 25, "298.15 K"),
    ("density", 1.05, "1050 kg/m3"),
    ("sound_speed", 1.5, "1500 m/s"),
    ("surface_tension", 72, "0.072 N/m"),
    ("pressure", 1, "100000 Pa"),
    ("pressure", 101.3, "101300 Pa"),
    ("pressure", 1013, "101300 Pa"),
    ("gas_constant", 0.287, "287 J/(kg K)"),
    ("vapour_constant", 0.462, "462 J/(kg K)"),
    ("diffusivity", 0.242, "2.42e-05 m2/s"),
    ("diffusivity", 24.2, "2.42e-05 m2/s"),
    ("conductivity_slope", 0.053, "5.3e-05 W/(m K2)"),
    ("conductivity_intercept", 11.7, "0.0117 W/(m K)"),
    ("adiabatic_index", 140, "1 to 1.7"),
    ("vapour_reference_temperature", 52, "1000 to 20000 K"),
]


@pytest.mark.parametrize(("name", "given", "meant"), CONSTANTS)
def test_a_constant_in_another_unit_is_refused_and_can_be_insisted_on(name, given, meant):
    for make in (lambda **constants: Medium(**constants), lambda **constants: medium("water", **constants)):
        with pytest.raises(InputError, match="unusual=True") as error:
            make(**{name: given})
        assert error.value.code == f"physics.unusual_{name}"
        assert meant in str(error.value)
    if name not in ("temperature", "pressure", "vapour_reference_temperature"):  # the liquid would boil
        insisted = medium("water", unusual=True, **{name: given})
        assert getattr(insisted, name) == given
        assert "unusual" not in dataclasses.asdict(insisted)


def test_a_problem_of_an_unusual_medium_is_read_back():
    problem = TrainingProblem.from_dict({
        "material": "nhkv", "medium": {"density": 13534.0, "surface_tension": 0.485, "name": "mercury"},
        "prior": {"log10_shear_modulus": [3, 5], "log10_viscosity": [-3, 0], "stretch": [3, 9]},
        "camera": {}, "reference_max_radius": 2e-4,
    })  # fmt: skip
    assert TrainingProblem.from_dict(problem.to_dict()).id == problem.id


def test_a_recipe_may_insist():
    table = {"density": 13534.0, "unusual": True}
    parts = {"prior": {"log10_viscosity": (-3, 0), "stretch": (3, 9)}, "data": {"n": 1}, "export": {"name": "mercury"}}
    recipe = Recipe.model_validate(parts | {"problem": {"material": "newtonian", "medium": table}})
    assert recipe.problem.medium.density == 13534.0
    with pytest.raises(InputError):
        _ = Recipe.model_validate(parts | {"problem": {"material": "newtonian", "medium": {"density": 1.05}}}).problem


def test_a_medium_may_be_named():
    ours = [simulate(medium=kind).radius for kind in ("bu2026", MEDIA["bu2026"])]
    np.testing.assert_array_equal(*ours)
    assert simulate().radius[-1] != ours[0][-1]


def test_lists_do_for_arrays():
    curve = RadiusCurve(TIME.tolist(), RADIUS.tolist())
    assert curve.max_radius == CURVE.max_radius
    assert simulate(time=TIME[:3].tolist()).radius.tolist() == simulate().radius.tolist()


def test_curves_without_a_scale_are_not_asked_for_one():
    assert RadiusCurve(TIME, 1e6 * RADIUS, unscaled="pixels").with_max_radius(2e-4).max_radius == 2e-4
    stars = RadiusCurve(TIME / 2e-5 * 0.1, RADIUS / 2e-4, unscaled="no R_max", time_unscaled=True)
    assert np.median(np.diff(stars.with_max_radius(2e-4).time)) == pytest.approx(1e-6)


def test_a_file_in_other_units_than_it_says_leaves_its_other_curves(tmp_path):
    slow, fast = (1e6 * TIME * factor for factor in (1e6, 1.0))
    shots = [(k, row) for k, clock in ((1, slow), (2, fast)) for row in np.column_stack([clock, 1e6 * RADIUS])]
    rows = [f"{k},{t:.9g},{r:.9g}" for k, (t, r) in shots]
    (tmp_path / "two.csv").write_text("\n".join(["shot,time_us,radius_um", *rows]))
    wrong, right = cavirheo.read_curves(tmp_path / "two.csv")
    assert "us" in wrong.unusable
    assert right.max_radius == pytest.approx(2e-4, rel=0.02)


@pytest.fixture(scope="module")
def curve():
    return cavirheo.read_curves(Path(__file__).parents[1] / "examples" / "soft_gel.csv")[0]


@pytest.mark.parametrize("free", ["t0, scale", ["t0", "scale"]])
def test_what_is_free_may_be_written_as_on_the_command_line(curve, free):
    answer = cavirheo.fit(curve, bubble="field", window=1, free=free, seed=np.int64(3))
    assert set(answer.diagnostics.free) == {"time_origin", "radius_scale"}


def test_dir_shows_the_public_names_alone():
    code = "import cavirheo.inference, cavirheo; print(*dir(cavirheo))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    shown = [name for name in done.stdout.split() if not name.startswith("__")]
    assert shown == cavirheo.__all__
    assert "__version__" in done.stdout.split()


def test_the_version_is_that_of_the_installation():
    from importlib.metadata import version

    assert cavirheo.__version__ == version("cavirheo")


PUBLIC = (
    "curve posterior prior problem physics.accuracy physics.bubble physics.media physics.simulation "
    "physics.driving physics.law physics.elastic physics.viscous physics.memory physics.materials "
    "inference.collapse_time inference.verify inference.population.material companions.design"
)


def public_dataclasses():
    for name in PUBLIC.split():
        module = importlib.import_module(f"cavirheo.{name}")
        for kind in vars(module).values():
            here = inspect.isclass(kind) and kind.__module__ == module.__name__ and not kind.__name__.startswith("_")
            if here and dataclasses.is_dataclass(kind):
                yield kind


@pytest.mark.parametrize("kind", [*public_dataclasses()], ids=lambda kind: kind.__name__)
def test_help_shows_every_field(kind):
    own = [field.name for field in dataclasses.fields(kind) if not field.name.startswith("_")]
    assert [name for name in own if not re.search(rf"\b{name}\b", kind.__doc__ or "")] == []


def test_all_that_is_exported_is_looked_at():
    exported = {getattr(cavirheo, name) for name in cavirheo.__all__}
    assert {kind for kind in exported if dataclasses.is_dataclass(kind)} <= {*public_dataclasses()}
    assert {*laws.LAWS.values()} <= {*public_dataclasses()}


# --- what help() says of every public name ----------------------------------------------------------------------------


ERRORS = {"InputError", "SolverError"}
FUNCTIONS = [name for name in cavirheo.__all__ if inspect.isfunction(getattr(cavirheo, name))]
CLASSES = [name for name in cavirheo.__all__ if inspect.isclass(getattr(cavirheo, name)) and name not in ERRORS]
MADE_HERE = {"Simulation", "Posterior", "Population"}  # the package makes these, so no user's mistake is refused
SOURCED = {"infer", "infer_many", "fit", "fit_many", "measure", "population", "simulate", "simulate_many"}
SI = re.compile(r"\bSI\b|\bPa\b|\bkg/m3|\bm\b|\bs\b|1/s")


def lacks(function):
    """What the docstring of a function does not say: a parameter, what it returns, what it raises."""
    said = inspect.getdoc(function) or ""
    parameters = [name for name in inspect.signature(function).parameters if name != "self"]
    missing = [name for name in parameters if not re.search(rf"\b{name}\b", said)]
    return missing + [part for part in ("Returns:", "Raises:") if f"\n{part}\n" not in said]


def as_infer_says(name):
    """The parameters of `infer_many` that it takes as `infer` does."""
    return {*inspect.signature(cavirheo.infer).parameters} if name == "infer_many" else set()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_of_a_function_is_whole(name):
    function = getattr(cavirheo, name)
    assert set(lacks(function)) <= as_infer_says(name)
    said = inspect.getdoc(function)
    assert SI.search(said)
    known = {error for error in ERRORS if f"{error}:" in said}
    assert known, "it names no error of ours"
    assert name not in SOURCED or re.search(r"Source: .*(docs/method/[\w-]+\.md|doi:)", said)


@pytest.mark.repository
@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_of_a_function_names_pages_that_are_there(name):
    pages = re.findall(r"\b(?:docs|benchmarks)/[\w/-]+\.md", inspect.getdoc(getattr(cavirheo, name)))
    assert all((Path(__file__).parent.parent / page).exists() for page in pages)


@pytest.mark.parametrize("name", CLASSES)
def test_help_of_a_class_is_whole(name):
    kind = getattr(cavirheo, name)
    said = inspect.getdoc(kind)
    assert SI.search(said)
    assert name in MADE_HERE or "Raises:\n    InputError: " in said
    own = [key for key in vars(kind) if not key.startswith("_") and key not in kind.__annotations__]
    told = {key for key in own if inspect.getdoc(getattr(kind, key)) or re.search(rf"\b{key}\b", said)}
    assert set(own) == told


@pytest.mark.parametrize("name", sorted(ERRORS))
def test_help_of_an_error_says_when(name):
    assert len(inspect.getdoc(getattr(cavirheo, name)).split()) > 8


def test_a_gap_is_found():
    def short(curve, medium):
        """Of a curve.

        Returns:
            Something.
        """

    assert lacks(short) == ["medium", "Raises:"]


# --- options that are told to type checkers apart from the function that takes them -----------------------------------


@pytest.mark.parametrize(
    ("told", "function", "also"),
    [
        (SimulationOptions, cavirheo.simulate, {"material", "max_radius", "stretch", "time", "throw"}),
        (MeasureOptions, measure, {"path"}),
        (VerificationOptions, Verification, {"workers"}),
    ],
)
def test_options_are_told_to_type_checkers_as_the_function_has_them(told, function, also):
    options = {name: one.annotation for name, one in inspect.signature(function).parameters.items()}
    assert {*options} == {*told.__annotations__} | also
    changed = {name for name, one in told.__annotations__.items() if options[name] != one.__forward_arg__}
    assert changed <= {"medium"}  # a verification takes its name, too


@pytest.mark.parametrize(("function", "given"), [(cavirheo.fit, [CURVE]), (many, [[GEL]]), (verify, [CURVE, ANSWER])])
def test_a_misspelt_option_is_refused(function, given):
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        function(*given, stretsh=6.0)
