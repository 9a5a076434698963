"""Laws with memory against convolution integrals, a Lagrangian tensor solution, and what they reduce to."""

import numpy as np
import pytest
from conftest import load_benchmark
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cavirheo import Bubble, Medium, Newtonian, SolverError, simulate
from cavirheo.physics import materials
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.elastic import Gent, Linear, NeoHookean, Quadratic
from cavirheo.physics.materials import Maxwell, OldroydB, TotalRelaxation, UpperConvectedMaxwell, Zener, parse
from cavirheo.physics.media import WATER
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.simulate import remembered

lagrangian = load_benchmark("lagrangian")
TIME = np.linspace(0, 100e-6, 101)
GEL = dict(max_radius=150e-6, stretch=5.0, time=TIME)
DEFAULT, EXACT = Accuracy(relative_error=1e-7), Accuracy(relative_error=1e-9)


CASES = {  # an arm of 0.05 and a spring of 0.3, in p_inf and t_c
    "ucm": (UpperConvectedMaxwell, None),
    "linear": (Maxwell, None),
    "oldroyd": (OldroydB, None),
    "zener": (UpperConvectedMaxwell, NeoHookean),
    "zener_lin": (Maxwell, Linear),
}


@pytest.mark.parametrize("law", CASES)
@pytest.mark.parametrize("motion", [pytest.param("rayleigh-plesset", marks=pytest.mark.slow), "keller-miksis"])
def test_against_the_stress_field_around_the_bubble(law, motion):
    """R, U and S of a violent collapse as benchmarks/lagrangian.py gets them from the tensor equations."""
    liquid = Medium(surface_tension=0.072)
    R_max, stretch, De, mu, mu_s, G = 100e-6, 4.0, 0.3, 0.05, 0.02, 0.3
    t_c, p = liquid.time_scale(R_max), liquid.pressure
    arm, spring = CASES[law]
    if arm is OldroydB:
        material, options = OldroydB((mu + mu_s) * p * t_c, De * t_c, De * t_c * mu_s / (mu + mu_s)), {"mu_s": mu_s}
    else:
        material = materials.Viscoelastic(spring and spring(G * p), None, [arm(mu * p * t_c, De * t_c)])
        options = {"G": G} if spring else {}
    t = np.linspace(0, 3, 61)
    C = np.inf if motion == "rayleigh-plesset" else liquid.sound_speed / liquid.velocity_scale
    pressures = dict(We=p * R_max / (2 * 0.072), pv=liquid.vapour_pressure / p, k=1.4, C=C)
    R, U, S = lagrangian.solve(law, t, mu=mu, lam=De, stretch=stretch, n=40, rtol=1e-9, **pressures, **options)
    way = dict(max_radius=R_max, stretch=stretch, time=t * t_c, medium=liquid, relaxed=True, accuracy=EXACT)
    run = simulate(material, bubble=Bubble(motion=motion, exponent=1.4), **way)
    assert run.radius / R_max == pytest.approx(R, rel=1e-6)
    assert run.velocity / liquid.velocity_scale == pytest.approx(U, abs=1e-5 * np.abs(U).max())
    assert run.stress / p == pytest.approx(S, abs=1e-5 * np.abs(S).max())
    assert R.min() < 0.3


@pytest.mark.parametrize(("law", "parent"), [(Zener, NeoHookean), (materials.StandardLinearSolid, Linear)])
def test_an_arm_that_never_relaxes_is_its_spring(law, parent):
    """Grown from R_0 the arm's spring acts beside the other one; relaxed at R_max it is stress-free there."""
    arm = 4e3
    material = law(5e3, arm * 10.0, 10.0)
    grown, spring = (simulate(law, accuracy=DEFAULT, **GEL) for law in (material, parent(5e3 + arm)))
    assert grown.radius == pytest.approx(spring.radius, abs=1e-4 * 150e-6)
    relaxed = simulate(material, relaxed=True, **GEL)
    assert relaxed.stress[0] == pytest.approx(parent(5e3).stress(5.0), rel=1e-9)
    assert grown.stress[0] == pytest.approx(parent(5e3 + arm).stress(5.0), rel=1e-5)


def test_parts_add():
    """Two half arms are one; an arm without viscosity is none; an Oldroyd-B fluid all of solvent is Newtonian."""
    arm, half, none = (UpperConvectedMaxwell(mu, 2e-6) for mu in (0.1, 0.05, 0.0))
    spring, dashpot = NeoHookean(2e3), Newtonian(0.05)
    same = [
        (materials.Viscoelastic(spring, None, [arm]), materials.Viscoelastic(spring, None, [half, half])),
        (materials.Viscoelastic(spring, dashpot), materials.Viscoelastic(spring, dashpot, [none])),
        (Newtonian(0.1), OldroydB(0.1, 1e-6, 1e-6)),
    ]
    for one, other in same:
        assert simulate(one, **GEL).radius == pytest.approx(simulate(other, **GEL).radius, rel=1e-4)


