"""Pressure far from the bubble, above the ambient one, over time: what drives it besides the ambient pressure.

A driving is for the solver one more table (physics/table.py), of pressure over time; time 0 is the simulation's start.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, pi
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.parameters import FINITE, POSITIVE, check, domain
from cavirheo.physics.table import continued, hermite


class Driving(Protocol):
    """Any function of time in s, given in Pa above the ambient pressure."""

    def table(self) -> Floats: ...


@dataclass(frozen=True)
class Pulse:
    """One cycle of focused ultrasound, p_A {[1 + cos(2 pi f (t - centre))]/2}^n within half a period of its centre.
    Gaudron, Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7.

    Attributes:
        amplitude: p_A, Pa; negative for tension.
        frequency: f, Hz.
        centre: s after the start.
        exponent: n.
    """

    amplitude: float = field(metadata=FINITE)
    frequency: float = field(metadata=POSITIVE)
    centre: float = field(metadata=FINITE)
    exponent: float = field(default=3.7, metadata=domain("at least 1", lambda x: 1 <= x < inf))

    def __post_init__(self) -> None:
        check(self)

    def pressure(self, time: ArrayLike) -> Floats:
        """Pa above ambient at `time` in s (any shape)."""
        phase = 2 * pi * self.frequency * (np.asarray(time, float) - self.centre)
        return np.where(np.abs(phase) < pi, self.amplitude * ((1 + np.cos(phase)) / 2) ** self.exponent, 0.0)

    def table(self) -> Floats:
        n, omega = self.exponent, 2 * pi * self.frequency
        x = np.linspace(-pi, pi, 129)
        base, sine = (1 + np.cos(x)) / 2, np.sin(x)
        base[[0, -1]] = sine[[0, -1]] = 0.0
        value, below = base**n, base ** (n - 1)
        slope = -n / 2 * sine * below
        curvature = (n * (n - 1) * (1 - base) - n / 2 * np.cos(x)) * below
        rows = self.amplitude * np.stack([value, slope * omega, curvature * omega**2])
        return _held(hermite(self.centre + x / omega, *rows))


@dataclass(frozen=True, eq=False)
class Trace:
    """A measured or computed pressure above ambient: monotone cubics (PCHIP) between its samples, held at both ends.

    Attributes:
        time: (n,) s after the start, ascending.
        pressure: (n,) Pa.

    Raises:
        InputError: fewer than two samples, not finite, not ascending, or not as many times as pressures.
    """

    time: Floats
    pressure: Floats

    def __post_init__(self) -> None:
        for name in ("time", "pressure"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        fits = self.time.ndim == 1 and self.time.size > 1 and self.time.shape == self.pressure.shape
        shapes = f"got shapes {self.time.shape} and {self.pressure.shape}"
        why = f"a pressure trace needs as many times as pressures, at least two, {shapes}"
        require(fits, why, "physics.trace_shape")
        ascends = np.isfinite([self.time, self.pressure]).all() and np.all(np.diff(self.time) > 0)
        why = "the times of a pressure trace must be finite and ascend, and its pressures be finite"
        require(bool(ascends), why, "physics.trace_values")

    def table(self) -> Floats:
        from scipy.interpolate import PchipInterpolator  # a third of a second that other uses need not wait for

        rows = np.zeros((self.time.size, 7))
        rows[:, 0], rows[:, 1] = self.time, self.pressure
        rows[:-1, 1:5] = PchipInterpolator(self.time, self.pressure).c[::-1].T
        return _held(rows)


def _held(rows: Floats) -> Floats:
    """The table from rows (n, 7) over ascending times, continued by its first and its last value."""
    before, after = (min(0.0, rows[0, 0]) - 1.0, rows[0, 1], 0.0), (rows[-1, 0], rows[-1, 1], 0.0)
    return continued(rows, before, after)
