"""Condensation at a finite rate, inertia of walls, vapour above saturation, damage: their limits, balances and orders.

`pytest -s` shows every measured number beside its limit. The limits are two to ten times what was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import load_benchmark
from scipy.integrate import cumulative_simpson
from scipy.optimize import brentq
from test_limits import DRY, GEL, HOT, IDEAL, dense, draws, exact_wave, largest, response, stored, tap, within

from cavirheo.errors import InputError
from cavirheo.physics import simulate as forward
from cavirheo.physics.damage import KINDS, Damage
from cavirheo.physics.driving import Pulse
from cavirheo.physics.elastic import NeoHookean
from cavirheo.physics.materials import NeoHookeanKelvinVoigt, Zener
from cavirheo.physics.media import WATER
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.simulate import simulate, simulate_many
from cavirheo.physics.viscous import Newtonian

field_standard = load_benchmark("field_standard")
TIME = np.linspace(0, 100e-6, 101)
COLLAPSE = dict(stretch=5.0, max_radius=150e-6)


def test_infinitely_fast_condensation_is_equilibrium(monkeypatch):
    """With constant D the gap falls as 1/rate (measured 5e-7 at 1e6, 5e-9 at 1e8)."""
    materials, where = draws(4, 1)
    shots = [
        (gel, dict(stretch=stretch, max_radius=radius, time=TIME, rtol=1e-7))
        for gel, stretch, radius in zip(materials, where["stretch"], where["max_radius"], strict=True)
    ]
    exact = [simulate(gel, **way).radius / way["max_radius"] for gel, way in shots]
    gaps = []
    for rate in (1e6, 1e7):

        def fast(*law, rate=rate, **way):
            return dimensionless(*law, **way)._replace(rate=rate, varying=False)

        monkeypatch.setattr(forward, "dimensionless", fast)
        found = [simulate(gel, **way).radius / way["max_radius"] for gel, way in shots]
        gaps.append(max(largest(a - b) for a, b in zip(found, exact, strict=True)))
    within(1e-6, gap=gaps[0])
    within(0.05, order_less_1=abs(np.log10(gaps[0] / gaps[1]) - 1))


def test_the_default_is_equilibrium():
    run, same = (simulate(GEL, time=TIME, **COLLAPSE, **way) for way in ({}, {"contents": "equilibrium"}))
    assert np.array_equal(run.radius, same.radius)
    slow = simulate(GEL, time=TIME, contents="kinetic", **COLLAPSE)
    assert largest(slow.radius - run.radius) > 0.02 * 150e-6


@pytest.mark.parametrize("way", [dict(), dict(accommodation=0.01, confinement_inertia=0.3)], ids=str)
def test_second_implementation(way):
    """Mass fractions on finite differences, D(T, p) with its gradient, and the root of the balance at the wall."""
    way = dict(contents="kinetic", **way)
    numbers = dimensionless(GEL, WATER, 150e-6, 5.0, **way)
    t_star = np.linspace(0, 1.1, 40)  # through the collapse to 0.08-0.12 R_max
    y = np.tanh(4.0 * np.linspace(0, 1, 80)) / np.tanh(4.0)
    t_c = WATER.time_scale(150e-6)
    iCa, iRe = GEL.shear_modulus / WATER.pressure, GEL.viscosity / (WATER.pressure * t_c)
    further = dict(rate=numbers.rate, inertia=numbers.inertia, method="Radau")
    theirs = field_standard.solve(numbers, y, t_star, 1e-6, iCa, iRe, **further)
    ours = simulate(GEL, time=t_star * t_c, **COLLAPSE, **way).radius / 150e-6
    within(3e-4, gap=largest(ours - theirs))


@pytest.mark.parametrize("medium", [WATER, HOT], ids=lambda medium: medium.name)
@pytest.mark.parametrize("accommodation", [3e-3, 0.07, 1.0])
def test_small_oscillations(medium, accommodation):
    """The response to a tap in closed form: the wall's layer of vapour has the conductance of the rate in series."""
    radius, motion, width = 20e-6, "keller-miksis", 2.0
    n = dimensionless(
        Newtonian(4e-3), medium, radius, 1.0, contents="kinetic", accommodation=accommodation
    )  # fmt: skip
    p, t_c = 1 + 1 / n.We, medium.time_scale(radius)
    x, resistance, drag = n.pv / p, n.Fo / (n.rate * p), 4e-3 / (medium.pressure * t_c)

    def layer(square):
        q = np.sqrt(square + 0j)
        return (q / np.tanh(q) - 1) / square

    def H(s):
        heat, vapour = (n.kappa - 1) * n.chi / (n.kappa * p), n.Fo / p
        wet = layer(s / vapour)
        wet = wet / (1 + resistance / (1 - x) * s / vapour * wet)
        K = 3 * n.kappa * p / (1 + 3 * (n.kappa - 1) * layer(s / heat) + 3 * n.kappa * x / (1 - x) * wet) - 1 / n.We
        return -(1 + s / n.C) / (s * s + (1 + s / n.C) * (K + 4 * drag * s))

    driving = tap(medium, radius, width)
    t, exact = exact_wave(H, lambda t: driving.pressure(t * t_c) / medium.pressure, 40.0)
    t, exact = t[:8192:16], exact[:8192:16]
    way = dict(motion=motion, contents="kinetic", accommodation=accommodation)
    found = response(Newtonian(4e-3), medium, radius, t, driving, cells=256, **way)
    within(4e-5, error=largest(found - exact) / largest(exact))


