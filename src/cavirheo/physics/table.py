"""Tables: functions of one number as chains of quintic polynomials, the form in which the solver gets laws.

A row [x, c0 ... c5] of a table holds f(x + t) = c0 + c1 t + ... + c5 t^5 up to the x of the next row; the last row
only ends the range. Each piece has the value and the first two derivatives of the law at both its ends. The solver
reads these three numbers from one polynomial, so its Jacobian is exact. Nodes lie where the law needs them, densely
near a singularity, so a piece is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError

TOLERANCE = 1e-8  # largest error of the derivative within a piece, relative to its largest value there
NARROWEST = 1e-8  # of x: a piece as narrow as this is a kink of the law, or the place where the law ends
INFINITE_SLOPE = 1e16  # a larger slope counts as infinite: in Pa it is six decades above the pressure of any collapse
STEEP_END = 1e14  # slope of the last piece from which on the end of the law is not located more precisely
MOST_PIECES = 20_000  # largest number of pieces
_INTERIOR_NODES = np.polynomial.legendre.Legendre.basis(6).deriv().roots().real  # complex from numpy 2.5 on
_NODES = (np.concatenate([[-1.0], _INTERIOR_NODES, [1.0]]) + 1.0) / 2.0  # Lobatto points of a piece, for its slopes
_WEIGHTS = 1.0 / (42.0 * np.polynomial.legendre.Legendre.basis(6)(2.0 * _NODES - 1.0) ** 2)  # for integrals of slopes
_POWERS = np.arange(7)
_DIFFERENCE = np.linalg.solve(  # (7, 2) weights of the slopes in their derivative at both ends
    np.vander(_NODES, increasing=True).T, np.stack([_POWERS == 1, _POWERS], axis=1).astype(float)
)
MOST_PARTS = 32  # largest number of parts into which a piece is divided at once


def hermite(x: Floats, value: Floats, slope: Floats, curvature: Floats) -> Floats:
    """Table (n, 7) through a function known with two derivatives at the ascending nodes x (n,)."""
    rows = np.zeros((x.size, 7))
    rows[:, 0] = x
    slopes, curvatures = (np.stack([f[:-1], f[1:]], axis=1) for f in (slope, curvature))
    rows[:-1, 1:] = _pieces(np.diff(x), value[:-1], np.diff(value), slopes, curvatures)
    return rows


def _pieces(h: Floats, start: Floats, rise: Floats, slope: Floats, curvature: Floats) -> Floats:
    """Coefficients (n, 6), powers of x from the start of pieces of lengths h; slope, curvature (n, 2) at their ends."""
    v0, v1 = h * slope[:, 0], h * slope[:, 1]
    a0, a1 = h * h * curvature[:, 0], h * h * curvature[:, 1]
    c3 = 10 * rise - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15 * rise + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
    c5 = 6 * rise - 3 * (v0 + v1) - 0.5 * (a0 - a1)
    cube = h * h * h
    return np.stack([start, slope[:, 0], curvature[:, 0] / 2, c3 / cube, c4 / (cube * h), c5 / (cube * h * h)], axis=1)


def tabulate(slope: Callable[[Floats], Floats], nodes: Floats, origin: float) -> Floats:
    """Table of the integral of `slope` (for arrays of any shape) from `origin`, one of the ascending nodes.

    Pieces between the nodes are divided until quintics represent the slope to TOLERANCE. Where the slope is not finite
    the table ends: its range is the domain of the law. Integrals are by Lobatto's quadrature with 7 points per piece;
    the second derivative is that of the polynomial through the slopes at these points. Raises InputError: the slope
    is so rough that MOST_PIECES do not represent it.
    """

    def f(x: Floats) -> Floats:
        with np.errstate(all="ignore"):
            value = np.broadcast_to(np.asarray(slope(x), float), x.shape)
            return np.where(np.abs(value) < INFINITE_SLOPE, value, np.nan)

    a, b = nodes[:-1], nodes[1:]
    rows_done: list[Floats] = []  # rows a, b, rise, c1 ... c5
    while a.size:
        if a.size + sum(map(len, rows_done)) > MOST_PIECES:
            rough = f"the law is too rough: {MOST_PIECES} polynomials between {nodes[0]:g} and {nodes[-1]:g} miss it"
            raise InputError(rough, "physics.rough")
        h = b - a
        t = h * _NODES[:, None]
        x = a + t
        x[-1] = b
        by_place = f(x)  # (7, pieces)
        exact = np.ascontiguousarray(by_place.T)
        rise = h * (exact @ _WEIGHTS)
        pieces = _pieces(h, rise, rise, exact[:, [0, -1]], exact @ _DIFFERENCE / h[:, None])
        c1, c2, c3, c4, c5 = (k * pieces[:, k] for k in range(1, 6))
        error = np.abs(c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))) - by_place).max(axis=0)
        error /= TOLERANCE * np.abs(by_place).max(axis=0) + 1e-300
        narrow = h <= NARROWEST * np.abs(b)
        good = (error <= 1) | (narrow & np.isfinite(error))
        rows_done.append(np.column_stack([a, b, pieces])[good])
        left = ~good & ~narrow & (np.fmin(*np.abs(by_place[[0, -1]])) < STEEP_END)
        # the error falls with the fifth power of h; a piece in which the law ends gets MOST_PARTS
        parts = np.ceil(np.fmax(np.fmin(1.2 * error[left] ** 0.2, MOST_PARTS), 2)).astype(int)
        last = np.cumsum(parts) - 1
        start, length, count, first = (np.repeat(each, parts) for each in (a[left], h[left], parts, last + 1 - parts))
        a, ends = start + length * ((np.arange(len(start)) - first) / count), b[left]
        b = np.roll(a, -1)
        b[last] = ends
    rows = np.concatenate(rows_done)
    rows = rows[np.argsort(rows[:, 0])]
    chains = np.split(rows, np.flatnonzero(rows[1:, 0] != rows[:-1, 1]) + 1)  # chains of adjacent pieces
    joined = [chain for chain in chains if len(chain) and chain[0, 0] <= origin <= chain[-1, 1]]
    table = np.vstack([*joined, np.zeros((1, 8))])
    table[-1, 0] = table[-2, 1] if joined else origin
    rise, up = table[:-1, 2], table[:-1, 0] >= origin
    table[:-1, 2] = np.append(-np.cumsum(rise[~up][::-1])[::-1], np.cumsum(rise[up]) - rise[up])
    return np.delete(table, 1, axis=1)


def look_up(table: Floats, x: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """The function and its first two derivatives at x (any shape); NaN outside the table, as in the solver."""
    x = np.asarray(x, float)
    inside = (x >= table[0, 0]) & (x <= table[-1, 0])
    rows = table[np.clip(np.searchsorted(table[:, 0], x, "right") - 1, 0, max(len(table) - 2, 0))]
    c0, c1, c2, c3, c4, c5 = np.moveaxis(rows[..., 1:], -1, 0)
    t = np.where(inside, x, np.nan) - rows[..., 0]
    return (
        c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5)))),
        c1 + t * (2 * c2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5))),
        2 * c2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5)),
    )


def extend_table(table: Floats, before: tuple[float, ...], after: tuple[float, ...]) -> Floats:
    """The table continued by two straight lines, each given by its (x, value, slope); the second has no end."""
    ends = np.zeros((3, 7))
    ends[0, :3], ends[1, :3], ends[2, 0] = before, after, np.inf
    return np.vstack([ends[:1], table[:-1], ends[1:]])


def scale_table(table: Floats, x: float, f: float) -> Floats:
    """The same function with its argument multiplied by x and its values by f; always a new array."""
    scale = np.array([x] + [f / x**k for k in range(6)])
    return np.ascontiguousarray(table * scale)
