"""One battery for every instantaneous law, and what each law reduces to. docs/method/physics.md, section 4."""

import re
from math import inf

import numpy as np
import pytest
from scipy.integrate import quad

from cavirheo import Newtonian, SolverError, simulate
from cavirheo.physics import elastic, viscous
from cavirheo.physics.elastic import Gent, MooneyRivlin, NeoHookean, Ogden, Quadratic, StrainEnergy, Yeoh
from cavirheo.physics.law import SHEAR, Elastic, Viscous
from cavirheo.physics.materials import Material, Viscoelastic
from cavirheo.physics.table import read
from cavirheo.physics.viscous import CarreauYasuda, Cross, HerschelBulkley, PowerLaw, Viscosity


def gent_energy(l1, l2, l3):
    return -0.5 * 3e3 * 60 * np.log(1 - (l1**2 + l2**2 + l3**2 - 3) / 60)


ELASTIC: list[tuple[Elastic, float]] = [  # a law and its small-strain shear modulus, Pa
    (elastic.Linear(3e3), 3e3),
    (NeoHookean(3e3), 3e3),
    (Quadratic(3e3, 0.4), 3e3),
    (MooneyRivlin(1e3, 500.0), 3e3),
    (Yeoh(1.5e3, 20.0, 1.0), 3e3),
    (elastic.Fung(3e3, 0.3), 3e3),
    (Gent(3e3, 60.0), 3e3),
    (elastic.ArrudaBoyce(3e3, 1e3), 3e3 * (1 + 0.6 / 1e3 + 99 / 175 / 1e6)),
    (Ogden((2e3, -500.0), (2.5, -2.0)), 3e3),
    (StrainEnergy(gent_energy), 3e3),
]
VISCOUS: list[Viscous] = [
    Newtonian(0.05),
    PowerLaw(2.0, 0.6),
    PowerLaw(1e-4, 1.4),
    HerschelBulkley(50.0, 2.0, 0.6),
    CarreauYasuda(0.5, 0.01, 1e-4, 0.4),
    CarreauYasuda(0.5, 0.01, 1e-4, 0.4, 0.7),
    Cross(0.5, 0.01, 1e-4, 0.8),
    viscous.PowellEyring(0.5, 0.01, 1e-4),
    Viscosity(lambda s: 0.01 + 0.4 * np.exp(-1e-5 * s)),
]
CLOSED = [law for law, _ in ELASTIC if hasattr(law, "closed")]
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
    assert read(law.table(), RATIOS[::8])[0] == pytest.approx(expected, rel=1e-8)
    assert read(law.table(), RATIOS)[1] == pytest.approx(law.slope(RATIOS), rel=1e-6)