@pytest.mark.parametrize("accommodation", [1e-3, 0.07, 10.0])
def test_gas_is_conserved_to_round_off(accommodation):
    materials, where = draws(20, 1)
    way = dict(time=np.linspace(0, 150e-6, 151), contents="kinetic", accommodation=accommodation, **where)
    runs = simulate_many(materials, **way)
    assert all(run.ok for run in runs), [run.status for run in runs if not run.ok]
    within(1e-11, drift=max(abs(run.stats["gas_drift"]) for run in runs))


def test_vapour_and_energy_balance():
    """What leaves through the wall is the law of Hertz and Knudsen, and carries its enthalpy; heat is conducted there.

    From the fields alone: moles and pV against the time integrals of what passes the wall.
    """
    n = dimensionless(GEL, WATER, 150e-6, 5.0, contents="kinetic")
    run = dense(GEL, WATER, 150e-6, 5.0, 60e-6, 6001, contents="kinetic", fields=True, precise=True)
    grid = forward.wall_clustered(forward.PRECISE[0], forward.WALL_CELL)
    t, R, U = run.time / WATER.time_scale(150e-6), run.radius / 150e-6, run.velocity / WATER.velocity_scale
    p, T = run.pressure / WATER.pressure, run.contents.temperature / WATER.temperature
    k = run.contents.vapour
    x = k * 462 / (k * 462 + (1 - k) * 287)
    moles = R**3 * p * (x[:, :-1] / T[:, :-1] / grid.inverse_volume).sum(axis=1)
    flux = n.rate * (p * x[:, -1] - n.pv)
    theta = 0.5 * n.A * (T**2 - 1) + n.B * (T - 1)
    conducted = -n.chi * theta[:, [-2, -3]] @ grid.wall[1:] / R
    kept = p * R**3 / (3 * (n.kappa - 1))
    lost = p * R**2 * U + R**2 * (conducted + n.kappa / (n.kappa - 1) * flux)
    escaped, spent = (cumulative_simpson(f, x=t, initial=0) for f in (R**2 * flux, lost))
    assert moles.min() < 0.2 * moles[0]
    within(2e-4, vapour=largest(moles + escaped - moles[0]) / moles[0])
    within(2e-4, energy=largest(kept + spent - kept[0]) / kept.max())


@pytest.mark.parametrize("gel", [GEL, Zener(1e4, 0.1, 3e-6)], ids=["gel", "zener"])
def test_order_of_convergence_in_time(gel):
    way = dict(time=TIME, contents="kinetic", **COLLAPSE)
    fine = simulate(gel, rtol=1e-9, **way)
    runs = [simulate(gel, rtol=r, **way) for r in (1e-4, 1e-5, 1e-6, 1e-7)]
    errors = [largest(r.radius - fine.radius) / 150e-6 for r in runs]
    steps = [r.stats["steps"] for r in runs]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    print(f"order {order:.2f}, errors", *(f"{e:.1e}" for e in errors), "steps", *steps)
    assert order > 4.2, (order, errors, steps)


