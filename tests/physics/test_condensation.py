"""Condensation at a finite rate, inertia of walls, vapour above saturation, damage: their limits, balances and orders.

`pytest -s` shows every measured number beside its limit. The limits are two to ten times what was measured.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.optimize import brentq
from test_limits import COLLAPSE, DRY, GEL, IDEAL, KINETIC, TIME, dense, draws, largest, within

from cavirheo import Bubble, NeoHookeanKelvinVoigt, Newtonian, simulate
from cavirheo.physics import simulate as forward
from cavirheo.physics.accuracy import DEFAULT, PRECISE, Accuracy
from cavirheo.physics.bubble import ACCOMMODATION, CONTENTS, FIELD, Damage
from cavirheo.physics.driving import Pulse
from cavirheo.physics.elastic import NeoHookean
from cavirheo.physics.materials import Zener
from cavirheo.physics.media import WATER
from cavirheo.physics.scales import dimensionless
from validation.field_standard import neo_hookean, newtonian
from validation.field_standard import solve as solve_by_field_standard


def test_infinitely_fast_condensation_is_equilibrium(monkeypatch):
    """With constant D the gap falls as 1/rate (measured 5e-7 at 1e6, 5e-9 at 1e8)."""
    materials, where = draws(4, 1)
    shots = [
        (gel, dict(stretch=stretch, max_radius=radius, time=TIME, accuracy=Accuracy(relative_error=1e-7)))
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


@pytest.mark.parametrize("bubble", [FIELD, KINETIC, Bubble("kinetic", 0.01, confinement_inertia=0.3)], ids=str)
def test_second_implementation(bubble):
    """Mass fractions on finite differences, D(T, p) with its gradient, and the root of the balance at the wall."""
    numbers = dimensionless(GEL, WATER, 150e-6, 5.0, bubble=bubble)
    t_star = np.linspace(0, 1.1, 40)  # through the collapse to 0.08-0.12 R_max
    y = np.tanh(4.0 * np.linspace(0, 1, 100 if bubble == FIELD else 80)) / np.tanh(4.0)
    t_c = WATER.time_scale(150e-6)
    iCa, iRe = GEL.shear_modulus / WATER.pressure, GEL.viscosity / (WATER.pressure * t_c)
    further = {} if bubble == FIELD else dict(rate=numbers.rate, inertia=numbers.inertia, method="Radau")
    theirs = solve_by_field_standard(numbers, y, t_star, 1e-6, neo_hookean(iCa), newtonian(iRe), **further)
    ours = simulate(GEL, time=t_star * t_c, bubble=bubble, **COLLAPSE).radius / 150e-6
    within(3e-4, gap=largest(ours - theirs))


def test_vapour_and_energy_balance():
    """What leaves through the wall is the law of Hertz and Knudsen, and carries its enthalpy; heat is conducted there.

    From the fields alone: moles and pV against the time integrals of what passes the wall.
    """
    n = dimensionless(GEL, WATER, 150e-6, 5.0, bubble=KINETIC)
    run = dense(GEL, WATER, 150e-6, 5.0, 60e-6, 6001, bubble=KINETIC, fields=True, accuracy=PRECISE)
    grid = forward.wall_clustered(PRECISE.cells, forward.WALL_CELL)
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


def test_walls_delay_the_collapse():
    """To first order in beta an empty cavity collapses 1 + 0.41 beta times as late; one wall is beta = R_max/2d."""
    t = np.linspace(0.9, 1.0, 20_001)

    def collapse(**walls):
        bubble = Bubble(motion="rayleigh-plesset", exponent=1.4, **walls)
        way = dict(medium=replace(DRY, surface_tension=0.0), bubble=bubble)
        times = t * WATER.time_scale(2e-4)
        return t[np.argmin(simulate(IDEAL, max_radius=2e-4, stretch=60.0, time=times, **way).radius)]

    within(0.02, off=abs((collapse(confinement_inertia=0.05) / collapse() - 1) / 0.05 - 0.41))
    assert collapse(wall_distance=2e-3) == collapse(confinement_inertia=0.05)


def test_vapour_above_saturation_is_extra_gas_that_condenses():
    """It adds its pressure at the start; what lets it out fast ends as if it had not been."""
    way = dict(time=np.linspace(0, 2e-3, 21), max_radius=60e-6, stretch=3.0, accuracy=Accuracy(relative_error=1e-7))
    gel = NeoHookeanKelvinVoigt(2e4, 0.5)
    for bubble in (FIELD, KINETIC):
        plain, rich = (simulate(gel, bubble=replace(bubble, vapour_excess=e), **way) for e in (0.0, 2e3))
        assert rich.pressure[0] - plain.pressure[0] == pytest.approx(2e3)
        within(1e-7, rest=abs(rich.radius[-1] / plain.radius[-1] - 1))
        within(1e-11, gas=abs(rich.stats["gas_drift"]))


def test_sound_along_a_tube_takes_its_work():
    """Without viscosity, heat and sound elsewhere the liquid's energy is the work of the pressures."""
    time = np.linspace(0, 6e-5, 80001)
    bubble = Bubble(confinement_damping=0.5, motion="rayleigh-plesset", exponent=1.4)
    way = dict(max_radius=2e-4, stretch=5.0, accuracy=Accuracy(relative_error=1e-9))
    run = simulate(Newtonian(0.0), time=time, bubble=bubble, **way)
    R, U, p = run.radius / 2e-4, run.velocity / WATER.velocity_scale, run.pressure / WATER.pressure
    surface = 2 * WATER.surface_tension / (WATER.pressure * 2e-4 * R)
    power = (p - 1 - surface - 0.5 * R**2 * U) * R**2 * U
    work = cumulative_simpson(power, x=time / WATER.time_scale(2e-4), initial=0.0)
    within(1e-5, gap=largest(0.5 * R**3 * U**2 - work))
    damped = Bubble(confinement_damping=0.5)
    coarse, fine = (simulate(GEL, time=TIME, bubble=damped, accuracy=a, **COLLAPSE) for a in (DEFAULT, PRECISE))
    within(1e-3, error=largest(coarse.radius - fine.radius) / 150e-6)