@pytest.mark.parametrize("law", CLOSED, ids=str)
def test_closed_forms(law):
    """Against quadrature to machine precision, and the table against them to 1e-6 over all that a collapse reaches."""
    for L in RATIOS[::8]:
        assert law.stress(L) == pytest.approx(by_quadrature(law.slope, 1.0, L), rel=1e-13)
    L = np.geomspace(1e-2, 30, 4001)
    for from_table, closed in zip(read(law.table(), L), law.closed(L), strict=True):
        assert np.max(np.abs(from_table - closed) / np.maximum(1, np.abs(closed))) < 1e-4
    assert read(law.table(), L)[0] == pytest.approx(law.stress(L), rel=1e-6)
    h = 1e-5 * L
    slope_rise = (law.closed(L + h)[1] - law.closed(L - h)[1]) / (2 * h)
    assert law.closed(L)[2] == pytest.approx(slope_rise, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(("stiffening", "ratio"), [(0.0, 5.0), (1e-3, 8.0), (0.05, 7.0), (0.4, 3.0)])
def test_the_closed_form_of_fungs_stress(stiffening, ratio):
    values = (np.array([value]) for value in (3e3, stiffening, ratio))
    exact = -elastic.Fung(3e3, stiffening).stress(np.array([ratio]))
    assert elastic.fung_stress(*values) == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize(
    ("law", "parent"),
    [
        (Quadratic(3e3, 0.0), NeoHookean(3e3)),
        (MooneyRivlin(1500.0, 0.0), NeoHookean(3e3)),
        (Yeoh(1500.0), NeoHookean(3e3)),
        (Yeoh(1500.0, 450.0), Quadratic(3e3, 0.6)),
        (elastic.Fung(3e3, 0.0), NeoHookean(3e3)),
        (Gent(3e3, 1e12), NeoHookean(3e3)),
        (elastic.ArrudaBoyce(3e3, inf), NeoHookean(3e3)),
        (Ogden([3e3], [2.0]), NeoHookean(3e3)),
        (Ogden((2e3, -1e3), (2.0, -2.0)), MooneyRivlin(1e3, 500.0)),
        (StrainEnergy(gent_energy), Gent(3e3, 60.0)),
    ],
    ids=str,
)
def test_elastic_law_reduces_to_its_parent(law, parent):
    assert law.stress(RATIOS) == pytest.approx(parent.stress(RATIOS), rel=1e-7)


@pytest.mark.parametrize("law", VISCOUS, ids=str)
def test_viscous_law(law):
    """No stress at rest; odd and dissipating; the slope is the viscosity at the wall; the table is its integral."""
    g, h = np.concatenate([-RATES, RATES]), 1e-4 * RATES
    assert law.stress(0.0) == 0
    assert np.all(law.stress(g) * g < 0)
    assert law.stress(-RATES) == pytest.approx(-law.stress(RATES), rel=1e-15)
    assert read(law.table(), RATES)[1] == pytest.approx(-4 * law.apparent(SHEAR * RATES), rel=1e-6)
    bend = (read(law.table(), RATES + h)[1] - read(law.table(), RATES - h)[1]) / (2 * h)
    assert read(law.table(), RATES)[2] == pytest.approx(bend, rel=1e-3, abs=1e-3 * abs(law.stress(1e5)) / 1e10)
    inner = -4 * float(law.apparent(np.array(SHEAR * 5e-7))) * 1e-6
    for rate in RATES[::10]:
        expected = inner + by_quadrature(lambda e: -4 * law.apparent(SHEAR * e), 1e-6, rate)
        assert law.stress(rate) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_viscous_closed_forms():
    assert np.array_equal(Newtonian(0.3).stress(RATES), -4 * 0.3 * RATES)
    n = 0.6  # without the regularisation: -(4/n) K (2 sqrt 3)^(n-1) g^n
    g = np.geomspace(1e8, 1e11, 30)
    free = -4 / n * 2.0 * SHEAR ** (n - 1) * g**n
    assert PowerLaw(2.0, n, 1e-2).stress(g) == pytest.approx(free, rel=1e-6)
    assert HerschelBulkley(0.0, 2.0, n, 1e-2).stress(g) == pytest.approx(free, rel=1e-6)
    g = np.geomspace(1e4, 1e8, 30)
    cross = -4 / SHEAR * (0.01 * SHEAR * g + 0.49 * np.log1p(1e-4 * SHEAR * g) / 1e-4)
    assert Cross(0.5, 0.01, 1e-4).stress(g) == pytest.approx(cross, rel=1e-8)
    carreau = -4 / SHEAR * np.arcsinh(1e-4 * SHEAR * g) / 1e-4
    assert CarreauYasuda(1.0, 0.0, 1e-4, 0.0).stress(g) == pytest.approx(carreau, rel=1e-8)
    bingham = -4 / SHEAR * 50.0 * np.arcsinh(SHEAR * g / 3.0)
    assert HerschelBulkley(50.0, 0.0, 1.0, 3.0).stress(g) == pytest.approx(bingham, rel=1e-8)


@pytest.mark.parametrize(
    "law",
    [
        PowerLaw(0.3, 1.0),
        HerschelBulkley(0.0, 0.3, 1.0),
        CarreauYasuda(0.3, 0.1, 1e-4, 1.0),
        CarreauYasuda(0.3, 0.1, 0.0, 0.5),
        Cross(0.3, 0.3, 1e-4, 0.8),
        viscous.PowellEyring(0.3, 0.1, 0.0),
        Viscosity(lambda s: 0.3),
    ],
    ids=str,
)
def test_viscous_law_reduces_to_newtonian(law):
    assert law.stress(RATES) == pytest.approx(Newtonian(0.3).stress(RATES), rel=1e-10)


GEL = dict(max_radius=150e-6, stretch=5.0, time=np.linspace(0, 100e-6, 101))
PARTS = [Viscoelastic(law, Newtonian(0.05)) for law, _ in ELASTIC if not isinstance(law, Gent | StrainEnergy)]
PARTS += [Viscoelastic(Gent(2e4, 100.0), Newtonian(0.3)), StrainEnergy(lambda a, b, c: 5e2 * (a**2 + b**2 + c**2 - 3))]
PARTS += [*VISCOUS, *(Viscoelastic(NeoHookean(2e3), law) for law in VISCOUS)]


@pytest.mark.parametrize("material", PARTS, ids=str)
def test_every_law_simulates(material):
    assert isinstance(material, Material)
    run = simulate(material, **GEL)
    assert run.ok
    assert abs(run.stats["gas_drift"]) < 1e-11
    assert 0 < run.radius.min() < run.radius.max() <= 150e-6 * (1 + 1e-9)


def test_lock_up_is_a_status():
    law = Gent(3e3, 20.0)
    with pytest.raises(SolverError, match=re.escape(str(law))):
        simulate(Viscoelastic(law, Newtonian(0.01)), **GEL | {"stretch": 3.0})
    run = simulate(Viscoelastic(law, Newtonian(0.01)), **GEL | {"stretch": 3.0}, throw=False)
    assert np.isfinite(run.radius[:5]).all()  # it starts, and locks when the collapse has squeezed the gel
    assert np.isnan(run.radius[-1])
    taut = law.table()[[0, -1], 0]
    assert all(f"{ratio:.4g}" in run.status for ratio in taut)
    assert taut**-4 + 2 * taut**2 - 3 == pytest.approx(20.0, rel=1e-6)
    at_once = simulate(law, **GEL | {"stretch": 5.0}, throw=False)
    assert at_once.stats["steps"] == 0
    assert "t = 0 us" in at_once.status
