"""Laws: one battery for every instantaneous law, what each reduces to (docs/method/physics.md, section 4), the notation
for sums of them, and a clear word for every mistake of whoever simulates."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from inspect import signature
from itertools import cycle
from math import inf, nan

import numpy as np
import pytest
from conftest import FIELD, WATER, refused
from scipy.integrate import quad

from cavirheo import Bubble, InputError, Medium, Newtonian, posterior, simulate
from cavirheo.inference.assumptions import Family
from cavirheo.parameters import PARAMETERS
from cavirheo.physics import laws, materials
from cavirheo.physics.accuracy import COARSE
from cavirheo.physics.bubble import Damage
from cavirheo.physics.laws import Elastic, Gent, MooneyRivlin, NeoHookean, Quadratic, Viscous, Yeoh
from cavirheo.physics.materials import EXAMPLE, LAWS, Material, TotalRelaxation, Viscoelastic, parse
from cavirheo.physics.media import Pulse
from cavirheo.physics.table import look_up


@dataclass(frozen=True)
class Own(Viscous):
    """The viscosity that a function gives."""

    apparent: Callable[[np.ndarray], np.ndarray] = field(repr=False)


def falling(rate: np.ndarray) -> np.ndarray:
    return 0.01 + 0.4 * np.exp(-1e-5 * rate)


ELASTIC: list[tuple[Elastic, float]] = [  # a law and its small-strain shear modulus, Pa
    (laws.Linear(3e3), 3e3),
    (NeoHookean(3e3), 3e3),
    (Quadratic(3e3, 0.4), 3e3),
    (MooneyRivlin(1e3, 500.0), 3e3),
    (Yeoh(1.5e3, 20.0, 1.0), 3e3),
    (laws.Fung(3e3, 0.3), 3e3),
    (Gent(3e3, 60.0), 3e3),
    (laws.ArrudaBoyce(3e3, 1e3), 3e3 * (1 + 0.6 / 1e3 + 99 / 175 / 1e6)),
]
VISCOUS: list[Viscous] = [
    Newtonian(0.05),
    laws.PowerLaw(2.0, 0.6),
    laws.PowerLaw(1e-4, 1.4),
    laws.HerschelBulkley(50.0, 2.0, 0.6),
    laws.CarreauYasuda(0.5, 0.01, 1e-4, 0.4),
    laws.CarreauYasuda(0.5, 0.01, 1e-4, 0.4, 0.7),
    laws.Cross(0.5, 0.01, 1e-4, 0.8),
    laws.PowellEyring(0.5, 0.01, 1e-4),
    Own(falling),
]
RATIOS = np.concatenate([np.geomspace(0.4, 0.98, 40), np.geomspace(1.02, 5.3, 40)])
RATES = np.geomspace(1e-2, 1e8, 83)


def by_quadrature(f, a, b):
    """Integral of f, over the logarithm so that decades count alike."""
    a, b = np.log(a), np.log(b)
    return quad(lambda x: f(np.array(np.exp(x))) * np.exp(x), a, b, epsabs=0, epsrel=1e-13, limit=400)[0]


@pytest.mark.parametrize(("law", "modulus"), ELASTIC, ids=str)
def test_elastic_law(law, modulus):
    """No stress at rest; it resists; dS_el/dL = -4 G at rest, is the derivative, and the table its integral."""
    assert law.stress(1.0) == pytest.approx(0.0, abs=1e-9)
    assert np.all(law.stress(RATIOS) * (RATIOS - 1) < 0)  # a stretched solid pulls the wall back, a squeezed one pushes
    assert law.slope(np.array([1.0, 1 + 1e-9])) == pytest.approx(-4 * modulus, rel=1e-7)
    h = 1e-4 * RATIOS
    difference = 8 * (law.stress(RATIOS + h) - law.stress(RATIOS - h)) - law.stress(RATIOS + 2 * h)
    assert law.slope(RATIOS) == pytest.approx((difference + law.stress(RATIOS - 2 * h)) / (12 * h), rel=1e-6)
    expected = np.array([by_quadrature(law.slope, 1.0, L) for L in RATIOS[::8]])
    assert look_up(law.table(), RATIOS[::8])[0] == pytest.approx(expected, rel=1e-8)
    assert look_up(law.table(), RATIOS)[1] == pytest.approx(law.slope(RATIOS), rel=1e-6)


@pytest.mark.parametrize("law", [NeoHookean(3e3), Quadratic(3e3, 0.4)], ids=str)
def test_the_closed_form(law):
    """Against quadrature to machine precision, and the table against it to 1e-7 over all that a collapse reaches."""
    for L in RATIOS[::8]:
        assert law.stress(L) == pytest.approx(by_quadrature(law.slope, 1.0, L), rel=1e-13)
    L = np.geomspace(0.03, 30, 4001)
    assert look_up(laws.table_of(law), L)[0] == pytest.approx(law.stress(L), rel=1e-7, abs=1e-5)


PARENTS = [  # a law, and those that reduce to it
    (NeoHookean(3e3), Quadratic(3e3, 0.0), MooneyRivlin(1500.0, 0.0), Yeoh(1500.0), laws.Fung(3e3, 0.0)),
    (NeoHookean(3e3), Gent(3e3, 1e12), laws.ArrudaBoyce(3e3, inf)),
    (Quadratic(3e3, 0.6), Yeoh(1500.0, 450.0)),
    (Newtonian(0.3), laws.PowerLaw(0.3, 1.0), laws.HerschelBulkley(0.0, 0.3, 1.0)),
    (Newtonian(0.3), laws.CarreauYasuda(0.3, 0.1, 1e-4, 1.0), laws.CarreauYasuda(0.3, 0.1, 0.0, 0.5)),
    (Newtonian(0.3), laws.Cross(0.3, 0.3, 1e-4, 0.8), laws.PowellEyring(0.3, 0.1, 0.0)),
]


@pytest.mark.parametrize(("law", "parent"), [(law, parent) for parent, *laws in PARENTS for law in laws], ids=str)
def test_a_law_reduces_to_its_parent(law, parent):
    at, close = (RATIOS, 1e-7) if isinstance(law, Elastic) else (RATES, 1e-10)
    assert law.stress(at) == pytest.approx(parent.stress(at), rel=close)


@pytest.mark.parametrize("law", VISCOUS, ids=str)
def test_viscous_law(law):
    """No stress at rest; odd and dissipating; the slope is the viscosity at the wall; the table is its integral."""
    g, h = np.concatenate([-RATES, RATES]), 1e-4 * RATES
    assert law.stress(0.0) == 0
    assert np.all(law.stress(g) * g < 0)
    assert law.stress(-RATES) == pytest.approx(-law.stress(RATES), rel=1e-15)
    assert look_up(law.table(), RATES)[1] == pytest.approx(-4 * law.apparent(laws.SHEAR_RATIO * RATES), rel=1e-6)
    bend = (look_up(law.table(), RATES + h)[1] - look_up(law.table(), RATES - h)[1]) / (2 * h)
    assert look_up(law.table(), RATES)[2] == pytest.approx(bend, rel=1e-3, abs=1e-3 * abs(law.stress(1e5)) / 1e10)
    inner = -4 * float(law.apparent(np.array(laws.SHEAR_RATIO * 5e-7))) * 1e-6
    for rate in RATES[::10]:
        expected = inner + by_quadrature(lambda e: -4 * law.apparent(laws.SHEAR_RATIO * e), 1e-6, rate)
        assert law.stress(rate) == pytest.approx(expected, rel=1e-6, abs=1e-6)


WAY = dict(max_radius=150e-6, stretch=5.0, time=np.linspace(0, 100e-6, 101))


def test_lock_up_is_a_status():
    law = Gent(3e3, 20.0)
    run = simulate(Viscoelastic(law, Newtonian(0.01)), **WAY | {"stretch": 3.0}, throw=False)
    assert str(law) in run.status
    assert np.isfinite(run.radius[:5]).all()  # it starts, and locks when the collapse has squeezed the gel
    assert np.isnan(run.radius[-1])
    at_once = simulate(law, **WAY | {"stretch": 5.0}, throw=False)
    assert at_once.stats["steps"] == 0


# --- the registry and the notation

THIN = Viscoelastic(Gent(2e3, 40.0), laws.CarreauYasuda(0.5, 0.01, 1e-4, 0.4))
FLUIDS = materials.Maxwell(0.1, 2e-6), materials.UpperConvectedMaxwell(0.2, 1e-5)
ARMS = Viscoelastic(NeoHookean(1e3), Newtonian(0.01), FLUIDS)
QSLS = [TotalRelaxation(0.1, 2e-6, stressed_by_growth=False)]


@pytest.mark.parametrize(
    ("text", "material"),
    [
        ("gent(shear_modulus=2e3, limit=40) + carreau-yasuda(0.5, 0.01, 1e-4, 0.4)", THIN),
        ("carreau_yasuda(0.5, 0.01, time=1e-4, exponent=.4)+gent(limit=40, shear-modulus=2e+3)", THIN),
        (" gent(2_000, 40)\n + (carreau-yasuda(0.5, 0.01, 1e-4, 0.4)) ", THIN),
        ("qsls(7e3, 0.1, 2e-6, 0.3) + newtonian(0.01)", Viscoelastic(Quadratic(7e3, 0.3), Newtonian(0.01), QSLS)),
        ("maxwell(0.1, 2e-6) + nhkv(1e3, 0.01) + ucm(0.2, 1e-5)", ARMS),
    ],
)
def test_what_is_read(text, material):
    assert parse(text) == material
    assert repr(parse(text)) == repr(material)  # also 40 as 40.0


@pytest.mark.parametrize("name", LAWS)
def test_every_law_by_position_and_by_name_and_described(name):
    law, takes = LAWS[name], signature(LAWS[name]).parameters
    values = [1.5 - 0.25 * k for k in range(len(takes))]
    given = {
        key: (value, 2 * value) if "tuple" in str(parameter.annotation) else value
        for value, (key, parameter) in zip(values, takes.items(), strict=True)
    }
    expected = law(**given)
    assert isinstance(expected, Material)
    assert parse(f"{name}({', '.join(map(str, given.values()))})") == expected
    assert parse(f"{name}({', '.join(f'{key}={value}' for key, value in given.items())})") == expected
    assert {key: getattr(expected, key) for key in given} == given
    assert takes.keys() <= PARAMETERS.keys()  # which have units


@pytest.mark.parametrize(
    ("text", "code", "named"),
    [
        ("", "laws.empty", EXAMPLE),
        ("gnet(1, 2)", "laws.unknown", "gent?"),
        ("Carreau-Yasuda(1, 1, 1, 1)", "laws.unknown", "carreau-yasuda?"),
        ("gent", "laws.parameters", "gent(shear_modulus [Pa], limit [-])"),
        ("gent(2e3, 40, limit=40)", "laws.parameters", "'limit'"),
        ("gent(2e3, __import__('os').getpid())", "laws.number", "__import__('os').getpid()"),
        ("gent(1" + 400 * "0" + ", 40)", "laws.number", "shear_modulus"),
        ("gent(2e3, 40) +", "laws.syntax", EXAMPLE),
        ("2 * gent(2e3, 40)", "laws.no_law", "'2 * gent(2000.0, 40)'"),
        ("gent(2e3, 40) + linear(2)", "laws.elastic_twice", "gent and linear"),
        ("newtonian(1) + cross(1, 1, 1)", "laws.viscous_twice", "newtonian and cross"),
    ],
)
def test_every_mistake_is_named(text, code, named):
    with refused(code, named):
        parse(text)


KINETIC = {"contents": "kinetic", "accommodation": 0.07}
SILENT = {"bubble": Bubble(motion="gilmore"), "medium": Medium(sound_speed=inf)}
IMPOSSIBLE: dict[str, list] = {  # by the code of the refusal: texts of laws, calls, and bubbles
    "C1": ["mooney-rivlin(1e3, -2e3)"],
    "stiffening": ["fung(1e3, -1)", "qkv(1e3, 0.1, -0.1)"],
    "limit": ["gent(1e3, 0)"],
    "segments": ["arruda-boyce(1e3, 0)"],
    "exponent": ["power-law(1, 0)", lambda: Pulse(1e6, 1e6, 0.0, 0.5), *({"exponent": n} for n in (0.0, "1.4", True))],
    "viscosity": ["newtonian(-0.1)", "maxwell(-1, 1e-6)", "qsls(1e3, 0, 1e-6, 0.1)"],
    "yield_stress": ["herschel-bulkley(-1, 1, 1)"],
    "time": ["powell-eyring(0.1, 0.1, -1e-4)"],
    "retardation_time": ["oldroyd-b(1, 1e-6, 2e-6)"],
    "shear_modulus": ["zener(-1, 1, 1e-6)", lambda: NeoHookean(nan), lambda: NeoHookean(True)],
    "negative_viscosity": [lambda: Own(lambda s: 1 - 1e-5 * s).table()],
    "rough": [lambda: Own(lambda s: np.random.default_rng(0).uniform(size=s.shape)).table()],
    "followed_twice": [lambda: Viscoelastic(NeoHookean(1e3), None, 2 * [TotalRelaxation(0.1, 1e-6)])],
    "not_Elastic": [lambda: Viscoelastic(Newtonian(1.0), NeoHookean(1e3))],
    "boiling": [lambda: replace(WATER, temperature=400.0)],
    "radius": [lambda: Damage(0.5, 0.9), lambda: Damage(0.5, nan)],
    "amplitude": [lambda: Pulse(nan, 1e6, 0.0)],
    "max_radius": [lambda: simulate(NeoHookean(1e3), **WAY | {"max_radius": -1e-4})],
    "stretch": [lambda: simulate(NeoHookean(1e3), **WAY | {"stretch": 0.5})],
    "times_descend": [lambda: simulate(NeoHookean(1e3), **WAY | {"time": [0, 2e-6, 1e-6]})],
    "no_fields": [lambda: simulate(NeoHookean(1e3), bubble=Bubble(exponent=1.4), fields=True, **WAY)],
    "sound_speed": [lambda: simulate(NeoHookean(1e3), **WAY | SILENT)],
    "contents": [{"contents": "frozen"}],
    "accommodation": [KINETIC | {"accommodation": value} for value in (0.0, "some")],
    "contents_twice": [{"exponent": 1.4} | other for other in ({"vapour_excess": "free"}, KINETIC)],
    "confinement_inertia": [{"confinement_inertia": -1.0}],
    "wall_too_near": [{"wall_distance": 100e-6}],
    "vapour_excess": [{"vapour_excess": -1.0}],
    "confinement_damping": [{"confinement_damping": -0.1}, {"confinement_damping": None}],
    "free_bubble": [{"contents": "kinetic"}, {"damage": "strain"}],
}


@pytest.mark.parametrize(("code", "make"), [(code, make) for code, makes in IMPOSSIBLE.items() for make in makes])
def test_what_cannot_be(code, make):
    with refused(f"physics.{code}"):
        if isinstance(make, dict):
            simulate(NeoHookean(1e3), bubble=Bubble(**make), **WAY)
        else:
            parse(make) if isinstance(make, str) else make()


@pytest.mark.parametrize("name", [*LAWS, "gent + carreau-yasuda", "fung + herschel-bulkley", "yeoh + oldroyd-b"])
def test_every_place_of_a_search_is_simulated_or_refused_by_name(name):
    """Corners of the ranges and places within them: a simulation, a status, or an InputError, and no warning."""
    family, rng = Family(name), np.random.default_rng(3)
    low, high = family.bounds().T
    places = [low + (high - low) * rng.random(len(low)) for _ in range(24)]
    places += [np.where(rng.random(len(low)) < 0.5, low, high) for _ in range(12)]
    at_rate = posterior.viscosity_at_rate(name, dict(zip(family.parameters, 10.0 ** np.transpose(places), strict=True)))
    assert (at_rate is None) == all(law not in name for law in ("carreau", "cross", "eyring", "herschel"))
    assert at_rate is None or at_rate.q05 <= at_rate.median <= at_rate.q95  # of draws of which some are no such law
    for place, bubble in zip(places, cycle([FIELD, Bubble("kinetic", 0.07)]), strict=False):
        stretch, top = 10.0 ** rng.uniform((0.1, -5.0), (1.2, -3.0))
        shot = {"max_radius": top, "stretch": stretch, "time": np.linspace(0.0, 4.0 * WATER.time_scale(top), 40)}
        code = ""
        try:
            run = simulate(family.material(place), **shot, bubble=bubble, accuracy=COARSE, throw=False)
            assert np.all(np.isfinite(run.radius)) == run.ok
        except InputError as error:
            code = error.code
        assert code in ("", "physics.retardation_time", "physics.negative_viscosity")
