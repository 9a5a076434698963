"""The face of the package in Python: names, options, and one sentence for each wrong call."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from answers import GEL, answer, shots
from conftest import EXAMPLE, refused

import cavirheo
from cavirheo import InputError, Medium, NeoHookeanKelvinVoigt, RadiusCurve

TIME = np.arange(100) * 1e-6
RADIUS = 50e-6 + 150e-6 * np.abs(np.cos(TIME / 15e-6)) * np.exp(-TIME / 60e-6)
CURVE = RadiusCurve(TIME, RADIUS)
BUBBLE = {"max_radius": 2e-4, "stretch": 6.0, "time": TIME[:3]}
ANSWER = answer(CURVE, draws=3)
KNOWN = replace(ANSWER, curve=CURVE, medium=Medium())


def simulate(material=GEL, **changes):
    return cavirheo.simulate(material, **(BUBBLE | changes))


def measure(**options):
    return cavirheo.measure(EXAMPLE.with_name("bubble.mp4"), frame_rate=5e5, um_per_px=4.0, **options)


META = {"medium": {"rho": 1}, "stretch": "7", "exposure_s": "x", "exposure": 1, "frame_rate_hz": "1e5", "density": 1}
SETTINGS = [("window", 0), ("window", True), ("trust_input", "false"), ("discrepancy", 3), ("material", "")]
SHOT = {"max_radius": (250, "0.00025 m"), "bubble": ("field", "'field'"), "accuracy": (1e-5, "1e-05")}
PARTS = {"maximum": (0, -1), "stated_time_of_max": np.nan, "late": 0, "warnings": ("boo",), "radius_std": -RADIUS}
WRONG = [  # a call, and what its error must name: the value given, or the mend
    (lambda: cavirheo.infer("shot.csv"), "read_curves"),
    (lambda: cavirheo.infer_many(CURVE), "infer_many"),
    (lambda: cavirheo.infer(CURVE, model="gel"), "bdt-viscoelastic"),
    (lambda: cavirheo.infer(CURVE, medium=1000.0), "Medium"),
    *((lambda name=name, of=of: cavirheo.infer(CURVE, **{name: of}), repr(of)) for name, of in SETTINGS),
    (lambda: cavirheo.infer(CURVE, model="bdt-viscous", discrepancy=False), "--exact-law (discrepancy=False)"),
    (lambda: cavirheo.infer(CURVE.labelled(exposure_s=1e-7), model="bdt-viscous"), "--exposure-us"),
    (lambda: cavirheo.read_curves("shot.csv", frame_rate_hz="x"), "'x'"),
    (lambda: cavirheo.infer(CURVE, windows=2), "infer has no option windows; it has curve, medium, stretch, "),
    (lambda: cavirheo.infer_many([CURVE], windows=2), "infer_many has no option windows; it has curves, "),
    (lambda: Medium(density=3, unusual="no"), "True or False as unusual; got str 'no'"),
    (lambda: cavirheo.fit([CURVE]), "fit_many"),
    (lambda: cavirheo.fit(CURVE, GEL), "nhkv"),
    *((lambda law=law: cavirheo.fit(CURVE, law), law) for law in ("jelly", "nhkv(8e3, 0.1)")),
    (lambda: cavirheo.fit(CURVE, stretch="seven"), "plateau"),
    (lambda: cavirheo.fit(CURVE, end=50), "did you mean 5e-05 s (50 us)?"),
    (lambda: cavirheo.fit(CURVE, free="clock"), "t0, scale, rmax"),
    (lambda: simulate("nhkv"), "NeoHookeanKelvinVoigt"),
    *((lambda name=name: simulate(**{name: SHOT[name][0]}), SHOT[name][1]) for name in SHOT),
    (lambda: simulate(relaxed="no"), "relaxed"),
    (lambda: cavirheo.population([ANSWER], only_trusted="no"), "only_trusted"),
    (lambda: cavirheo.Bubble(accommodation=0.07), "--contents kinetic"),
    (lambda: cavirheo.Bubble(wall_distance=500), "did you mean 0.0005 m (500 um)?"),
    (lambda: cavirheo.simulate_many(GEL, **BUBBLE), "[NeoHookeanKelvinVoigt"),
    (lambda: simulate(NeoHookeanKelvinVoigt(np.array([1e3, 2e3]), 0.1)), "shear_modulus must be one number"),
    (lambda: cavirheo.measure("shot.tif", fps=1e6), "frame_rate"),
    *([(lambda: measure(exclude=3), "frames to exclude must be numbers from 1 to 80")] if find_spec("av") else []),
    (lambda: measure(roi="0,0,64,64"), "roi must be 4 numbers, got '0,0,64,64'"),
    (lambda: NeoHookeanKelvinVoigt("8 kPa", 0.05), "'8 kPa'"),
    (lambda: RadiusCurve(TIME, RADIUS * 1e6), "um"),
    *((lambda key=key: RadiusCurve(TIME, RADIUS, meta={key: META[key]}), key) for key in META),
    (lambda: RadiusCurve(TIME, RADIUS, meta={"medium": {"density": -1}}), "density must be finite and positive"),
    (lambda: RadiusCurve(TIME, RADIUS, meta={"notes": "hello"}), "notes"),
    *((lambda key=key: RadiusCurve(TIME, RADIUS, **{key: PARTS[key]}), key) for key in PARTS),
    (lambda: RadiusCurve(TIME, RADIUS, 0.0 * RADIUS + 1.0), "radius_std must be 0 to 0.05 m, got 1: did you mean"),
    *((lambda of=of: CURVE.resampled(*of), f"got {of[-1]}") for of in ((-1e-6,), (1e-6, 0))),
    *((lambda of=of: CURVE.window(*of), f"got {of[-1]!r}") for of in ((1.5,), ("x",), (None, "x"), (None, 50))),
    (lambda: CURVE.normalised("honey"), "known: water"),
    (lambda: ANSWER.median("E"), "G (shear_modulus), µ (viscosity)"),
    (lambda: cavirheo.design(ranges={"E": (1e3, 1e4)}), "'E'"),
    (lambda: cavirheo.predict_radius(ANSWER, TIME), "no curve"),
    (lambda: cavirheo.predict_radius(KNOWN, 1e6 * TIME), "(99 us)"),
    (lambda: cavirheo.predict_radius(KNOWN, ["soon"]), "soon"),
    (lambda: cavirheo.read_curves(["a.csv", "b.csv"]), "a.csv"),
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
    ("pressure", 1013, "101300 Pa"),
    ("vapour_reference_temperature", 52, "1000 to 20000 K"),
]


@pytest.mark.parametrize(("name", "given", "meant"), CONSTANTS)
def test_a_constant_in_another_unit_is_refused_and_can_be_insisted_on(name, given, meant):
    with refused(f"physics.unusual_{name}", meant, "unusual=True"):
        cavirheo.read_curves(EXAMPLE, **{name: given}) if name in ("density", "pressure") else Medium(**{name: given})
    if name not in ("temperature", "pressure", "vapour_reference_temperature"):  # the liquid would boil
        assert getattr(Medium(unusual=np.True_, **{name: given}), name) == given


def test_a_parameter_is_named_by_symbol_natural_name_or_column():
    """Of one shot and of many, for every function of a parameter."""
    material, shot = cavirheo.population(shots(4)), replace(ANSWER, best={"stretch": 7.0})
    for spelled, name in (("G", "shear_modulus"), ("mu", "viscosity"), ("µ", "viscosity"), ("\u03bc", "viscosity"),
                          ("shear_modulus_Pa", "shear_modulus"), ("viscosity_Pa_s", "viscosity")):  # fmt: skip
        for one in (shot, material):
            assert one.draws(spelled).tolist() == one.draws(name).tolist()
            for of in (one.interval, one.median, one.bound, one.quantity):
                assert of(spelled) == of(name)
        assert material.scatter(spelled) == material.scatter(name)
    with refused("posterior.parameter", "stretch", "best"):  # it is known, and not inferred
        shot.interval("lambda")
    several = replace(shot, names=("log10_viscosity", "log10_viscosity_2"), units=("Pa s", "Pa s"))
    assert [several.median(given) for given in ("mu", "mu_2")] == [several.median(name) for name in several.parameters]