def test_order_of_convergence_in_space():
    way = dict(time=TIME, rtol=1e-6, contents="kinetic", **COLLAPSE)
    fine = simulate(GEL, cells=1024, **way)
    errors = np.array([largest(simulate(GEL, cells=c, **way).radius - fine.radius) for c in (64, 128, 256)])
    orders = np.log2(errors[:-1] / errors[1:])
    print("orders", *(f"{o:.2f}" for o in orders), "errors", *(f"{e / 150e-6:.1e}" for e in errors))
    assert np.all(orders > 1.8), (orders, errors)


def test_default_accuracy():
    """As good as that of equilibrium contents, whose steps are shorter."""
    materials, where = draws(10, 3)
    way = dict(time=TIME, contents="kinetic", **where)
    fine = simulate_many(materials, cells=512, rtol=1e-6, **way)
    runs = simulate_many(materials, **way)
    errors = [largest(a.radius - b.radius) for a, b in zip(runs, fine, strict=True)] / where["max_radius"]
    within(3e-4, median=np.median(errors))
    within(2e-3, largest=np.max(errors))


@pytest.mark.parametrize("accommodation", [1e-3, 0.07, 10.0])
def test_equilibrium_stays_put(accommodation):
    way = dict(contents="kinetic", accommodation=accommodation, confinement_inertia=0.2)
    run = simulate(GEL, max_radius=10e-6, stretch=1.0, time=TIME, fields=True, **way)
    vapour = run.contents.vapour
    within(2e-10, motion=largest(run.radius / 10e-6 - 1), vapour=largest(vapour / vapour[0, 0] - 1))


def test_a_bubble_torn_open_faster_than_it_evaporates():
    """Where equilibrium contents end, because the gas at the wall is gone: the pressure falls below saturation."""
    way = dict(stretch=1.0, max_radius=2e-6, driving=Pulse(-10e6, 2e5, 10e-6), time=TIME)
    run = simulate(GEL, contents="kinetic", **way)
    assert run.radius.max() > 200 * 2e-6
    assert run.pressure.min() < 0.5 * WATER.vapour_pressure


# --- walls, and vapour above saturation


@pytest.mark.parametrize("inertia", [0.3, -0.2])
def test_energy_with_walls(inertia):
    """The liquid's kinetic energy is 2 pi rho R^3 U^2 (1 + beta R/R_max); balance to 1e-7 through three collapses."""
    gel = NeoHookeanKelvinVoigt(2e4, 0.05)
    run = dense(gel, WATER, 200e-6, 4.0, 100e-6, 20_001, polytropic=1.4, rtol=1e-10, confinement_inertia=inertia)
    r, u = run.radius / 200e-6, run.velocity / WATER.velocity_scale
    loss = cumulative_simpson(4 * 0.05 * run.radius * run.velocity**2, x=run.time, initial=0)
    energy = r**3 * u**2 / 2 * (1 + inertia * r) + stored(run.radius, gel, WATER, 4.0, 1.4)
    balance = energy + loss / (WATER.pressure * 200e-6**3)
    assert np.sum((u[1:] > 0) & (u[:-1] <= 0)) >= 3
    within(1e-7, drift=largest(balance / energy[0] - 1))


def test_walls_delay_the_collapse():
    """To first order in beta an empty cavity collapses 1 + 0.41 beta times as late; one wall is beta = R_max/2d."""
    t = np.linspace(0.9, 1.0, 20_001)

    def collapse(**way):
        way |= dict(medium=replace(DRY, surface_tension=0.0), polytropic=1.4, motion="rayleigh-plesset")
        times = t * WATER.time_scale(2e-4)
        return t[np.argmin(simulate(IDEAL, max_radius=2e-4, stretch=60.0, time=times, **way).radius)]

    within(0.02, off=abs((collapse(confinement_inertia=0.05) / collapse() - 1) / 0.05 - 0.41))
    assert collapse(wall_distance=2e-3) == collapse(confinement_inertia=0.05)


