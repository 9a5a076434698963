"""Simulations of an answer with other values of its parameters, and with those of its draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve, as_numbers
from cavirheo.errors import InputError, SolverError, brief, expect, expect_whole, require
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.assumptions import FREE, Family, Options, check_stretch
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.sample import DIFFERENCE
from cavirheo.messages import message_of_error
from cavirheo.parameters import DURATION, PARAMETERS
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Posterior, check_level

DRAWS = 100  # draws of a posterior that are simulated
FRAMES = 10  # of each draw, whose noise is evenly spread, at each time
WIDEST_SCALE = 0.19  # half-width about 1 of a range that contains every inferred radius scale


class PredictedRadius(NamedTuple):
    """Radii (n,) in m: the mean over simulations of the draws of an answer, and the ends of what frames measure."""

    mean: Floats
    low: Floats
    high: Floats


def predict_radius(posterior: Posterior, time: ArrayLike, *, level: float = 0.9, draws: int = DRAWS) -> PredictedRadius:
    """The radius that an answer predicts at any time, for example in frames that were not compared with it.

    If the answer is right, no other prediction has a smaller expected square error than the mean. The ends are those
    of what a frame there would measure: with its noise, and the discrepancy between simulations and frames. After the
    compared frames the discrepancy is that of its prior: earlier frames do not show what the next collapse does.

    Args:
        posterior: the answer, with draws.
        time: (n,) s, on the clock of its curve. Before R_max the bubble is mirrored.
        level: probability that a frame measures a radius between the two ends.
        draws: number of draws to simulate, some milliseconds each.

    Returns: three arrays (n,) in m.

    Raises InputError: an answer without draws or curve, a time that is not finite, a level outside 0 to 1, fewer than
    two draws; SolverError: more than half of the draws cannot be simulated.
    """
    expect(posterior, Posterior, "an answer of infer or fit")
    time = as_numbers("time", time)
    fine = time.ndim == 1 and len(time) > 0 and bool(np.all(np.isfinite(time)))
    require(fine, f"times must be one row of finite numbers, got {brief(time.tolist())}", "curve.time")
    curve, medium = posterior.curve, posterior.medium
    if curve is None or medium is None or len(posterior.theta) < 2:
        lacking = "curve" if curve is None else "interval"
        message = f"a prediction needs an answer with draws and its curve, as infer gives it: this one has no {lacking}"
        raise InputError(message, "predict.draws", posterior.name)
    check_level(level)
    expect_whole(draws, "draws", 2)
    since = time - curve.time_of_max
    DURATION.check("the longest time from R_max", float(np.max(np.abs(since))), "curve.time")
    rng, radii, frames = np.random.default_rng(0), list[Floats](), list[Floats]()
    setup = posterior.material, medium, _compared_end(curve, posterior)
    shots = {bubble: _experiment(curve, bubble, *setup) for bubble in (posterior.bubble, FIELD)}
    noise = shots[posterior.bubble].noise(bool(posterior.provenance.get("discrepancy")))
    end = float(shots[FIELD].time_since_max[-1])  # of the compared frames
    step = DIFFERENCE * shots[FIELD].time_scale
    instants = np.concatenate([since, since - step, since + step])
    chosen = rng.choice(len(posterior.theta), draws, p=posterior.weights)
    for values in zip(*(posterior.draws(name)[chosen].tolist() for name in posterior.parameters), strict=True):
        draw = dict(zip(posterior.parameters, values, strict=True))
        shot = shots[_bubble_of(posterior, draw)]
        x = shot.from_best({**posterior.best, **draw})
        simulated = shot.predict(x, times=instants)
        if simulated is None:
            continue
        radius, before, after = np.split(simulated, 3)
        velocity = (after - before) / (2.0 * step)
        deviation = noise.predicted_deviations(shot.difference(x), velocity, since <= end, rng)
        radii.append(radius * curve.max_radius)
        levels = (np.arange(FRAMES) + (len(radii) - 0.5) / draws) / FRAMES
        frames += [(radius + deviation * number) * curve.max_radius for number in ndtri(levels)]
    if 2 * len(radii) < draws:
        many = f"only {len(radii)} of {draws} draws can be simulated until {1e6 * np.max(time):.4g} us"
        raise SolverError(f"{many}; times are in s, on the clock of the recording")
    tail = 0.5 - 0.5 * level
    low, high = np.quantile(frames, (tail, 1.0 - tail), axis=0)
    return PredictedRadius(np.mean(radii, axis=0), low, high)


def checks_with(curve: RadiusCurve, posterior: Posterior, values: Mapping[str, float], analysis: Analysis) -> Checks:
    """The checks of a simulation of an answer with these parameters (natural name, SI); failed ones say why there is no
    radius."""
    try:
        check_stretch(values.get("stretch"))
        end = _compared_end(curve, posterior) or analysis.experiment(curve).end
        best = {**posterior.best, **values}
        sharp = curve.labelled(exposure_s=None)  # as the answer is drawn
        medium, bubble = analysis.medium_for(curve), _bubble_of(posterior, best)
        shot = _experiment(sharp, bubble, posterior.material, medium, end)
        return shot.checks(shot.from_best(best), "ok", [])
    except (InputError, SolverError) as error:
        return Checks("failed", (message_of_error(error),))


def _bubble_of(posterior: Posterior, values: Mapping[str, float]) -> Bubble:
    """The bubble of the answer; the field's if a real one has no damping, as have the draws of that switch."""
    return FIELD if posterior.bubble == REAL and values.get("confinement_damping") == 0.0 else posterior.bubble


def _compared_end(curve: RadiusCurve, posterior: Posterior) -> float | None:
    """End of the frames that were compared with an answer, s after R_max; None if none were."""
    frames = posterior.checks.compared_time
    return None if frames is None else float(frames[-1] - curve.time_of_max)


def _experiment(curve: RadiusCurve, bubble: Bubble, material: str, medium: Medium, end: float | None) -> Experiment:
    """The experiment of a curve, a model and the compared window, with any inferred clock and scale in its ranges.
    Raises InputError."""
    clock = float(curve.time[-1] - curve.time[0])
    end = end and end * (1.0 + 1e-9)
    options = Options(end=end, free=tuple(FREE), bubble=bubble, clock_bound=clock, scale_bound=WIDEST_SCALE)
    return Experiment(curve, Family(material), medium, options)


def slider(posterior: Posterior, name: str, factor: float = 1.0) -> dict[str, float] | None:
    """Minimum, maximum, step and value of a slider for a parameter, in SI times `factor`; None if the law does not have
    it. The value is that of the answer, else the middle of the usual range. The slider goes from nearly zero to a round
    number about three times as large as it (as that middle, if it is 0); for the stretch from 1.2 to at least 20."""
    if name not in (*Family(posterior.material).parameters, "stretch"):
        return None
    middle = 10.0 ** float(np.mean(PARAMETERS[name].start_range))  # type: ignore[arg-type]
    value = float(f"{posterior.best.get(name, middle) * factor:.4g}")
    if name == "stretch":
        return {"minimum": 1.2, "maximum": max(20.0, value), "step": 0.05, "value": value}
    top = float(f"{3.0 * (value or middle * factor):.1g}")
    low = float(f"{top / 500:.1g}")
    return {"minimum": low, "maximum": top, "step": low, "value": value}
