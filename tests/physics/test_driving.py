"""The far-field pressure: its tables, its files, and that it drives the bubble."""

from __future__ import annotations

import numpy as np
import pytest

from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.driving import Pulse, Trace
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.simulate import simulate
from cavirheo.physics.table import read

PULSE = Pulse(-2e6, 1e6, 3e-6)


@pytest.mark.parametrize("pulse", [PULSE, Pulse(5e5, 2.5e5, 0.5e-6, 1.0), Pulse(-1e6, 1e6, -0.2e-6, 2.0)], ids=str)
def test_the_table_of_a_pulse(pulse):
    """Value to 1e-8 of the amplitude; slope and curvature are its derivatives; nothing outside half a period."""
    t = np.linspace(0, 12e-6, 4801)
    value, slope, curvature = read(pulse.table(), t)
    assert np.max(np.abs(value - pulse.pressure(t))) < 1e-8 * abs(pulse.amplitude)
    h = 1e-11
    scale = abs(pulse.amplitude) * 2 * np.pi * pulse.frequency
    edge = np.abs(np.abs(t - pulse.centre) - 0.5 / pulse.frequency) < 1e-9  # where exponent 1 has its kink in slope
    rise = (read(pulse.table(), t + h)[0] - read(pulse.table(), np.maximum(t - h, 0))[0]) / (h + np.minimum(t, h))
    assert np.max(np.abs(slope - rise)[~edge]) < 1e-4 * scale
    bend = (read(pulse.table(), t + h)[1] - read(pulse.table(), np.maximum(t - h, 0))[1]) / (h + np.minimum(t, h))
    assert np.max(np.abs(curvature - bend)[~edge]) < 1e-3 * scale * 2 * np.pi * pulse.frequency
    assert pulse.pressure(pulse.centre) == pulse.amplitude
    assert read(pulse.table(), 1.0)[0] == 0


def test_a_trace_invents_nothing_and_is_held_at_its_ends():
    t, p = np.array([1e-6, 2e-6, 3e-6, 5e-6]), np.array([0.0, 1e5, 1e5, -4e5])
    table = Trace(t, p).table()
    assert read(table, t)[0] == pytest.approx(p)
    fine = read(table, np.linspace(0, 8e-6, 2001))[0]
    assert (fine.min(), fine.max()) == (pytest.approx(-4e5), pytest.approx(1e5))
    assert read(table, [0.0, 1.0])[0] == pytest.approx([0.0, -4e5])


def test_tension_makes_a_nucleus_grow():
    """A 1 um nucleus at equilibrium: nothing before the pulse, explosive growth after it, collapse later."""
    t = np.linspace(0, 20e-6, 401)
    kw = dict(max_radius=1e-6, stretch=1.0, time=t)
    run = simulate(NeoHookeanKelvinVoigt(1e3, 1e-3), driving=PULSE, **kw)
    assert np.max(np.abs(run.radius[t < 2.4e-6] / 1e-6 - 1)) < 1e-6
    assert 5e-6 < run.radius.max() < 50e-6
    assert run.radius[-1] < 0.2 * run.radius.max()
    weaker = simulate(NeoHookeanKelvinVoigt(1e3, 1e-3), driving=Pulse(-1e6, 1e6, 3e-6), **kw)
    assert weaker.radius.max() < run.radius.max()


def test_a_held_overpressure_is_a_higher_ambient_pressure():
    """Far-field pressure p_f adds to p_inf: the wall at rest at the start accelerates as 1 + p_f."""
    t = np.linspace(0, 2e-7, 21)
    kw = dict(max_radius=2e-4, stretch=8.0, time=t, accuracy=Accuracy(relative_error=1e-9))
    still = simulate(NeoHookeanKelvinVoigt(1e3, 1e-3), **kw)
    pushed = simulate(NeoHookeanKelvinVoigt(1e3, 1e-3), driving=Trace([0, 1], [101325.0, 101325.0]), **kw)
    force = 1 - still.pressure[0] / 101325 + 8 / 8 * 2 * 0.072 / (2e-4 * 101325) - still.stress[0] / 101325
    assert pushed.velocity[1] / still.velocity[1] == pytest.approx((force + 1) / force, rel=1e-3)
