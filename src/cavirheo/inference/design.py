"""What a recording that a rig could make would tell of the material, before the shot is taken.

The emulator films a bubble in each of the materials that are drawn, as the rig would. What a recording tells is its
information at the truth, with the window, prior, likelihood and discrepancy of `infer` (docs/how-to/design.md).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import LN10, NORMAL_90, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, require
from cavirheo.inference.answer import ResidualSource
from cavirheo.inference.assumptions import FREE, Family, Options
from cavirheo.inference.emulator import emulator, unknown, untrained
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.sample import DIFFERENCE, expand
from cavirheo.parallel import run_jobs
from cavirheo.physics.bubble import REAL, Bubble
from cavirheo.physics.media import WATER, Medium
from cavirheo.prior import INSIDE

RECORDED_GROWTH = 0.8  # t_c before R_max at which a recording begins
MOST_SHOTS = 10_000
POINTS = 2001  # of a parameter, over which its density is integrated


@dataclass(frozen=True)
class Setting:
    """The settings of a shot. max_radius: m, the intended R_max. frame_rate: 1/s. noise: m, standard deviation of the
    radius of a frame. frames: their number."""

    max_radius: float
    frame_rate: float
    noise: float
    frames: int = 128


class Film(NamedTuple):
    """A recording, and what is true of it: parameters by natural name, SI."""

    curve: RadiusCurve
    truth: dict[str, float]


class Expectation(NamedTuple):
    """What one shot would tell, for one draw of what is known. information: (l, l) of the likelihood on log10 of the
    law's parameters, at the truth. half_width: (l,) decades, half of the 90 % interval that the shot alone gives."""

    information: Floats
    half_width: Floats


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of the material of a shot: law (draws, l) log10 of the parameters of `family`, stretch (draws,), medium and
    bubble. The errors of the camera depend on the seed and are the same at all settings."""

    family: Family
    law: Floats
    stretch: Floats
    medium: Medium = WATER
    bubble: Bubble = REAL
    seed: int = 0

    def experiment(self, curve: RadiusCurve) -> Experiment:
        """A recording as `infer` takes it. Raises InputError: it cannot be read."""
        return Experiment(curve, self.family, self.medium, Options(free=tuple(FREE), bubble=self.bubble))

    def films(self, setting: Setting) -> list[Film | None]:
        """The recording of each draw: clock, scale, and free parameters of the bubble are drawn from the prior of
        `infer`. None for a bubble that cannot be. Raises InputError: the emulator does not know them."""
        usual = self.family.material(np.mean(self.law, axis=0))
        top = setting.max_radius
        why = unknown(usual, self.bubble, top) or untrained(self.bubble, self.medium, top)
        require(not why, f"design needs bubbles that the emulator knows: {why}", "design.unknown")
        rng, k = np.random.default_rng(self.seed), len(self.law)
        begin = RECORDED_GROWTH * self.medium.time_scale(top)
        time = np.arange(setting.frames) / setting.frame_rate - begin
        meta = {"name": "designed", "frame_rate_hz": setting.frame_rate}
        frames = RadiusCurve(time, np.full(len(time), top), meta=meta, maximum=(0.0, top))
        try:
            stage = self.experiment(frames)
        except InputError as error:
            if error.code != "curve.window":
                raise
            return [None] * k  # it ends at R_max
        prior = replace(stage.prior(), zero=np.array(0.0), infinite=np.array(0.0))
        x = prior.to_x(rng.standard_normal((k, len(prior.names))))
        x[:, : stage.law_size], x[:, prior.names.index("stretch")] = self.law, np.log10(self.stretch)
        x[:, prior.names.index("max_radius_factor")] = 0.0
        noise = setting.noise * rng.standard_normal((k, setting.frames))
        radius = top * stage.emulated(x, emulator(), times=time) + noise
        films: list[Film | None] = [None] * k
        for i in np.flatnonzero(np.isfinite(radius).all(axis=1)):
            curve = RadiusCurve(time, np.maximum(radius[i], 1e-3 * top), meta=meta)
            films[i] = Film(curve, stage.all_values(x[i]))
        return films

    def expectation(self, setting: Setting, film: Film | None) -> Expectation | None:
        """`Expectation` of a recording; None if it cannot be read: it ends before the collapse, say."""
        if film is None:
            return None
        with suppress(InputError, SolverError, np.linalg.LinAlgError):
            shot = self.experiment(film.curve)
            origin = film.truth["time_origin"] - film.curve.time_of_max
            factor = setting.max_radius / film.curve.max_radius
            x = shot.from_best(film.truth | {"time_origin": origin, "max_radius_factor": factor})
            relative = _information(shot, x)
            half_width = _half_widths(relative, x[: shot.law_size], shot.bounds[: shot.law_size])
            return Expectation(LN10**2 * relative, half_width)
        return None

    def expectations(
        self, settings: Sequence[Setting], done: Callable[[], None] | None = None
    ) -> list[list[Expectation | None]]:
        """The `Expectation` of each draw at each setting. done: called after each of them."""
        jobs = [(setting, film) for setting in settings for film in self.films(setting)]
        found = run_jobs(lambda job: self.expectation(*job), jobs, None, (lambda *_: done()) if done else None)
        count = len(self.law)
        return [found[i : i + count] for i in range(0, len(jobs), count)]


def _information(shot: Experiment, x: Floats) -> Floats:
    """Information (l, l) of the frames on the values of the law's parameters over those of the truth x (d,): the
    Gauss-Newton curvature there, less what the other parameters take up under their prior. Walls and vapour count by
    their value, with the scale of its prior as deviation: the slope of its root hangs on how far away the walls are."""
    target, law = ResidualSource(shot), shot.law_size
    state = target.state(x)
    u = state.to_u(x[None], INSIDE)
    of_walls = state.columns >= len(x) - len(shot.walls)  # they are the last in x
    walls = state.columns[of_walls]

    def residuals(places: Floats) -> Floats:
        at = state.to_x(places)
        at[:, walls] = np.sqrt(np.maximum(x[walls] ** 2 + (places - u)[:, of_walls], 0.0))
        return target.measured - shot.emulated(at, emulator())

    _, (curvature,) = expand(residuals, shot.noise(discrepancy=True), u, residuals(u))
    moved = state.to_x(u + DIFFERENCE * np.eye(u.shape[1])) - state.to_x(u)
    slopes = LN10 * np.diag(moved[:law, :law]) / DIFFERENCE
    own, mixed, others = curvature[:law, :law] - np.eye(law), curvature[:law, law:], curvature[law:, law:]
    return np.asarray((own - mixed @ np.linalg.solve(others, mixed.T)) / np.outer(slopes, slopes))


def _half_widths(information: Floats, known: Floats, bounds: Floats) -> Floats:
    """(l,) decades, half of the 90 % interval of each parameter in its range (l, 2), flat in log10, from the
    information (l, l) on its value over that of the truth `known` (l,), log10. The others may be off by about the
    truth."""
    widths = []
    for i, (low, high) in enumerate(bounds):
        others = np.arange(len(known)) != i
        rest = information[np.ix_(others, others)] + np.eye(len(known) - 1)
        own = information[i, i] - information[i, others] @ np.linalg.solve(rest, information[others, i])
        places = np.linspace(low, high, POINTS)
        mass = np.cumsum(np.exp(-0.5 * own * (10.0 ** (places - known[i]) - 1.0) ** 2))
        ends = np.interp([0.05, 0.95], mass / mass[-1], places)
        widths.append(0.5 * (ends[1] - ends[0]))
    return np.array(widths)


def shots_wanted(expected: Sequence[Expectation | None], covariance: Floats, scatter: Floats, half_width: float) -> int:
    """Number of shots that bring each parameter's 90 % interval to `half_width` decades about the median, in the median
    over the draws; more than MOST_SHOTS if so many do not. expected: of a shot in each draw; one that cannot be read
    tells nothing. covariance: (l, l) of what is known of the material. scatter: (l, l) that of its shots, decades^2."""
    before, one = np.linalg.inv(covariance), np.eye(len(covariance))
    read = [shot.information for shot in expected if shot is not None]
    share = len(read) / len(expected)

    def count(information: Floats) -> int:
        def enough(shots: int) -> bool:
            left = np.linalg.inv(before + shots * of_material)
            return bool(np.max(NORMAL_90 * np.sqrt(np.diag(left))) <= half_width)

        of_material = share * np.linalg.solve(one + information @ scatter, information)
        return bisect_left(range(MOST_SHOTS + 1), True, key=enough)

    return sorted(map(count, read))[len(read) // 2] if read else MOST_SHOTS + 1