def following(stiffening, retardation, G=0.1, mu=0.2, De=0.3):
    """R and S by scipy from the equation of Z as the field writes it (IMRv2, stress 3 and 4), Keller-Miksis with a dry
    adiabatic gas, and from `simulate`."""
    liquid = Medium(surface_tension=0.0, vapour_reference_pressure=0.0)
    R_max, stretch = 100e-6, 3.0
    t_c, p = liquid.time_scale(R_max), liquid.pressure
    C = liquid.sound_speed / liquid.velocity_scale
    solvent, t = mu * retardation, np.linspace(0, 3, 61)

    def rate(t, y):
        R, U, Z = y
        q = 1 / (stretch * R)
        strain = (3 * stiffening - 1) * (5 - q**4 - 4 * q) / 2
        strain += 2 * stiffening * (27 / 40 + q**8 / 8 + q**5 / 5 + q**2 - 2 / q)
        Z_dot = -(Z - R**3 * G * strain) / De - 4 * (mu - solvent) / De * R**2 * U
        S = Z / R**3 - 4 * solvent * U / R
        S_dot = Z_dot / R**3 - 3 * U / R**4 * Z + 4 * solvent * (U / R) ** 2
        gas = stretch**-3 * R**-4.2
        force = (1 + U / C) * (gas + S - 1) + R / C * (-4.2 * gas * U / R + S_dot) - 1.5 * (1 - U / (3 * C)) * U * U
        return [U, force / ((1 - U / C) * R + 4 * solvent / C), Z_dot]

    y = solve_ivp(rate, (0, 3), [1.0, 0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-13, method="DOP853").y
    dashpot = Newtonian(solvent * p * t_c) if retardation else None
    law = materials.Viscoelastic(
        Quadratic(G * p, stiffening), dashpot, [TotalRelaxation((mu - solvent) * p * t_c, De * t_c)]
    )
    way = dict(max_radius=R_max, stretch=stretch, time=t * t_c, medium=liquid, relaxed=True, accuracy=EXACT)
    run = simulate(law, bubble=Bubble(exponent=1.4), **way)
    return (y[0], y[2] / y[0] ** 3 - 4 * solvent * y[1] / y[0]), (run.radius / R_max, run.stress / p)


@pytest.mark.parametrize(("stiffening", "retardation"), [(0.0, 0.0), (0.05, 0.0), (0.2, 0.3)])
def test_total_stress_relaxes_as_the_field_writes_it(stiffening, retardation):
    (R, S), (radius, stress) = following(stiffening, retardation)
    assert radius == pytest.approx(R, abs=1e-7)
    assert stress == pytest.approx(S, abs=1e-6 * np.abs(S).max())
    assert R.min() < 0.5
    assert S[0] == stress[0] == 0  # spring and dashpot: no stress at all at the start


@pytest.mark.parametrize("beside", ["", " + newtonian(0.01)", " + ucm(0.1, 3e-6)"])
def test_the_fields_law_starts_without_stress(beside):
    """Of spring and dashpot; other arms keep what the growth left in them."""
    law = parse(f"qsls(5e3, 0.05, 3e-6, 0.02){beside}")
    start, relaxed = (simulate(law, relaxed=relaxed, **GEL).stress[0] for relaxed in (False, True))
    assert relaxed == 0
    assert (start == 0) == ("ucm" not in beside)
    open_to_growth = materials.Viscoelastic(
        Quadratic(5e3, 0.02), law.viscous, [TotalRelaxation(0.05, 3e-6), *law.memory[1:]]
    )
    assert simulate(open_to_growth, **GEL).stress[0] < start - 1e3


@pytest.mark.parametrize(("G", "mu", "tau"), [(2e3, 0.05, 1e-6), (2e4, 0.3, 2e-5), (0.0, 1.0, 1e-4)])
def test_growth_leaves_what_an_impulse_leaves(G, mu, tau):
    """Against scipy: Rayleigh-Plesset from rest at R_0 with the velocity that just reaches R_max, isothermal gas."""
    numbers = dimensionless(Zener(G, mu, tau), WATER, 200e-6, 6.0)
    n, fading = numbers.memory[:, 1], numbers.memory[0, 2]
    modulus = numbers.memory[0, 0] / 2
    lam, We, pv = numbers.stretch, numbers.We, numbers.pv

    def rate(t, y):
        R, U, m = y[0], y[1], y[2:]
        q = 1 / (lam * R)
        S = -G / WATER.pressure / 2 * (5 - 4 * q - q**4) + modulus * (2 * m[0] + m[1] / 2)
        p = pv + (1 + lam / We - pv) / (lam * R) ** 3
        return [U, (p - 1 / (We * R) + S - 1 - 1.5 * U * U) / R, *(-m * fading - n * (1 + m) * U / R)]

    def turn(t, y):
        return y[1]

    turn.terminal, turn.direction = True, -1

    def grown(U):
        options = dict(events=turn, rtol=1e-10, atol=1e-12, method="DOP853")
        return solve_ivp(rate, (0, 10), [1 / lam, U, 0, 0], **options).y[:, -1]

    U = brentq(lambda U: grown(U)[0] - 1, 1.0, 400.0, xtol=1e-10)
    exact = grown(U)[2:]
    for rtol, close in ((1e-5, 1e-6), (1e-4, 1e-5), (1e-3, 1e-4)):  # of the simulation that goes on from there
        assert remembered(numbers, rtol) == pytest.approx(exact, rel=close, abs=close)


def test_growth_that_cannot_be_is_a_status():
    taut = materials.Viscoelastic(Gent(1e3, 20.0), None, [Maxwell(0.1, 1e-6)])  # chains are taut before R_max
    run = simulate(taut, **GEL, throw=False)
    assert str(taut) in run.status
    assert np.isnan(run.radius).all()
    with pytest.raises(SolverError) as error:
        simulate(taut, **GEL)
    assert str(error.value) == run.status
