"""Laws with memory against convolution integrals, a Lagrangian tensor solution, and what they reduce to."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import load_benchmark
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from cavirheo.errors import InputError, SolverError
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.elastic import Fung, Gent, Linear, NeoHookean, Quadratic
from cavirheo.physics.materials import (
    Maxwell,
    NeoHookeanKelvinVoigt,
    OldroydB,
    QuadraticKelvinVoigt,
    QuadraticStandardLinearSolid,
    StandardLinearSolid,
    TotalRelaxation,
    UpperConvectedMaxwell,
    Viscoelastic,
    Zener,
    parse,
)
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.simulate import remembered, simulate
from cavirheo.physics.viscous import Newtonian

lagrangian = load_benchmark("lagrangian")
TIME = np.linspace(0, 100e-6, 101)
GEL = dict(max_radius=150e-6, stretch=5.0, time=TIME)
ARMS = [(UpperConvectedMaxwell(0.2, 3e-6), NeoHookean), (Maxwell(0.2, 3e-6), Linear)]
each_arm = pytest.mark.parametrize(("arm", "parent"), ARMS, ids=lambda x: getattr(x, "__name__", None) or str(x))
TAU = 3e-6
DEFAULT, EXACT = Accuracy(relative_error=1e-7), Accuracy(relative_error=1e-9)


def path(t):
    """A violent swing of the radius (m), from rest, and its rate."""
    w = 2 * np.pi / 8e-6
    R = 100e-6 * np.exp(0.9 * (np.cos(w * t) - 1))
    return R, -R * 0.9 * w * np.sin(w * t)


def along(arm, times):
    """Stress (Pa) of an arm that is relaxed at t = 0, along the path, from its terms."""
    C, n, fading, _ = arm.table().T

    def rate(t, m):
        R, U = path(t)
        return -m * fading - n * (1 + m) * U / R

    m = solve_ivp(rate, (0, times[-1]), np.zeros(len(C)), t_eval=times, rtol=1e-11, atol=1e-12, method="DOP853").y
    return C @ m


@each_arm
def test_an_arm_is_its_spring_with_a_fading_reference(arm, parent):
    """S(t) = e^(-t/tau) S_el(R/R(0)) + int e^(-(t-s)/tau) S_el(R/R(s)) ds/tau, S_el the spring's (docs (4.7))."""
    spring = parent(arm.modulus)
    times = np.array([0, 1e-6, 3.7e-6, 4e-6, 9e-6, 20e-6])
    for t, S in zip(times, along(arm, times), strict=True):
        R = path(t)[0]
        past, _ = quad(
            lambda s, t=t, R=R: np.exp(-(t - s) / TAU) / TAU * spring.closed(R / path(s)[0])[0], 0, t, limit=500
        )
        expected = np.exp(-t / TAU) * spring.closed(R / path(0.0)[0])[0] + past
        assert pytest.approx(expected, rel=1e-7, abs=1e-7 * arm.modulus) == S


CASES = {
    "ucm": (UpperConvectedMaxwell, {}),
    "linear": (Maxwell, {}),
    "oldroyd": (None, {"mu_s": 0.02}),
    "zener": (UpperConvectedMaxwell, {"G": 0.3}),
    "zener_lin": (Maxwell, {"G": 0.3}),
}


@pytest.mark.parametrize("law", CASES)
@pytest.mark.parametrize("motion", [pytest.param("rayleigh-plesset", marks=pytest.mark.slow), "keller-miksis"])
def test_against_the_stress_field_around_the_bubble(law, motion):
    """R, U and S of a violent collapse as benchmarks/lagrangian.py gets them from the tensor equations."""
    liquid = Medium(surface_tension=0.072)
    R_max, stretch, De, mu = 100e-6, 4.0, 0.3, 0.05
    t_c, p = liquid.time_scale(R_max), liquid.pressure
    arm, options = CASES[law]
    parts = []
    if arm is None:
        mu_s = options["mu_s"]
        material = OldroydB((mu + mu_s) * p * t_c, De * t_c, De * t_c * mu_s / (mu + mu_s))
    else:
        parts = [arm(mu * p * t_c, De * t_c)]
        spring = {UpperConvectedMaxwell: NeoHookean, Maxwell: Linear}[arm](options["G"] * p) if options else None
        material = Viscoelastic(spring, None, parts)
    t = np.linspace(0, 3, 61)
    C = np.inf if motion == "rayleigh-plesset" else liquid.sound_speed / liquid.velocity_scale
    R, U, S = lagrangian.solve(
        law, t, mu=mu, lam=De, stretch=stretch, We=p * R_max / (2 * 0.072), pv=liquid.vapour_pressure / p,
        k=1.4, C=C, n=40, rtol=1e-9, **options,
    )  # fmt: skip
    run = simulate(
        material,
        max_radius=R_max,
        stretch=stretch,
        time=t * t_c,
        medium=liquid,
        bubble=Bubble(motion=motion, exponent=1.4),
        relaxed=True,
        accuracy=EXACT,
    )
    assert run.radius / R_max == pytest.approx(R, rel=1e-6)
    assert run.velocity / liquid.velocity_scale == pytest.approx(U, abs=1e-5 * np.abs(U).max())
    assert run.stress / p == pytest.approx(S, abs=1e-5 * np.abs(S).max())
    assert R.min() < 0.3