def test_vapour_above_saturation_is_extra_gas_that_condenses():
    """It adds its pressure at the start; what lets it out fast ends as if it had not been."""
    way = dict(time=np.linspace(0, 2e-3, 21), max_radius=60e-6, stretch=3.0, rtol=1e-7)
    gel = NeoHookeanKelvinVoigt(2e4, 0.5)
    for contents in forward.CONTENTS:
        plain, rich = (simulate(gel, contents=contents, vapour_excess=e, **way) for e in (0.0, 2e3))
        assert rich.pressure[0] - plain.pressure[0] == pytest.approx(2e3)
        within(1e-7, rest=abs(rich.radius[-1] / plain.radius[-1] - 1))
        within(1e-11, gas=abs(rich.stats["gas_drift"]))


def test_sound_along_a_tube_takes_its_work():
    """Without viscosity, heat and sound elsewhere the liquid's energy is the work of the pressures."""
    time = np.linspace(0, 6e-5, 80001)
    way = dict(max_radius=2e-4, stretch=5.0, motion="rayleigh-plesset", polytropic=1.4, rtol=1e-9)
    run = simulate(Newtonian(0.0), time=time, confinement_damping=0.5, **way)
    R, U, p = run.radius / 2e-4, run.velocity / WATER.velocity_scale, run.pressure / WATER.pressure
    surface = 2 * WATER.surface_tension / (WATER.pressure * 2e-4 * R)
    power = (p - 1 - surface - 0.5 * R**2 * U) * R**2 * U
    work = cumulative_simpson(power, x=time / WATER.time_scale(2e-4), initial=0.0)
    within(1e-5, gap=largest(0.5 * R**3 * U**2 - work))
    coarse, fine = (simulate(GEL, time=TIME, confinement_damping=0.5, precise=p, **COLLAPSE) for p in (False, True))
    within(1e-3, error=largest(coarse.radius - fine.radius) / 150e-6)


def test_sound_along_a_tube_lengthens_the_fall_as_viscosity_near_the_largest_radius():
    """4/Re = zeta: the same start of the fall, to the order at which they differ."""
    zeta, way = 0.2, dict(max_radius=150e-6, stretch=8.0, time=np.linspace(0, 4e-6, 9))
    viscosity = zeta * 150e-6 * WATER.pressure / WATER.velocity_scale / 4
    plain, tube, viscous = (
        simulate(Newtonian(v), confinement_damping=z, **way).radius / 150e-6
        for v, z in ((0.0, 0.0), (0.0, zeta), (viscosity, 0.0))
    )
    assert tube - plain == pytest.approx(viscous - plain, rel=0.15, abs=1e-6)
    assert largest(tube - plain) > 1e-4


# --- damage


@pytest.mark.parametrize("by", KINDS)
def test_damage_that_changes_nothing(by):
    way = dict(time=TIME, **COLLAPSE)
    plain, same = (simulate(GEL, rtol=1e-8, damage=d, **way) for d in (None, Damage(1.0, 1.0, by)))
    within(1e-7, gap=largest(plain.radius - same.radius) / 150e-6)


@pytest.mark.parametrize("contents", forward.CONTENTS)
def test_damage_begins_with_the_rebound_and_decides_the_rest(contents):
    gel, damage = NeoHookeanKelvinVoigt(5e4, 0.05), Damage(0.3, 2.0)
    way = dict(time=np.linspace(0, 60e-6, 601), contents=contents, **COLLAPSE)
    plain, hurt = (simulate(gel, damage=d, rtol=1e-6, **way) for d in (None, damage))
    low = int(np.flatnonzero(plain.velocity > 0)[0])
    within(1e-5, before=largest(plain.radius[:low] - hurt.radius[:low]) / 150e-6)
    assert hurt.radius[low + 20] > plain.radius[low + 20]
    stress = 0.3 * gel.elastic.stress(hurt.radius / (2 * hurt.equilibrium_radius))
    stress += gel.viscous.stress(hurt.strain_rate)
    assert hurt.stress[low + 2 :] == pytest.approx(stress[low + 2 :], rel=1e-6)
    coarse = simulate(gel, damage=damage, **way)  # the moment of damage is found, whatever the steps
    within(1e-3, error=largest(coarse.radius - hurt.radius) / 150e-6)
    n = dimensionless(gel, WATER, 150e-6, 5.0)
    late = simulate(gel, damage=damage, max_radius=150e-6, stretch=5.0, time=[5e-3], contents=contents)

    def excess(x):
        solid = 0.3 * float(gel.elastic.stress(x * 5.0 / 2.0)) / WATER.pressure
        return (n.pressure - n.pv) * x**-3 + n.pv - 1 / (n.We * x) - 1 + solid

    within(1e-4, rest=abs(late.radius[0] / 150e-6 / brentq(excess, 0.05, 1) - 1))