@pytest.mark.parametrize("contents", CONTENTS)
def test_damage_begins_with_the_rebound_and_decides_the_rest(contents):
    gel, whole = NeoHookeanKelvinVoigt(5e4, 0.05), Bubble(contents, ACCOMMODATION)
    torn = replace(whole, damage=Damage(0.3, 2.0))
    way = dict(time=np.linspace(0, 60e-6, 601), **COLLAPSE)
    plain, hurt = (simulate(gel, bubble=b, accuracy=Accuracy(relative_error=1e-6), **way) for b in (whole, torn))
    low = int(np.flatnonzero(plain.velocity > 0)[0])
    within(1e-5, before=largest(plain.radius[:low] - hurt.radius[:low]) / 150e-6)
    assert hurt.radius[low + 20] > plain.radius[low + 20]
    stress = 0.3 * gel.elastic.stress(hurt.radius / (2 * hurt.equilibrium_radius))
    stress += gel.viscous.stress(hurt.strain_rate)
    assert hurt.stress[low + 2 :] == pytest.approx(stress[low + 2 :], rel=1e-6)
    coarse = simulate(gel, bubble=torn, **way)  # the moment of damage is found, whatever the steps
    within(1e-3, error=largest(coarse.radius - hurt.radius) / 150e-6)
    n = dimensionless(gel, WATER, 150e-6, 5.0)
    late = simulate(gel, bubble=torn, max_radius=150e-6, stretch=5.0, time=[5e-3])

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
    gel, torn = NeoHookeanKelvinVoigt(5e4, 0.05), Bubble(damage=Damage(0.4, 2.0, "strain"))
    press = Pulse(1e7, 2e5, 38e-6)
    way = dict(time=np.linspace(0, 42e-6, 42001), max_radius=150e-6, stretch=3.0)
    for driving in (None, press):
        run = simulate(gel, bubble=replace(torn, exponent=1.4), driving=driving, **way)
        smallest = np.minimum.accumulate(run.radius / 150e-6)
        expected = stress_by_strain(gel, run, smallest)
        within(1e-5, gap=np.max(np.abs(run.stress - expected) / (1e5 + np.abs(expected))))
        early = smallest[20_000]
        assert (smallest[-1] < early) == (driving is not None)
    coarse = simulate(gel, bubble=torn, time=TIME, **COLLAPSE)
    fine = simulate(gel, bubble=torn, time=TIME, accuracy=PRECISE, **COLLAPSE)
    within(2e-3, error=largest(coarse.radius - fine.radius) / 150e-6)


def test_damage_by_strain_changes_the_energy_once():
    """Without viscosity, heat and sound: a softer gel holds the bubble back less, and then nothing is lost or won."""
    bubble = Bubble(damage=Damage(0.4, 2.0, "strain"), motion="rayleigh-plesset", exponent=1.4)
    way = dict(max_radius=150e-6, stretch=4.0, accuracy=Accuracy(relative_error=1e-9))
    run = simulate(NeoHookean(3e4), bubble=bubble, time=np.linspace(0, 1e-4, 20001), **way)
    r = run.radius / 150e-6
    tops = r[1:-1][(r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:])]
    assert len(tops) >= 3
    assert tops[0] > 1.05
    within(1e-6, changed=np.ptp(tops))


def test_memory_does_not_feel_damage_before_the_bubble_is_largest():
    torn = Bubble(damage=Damage(0.3, 2.0, "strain"))
    plain, hurt = (simulate(Zener(3e4, 0.05, 3e-6), bubble=b, time=[0.0], **COLLAPSE) for b in (FIELD, torn))
    assert plain.stress[0] == hurt.stress[0]