# --- what they reduce to


@pytest.mark.parametrize(
    ("short", "parent"),
    [
        (lambda tau: Zener(5e3, 0.05, tau), NeoHookeanKelvinVoigt(5e3, 0.05)),
        (lambda tau: StandardLinearSolid(5e3, 0.05, tau), Viscoelastic(Linear(5e3), Newtonian(0.05))),
        (lambda tau: UpperConvectedMaxwell(0.05, tau), Newtonian(0.05)),
        (lambda tau: Maxwell(0.05, tau), Newtonian(0.05)),
        (lambda tau: OldroydB(0.05, tau, 0.4 * tau), Newtonian(0.05)),
    ],
    ids=["zener", "sls", "ucm", "maxwell", "oldroyd-b"],
)
@pytest.mark.parametrize("relaxed", [True, False])
def test_without_relaxation_time_an_arm_is_a_dashpot(short, parent, relaxed):
    expected = simulate(parent, **GEL).radius
    errors = [np.abs(simulate(short(tau), relaxed=relaxed, **GEL).radius - expected).max() for tau in (1e-7, 1e-9)]
    assert errors[1] / 150e-6 < 1e-3
    assert errors[1] < 0.05 * errors[0]


@pytest.mark.parametrize(("law", "parent"), [(Zener, NeoHookean), (StandardLinearSolid, Linear)])
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
    arm, half = UpperConvectedMaxwell(0.1, 2e-6), UpperConvectedMaxwell(0.05, 2e-6)
    one, two = (simulate(Viscoelastic(NeoHookean(2e3), None, arms), **GEL).radius for arms in ([arm], [half, half]))
    assert two == pytest.approx(one, rel=1e-4)
    none = simulate(Viscoelastic(NeoHookean(2e3), Newtonian(0.05), [UpperConvectedMaxwell(0.0, 1e-6)]), **GEL)
    assert none.radius == pytest.approx(simulate(NeoHookeanKelvinVoigt(2e3, 0.05), **GEL).radius, rel=1e-4)
    assert simulate(OldroydB(0.1, 1e-6, 1e-6), **GEL).radius == pytest.approx(
        simulate(Newtonian(0.1), **GEL).radius, rel=1e-4
    )


# --- relaxation of the total stress at a fixed place (qSLS)


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
    law = Viscoelastic(
        Quadratic(G * p, stiffening),
        Newtonian(solvent * p * t_c) if retardation else None,
        [TotalRelaxation((mu - solvent) * p * t_c, De * t_c)],
    )
    run = simulate(
        law,
        max_radius=R_max,
        stretch=stretch,
        time=t * t_c,
        medium=liquid,
        bubble=Bubble(exponent=1.4),
        relaxed=True,
        accuracy=EXACT,
    )
    return (y[0], y[2] / y[0] ** 3 - 4 * solvent * y[1] / y[0]), (run.radius / R_max, run.stress / p)


@pytest.mark.parametrize(("stiffening", "retardation"), [(0.0, 0.0), (0.05, 0.0), (0.2, 0.3)])
def test_total_stress_relaxes_as_the_field_writes_it(stiffening, retardation):
    (R, S), (radius, stress) = following(stiffening, retardation)
    assert radius == pytest.approx(R, abs=1e-7)
    assert stress == pytest.approx(S, abs=1e-6 * np.abs(S).max())
    assert R.min() < 0.5
    assert S[0] == stress[0] == 0  # spring and dashpot: no stress at all at the start