def stress_by_strain(gel, run, smallest):
    """S of damage by strain, factors 0.4 and 2, from the smallest R/R(0) so far (n,)."""
    e = -np.log10(smallest)
    stress = 0.4**e * gel.elastic.stress(run.radius / (2**e * run.equilibrium_radius))
    return stress + (gel.viscous.stress(run.strain_rate) if gel.viscous else 0.0)


def test_damage_by_strain_follows_the_smallest_radius():
    """In the first collapse, after it, and where a pulse presses the bubble below what it has been."""
    gel, damage = NeoHookeanKelvinVoigt(5e4, 0.05), Damage(0.4, 2.0, "strain")
    press = Pulse(1e7, 2e5, 38e-6)
    way = dict(time=np.linspace(0, 42e-6, 42001), rtol=1e-7, polytropic=1.4, max_radius=150e-6, stretch=3.0)
    for driving in (None, press):
        run = simulate(gel, damage=damage, driving=driving, **way)
        smallest = np.minimum.accumulate(run.radius / 150e-6)
        expected = stress_by_strain(gel, run, smallest)
        within(1e-5, gap=np.max(np.abs(run.stress - expected) / (1e5 + np.abs(expected))))
        early = smallest[20_000]
        assert (smallest[-1] < early) == (driving is not None)
    coarse = simulate(gel, damage=damage, time=TIME, **COLLAPSE)
    fine = simulate(gel, damage=damage, time=TIME, precise=True, **COLLAPSE)
    within(2e-3, error=largest(coarse.radius - fine.radius) / 150e-6)


def test_damage_by_strain_changes_the_energy_once():
    """Without viscosity, heat and sound: a softer gel holds the bubble back less, and then nothing is lost or won."""
    way = dict(max_radius=150e-6, stretch=4.0, motion="rayleigh-plesset", polytropic=1.4, rtol=1e-9)
    run = simulate(NeoHookean(3e4), damage=Damage(0.4, 2.0, "strain"), time=np.linspace(0, 1e-4, 20001), **way)
    r = run.radius / 150e-6
    tops = r[1:-1][(r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:])]
    assert len(tops) >= 3
    assert tops[0] > 1.05
    within(1e-6, changed=np.ptp(tops))


def test_memory_does_not_feel_damage_before_the_bubble_is_largest():
    gel = Zener(3e4, 0.05, 3e-6)
    plain, hurt = (simulate(gel, damage=d, time=[0.0], **COLLAPSE) for d in (None, Damage(0.3, 2.0, "strain")))
    assert plain.stress[0] == hurt.stress[0]


# --- what cannot be


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(contents="frozen"), "physics.contents"),
        (dict(contents="kinetic", accommodation=0.0), "physics.accommodation"),
        (dict(contents="kinetic", accommodation=11.0), "physics.accommodation"),
        (dict(contents="kinetic", accommodation=np.nan), "physics.accommodation"),
        (dict(contents="kinetic", polytropic=1.4), "physics.contents_twice"),
        (dict(confinement_inertia=-1.0), "physics.confinement_inertia"),
        (dict(wall_distance=100e-6), "physics.wall_too_near"),
        (dict(wall_distance=1e-3, confinement_inertia=0.1), "physics.two_walls"),
        (dict(vapour_excess=-1.0), "physics.vapour_excess"),
        (dict(confinement_damping=-0.1), "physics.confinement_damping"),
        (dict(damage=Damage(0.5), material=Newtonian(0.1)), "physics.damage_without_elasticity"),
    ],
    ids=str,
)
def test_bad_input(way, code):
    with pytest.raises(InputError) as raised:
        simulate(way.pop("material", GEL), time=TIME, **COLLAPSE, **way)
    assert raised.value.code == code


@pytest.mark.parametrize(
    "numbers", [(-0.1,), (1.1,), (0.5, 0.9), (0.5, np.nan), (0.5, 2.0, "age"), (0.0, 2.0, "strain")]
)
def test_impossible_damage(numbers):
    with pytest.raises(InputError):
        Damage(*numbers)