@pytest.mark.parametrize(
    "start",
    [{"relaxed": True, "bubble": Bubble(motion="rayleigh-plesset")}, {"bubble": Bubble()}],
    ids=["relaxed", "grown"],
)
@pytest.mark.parametrize("stiffening", [0.0, 0.02])
def test_without_relaxation_time_it_is_the_spring_beside_the_dashpot(start, stiffening):
    """Without sound, where the start has no stress: with sound the stress that comes within tau kicks the wall by
    S/(rho c), however short tau is."""
    parent, spring = QuadraticKelvinVoigt(5e3, 0.05, stiffening), Quadratic(5e3, stiffening)
    expected = simulate(parent, bubble=start["bubble"], **GEL).radius
    found = [
        simulate(Viscoelastic(spring, None, [TotalRelaxation(0.05, tau)]), **start, **GEL).radius
        for tau in (1e-8, 1e-9, 1e-10)
    ]
    errors = [np.abs(radius - expected).max() / 150e-6 for radius in found]
    assert errors[2] < 1e-3
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("beside", ["", " + newtonian(0.01)", " + ucm(0.1, 3e-6)"])
def test_the_fields_law_starts_without_stress(beside):
    """Of spring and dashpot; other arms keep what the growth left in them."""
    law = parse(f"qsls(5e3, 0.05, 3e-6, 0.02){beside}")
    start, relaxed = (simulate(law, relaxed=relaxed, **GEL).stress[0] for relaxed in (False, True))
    assert relaxed == 0
    assert (start == 0) == ("ucm" not in beside)
    open_to_growth = Viscoelastic(Quadratic(5e3, 0.02), law.viscous, [TotalRelaxation(0.05, 3e-6), *law.memory[1:]])
    assert simulate(open_to_growth, **GEL).stress[0] < start - 1e3


def test_total_stress_along_a_path_is_a_fading_mean():
    """R^3 S(t) = int e^(-(t-s)/tau) R(s)^3 [S_el - 4 mu U/R](s) ds/tau from a start without stress, any elastic law."""
    spring, mu = Fung(3e3, 0.01), 0.2
    C, n, fading, follows = TotalRelaxation(mu, TAU).table()[0]

    def rate(t, m):
        R, U = path(t)
        return -(m - follows * spring.stress(R / 60e-6)) * fading - n * (1 + m) * U / R

    times = np.array([1e-6, 3.7e-6, 4e-6, 9e-6, 20e-6])
    m = solve_ivp(rate, (0, times[-1]), [0.0], t_eval=times, rtol=1e-11, atol=1e-13, method="DOP853").y[0]

    def past(s, t):
        R, U = path(s)
        return np.exp(-(t - s) / TAU) / TAU * R**3 * (spring.stress(R / 60e-6) - 4 * mu * U / R)

    expected = [quad(past, 0, t, args=(t,), limit=500)[0] / path(t)[0] ** 3 for t in times]
    assert C * m == pytest.approx(expected, rel=1e-7)


# --- the state at R_max


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
    taut = Viscoelastic(Gent(1e3, 20.0), None, [Maxwell(0.1, 1e-6)])  # chains are taut before R_max
    run = simulate(taut, **GEL, throw=False)
    assert str(taut) in run.status
    assert np.isnan(run.radius).all()
    with pytest.raises(SolverError) as error:
        simulate(taut, **GEL)
    assert str(error.value) == run.status


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: Maxwell(-1.0, 1e-6), "viscosity"),
        (lambda: UpperConvectedMaxwell(1.0, 0.0), "relaxation_time"),
        (lambda: OldroydB(1.0, 1e-6, 2e-6), "retardation_time"),
        (lambda: OldroydB(1.0, 0.0, 0.0), "relaxation_time"),
        (lambda: Zener(-1.0, 1.0, 1e-6), "shear_modulus"),
        (lambda: QuadraticStandardLinearSolid(1e3, 0.0, 1e-6, 0.1), "viscosity"),
        (lambda: Viscoelastic(NeoHookean(1e3), None, 2 * [TotalRelaxation(0.1, 1e-6)]), "followed_twice"),
        (lambda: Viscoelastic(None, None, [Newtonian(1.0)]), "not_Arm"),
        (lambda: Viscoelastic(), "no_law"),
    ],
)
def test_bad_laws(make, code):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.code == f"physics.{code}"
