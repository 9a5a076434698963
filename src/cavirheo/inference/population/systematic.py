"""Errors that all shots of a group share: of the radius scale, the frame rate, the density and the pressure.

R/R_max over t/t_c, t_c = R_max sqrt(rho/p), depends on G/p, mu/(p t_c) and the stretch, and little on anything else. An
error of one of these four changes t/t_c, and so all of them act as one. With s the relative change of a parameter per
relative change of R_max, its relative changes per relative change of each are

    parameter   R_max   frame rate   density   pressure
    G           s       s            s/2       1 - s/2
    mu          s       s - 1        s/2       1 - s/2

Two different errors of the scale are told apart. `radius_scale` of each shot (experiment.py) is what differs from shot
to shot, such as the focus and the fitted outline: it widens the interval of each shot, and averages out over many. The
errors here are one number for all shots, such as the micrometres per pixel: no shot has them, and they do not average
out. So nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from cavirheo.arrays import NORMAL_90, Floats
from cavirheo.errors import require
from cavirheo.physics.collapse import elastic_number

_LN10 = float(np.log(10.0))
_STREAM = 7  # of the random draws of the errors


@dataclass(frozen=True)
class CommonErrors:
    """Relative standard deviations of the errors that all shots of a group share.

    Attributes:
        scale: of the radius (micrometres per pixel).
        rate: of the frame rate.
        density: of the medium.
        pressure: far from the bubble.

    Raises:
        InputError: a number below 0, or above 0.2.
    """

    scale: float = 0.01
    rate: float = 0.001
    density: float = 0.01
    pressure: float = 0.01

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            message = f"the {name} error is a relative standard deviation from 0 to 0.2, got {value!r}"
            require(isinstance(value, int | float) and 0.0 <= value <= 0.2, message, f"option.{name}_error")


def hidden_modulus(errors: CommonErrors, pressure: float, stretch: float) -> float:
    """G, Pa, of a gel that looks like a liquid with a probability of 5 % because of these errors. The first collapse of
    a gel comes sqrt(1 + Be G/p) times earlier than that of a liquid; a relative error e of this ratio, which is that of
    R_max, of the rate, or half of that of density or pressure, moves G by 2 e p/Be."""
    halved = 0.5 * np.hypot(errors.density, errors.pressure)
    ratio = float(np.sqrt(errors.scale**2 + errors.rate**2 + halved**2))
    return NORMAL_90 * 2.0 * ratio * pressure / float(elastic_number(stretch))


def widened_limit(limit: float, errors: CommonErrors, pressure: float, stretch: float) -> float:
    """A 95 % limit of G, Pa, that statistics give, with these errors."""
    return float(np.hypot(limit, hidden_modulus(errors, pressure, stretch)))


def slopes(name: str, over_scale: float) -> dict[str, float]:
    """Relative change of a parameter, by its natural name, per relative change of what `CommonErrors` names, from that
    per relative change of R_max."""
    rate = over_scale if name == "shear_modulus" else over_scale - 1.0
    return {"scale": over_scale, "rate": rate, "density": 0.5 * over_scale, "pressure": 1.0 - 0.5 * over_scale}


def widened(
    interval: tuple[float, float, float], by_error: Mapping[str, float], errors: CommonErrors
) -> tuple[float, float]:
    """Ends of the 90 % interval of one shot, given as (5 %, 50 %, 95 %) without these errors, with them. by_error: as
    `slopes`. In the logarithm the errors are normal, and the sides of the interval as those of normal distributions."""
    low, middle, high = interval
    common = NORMAL_90 * float(np.linalg.norm([by_error[name] * error for name, error in asdict(errors).items()]))
    below, above = np.hypot(np.log([middle / low, high / middle]), common).tolist()
    return middle / float(np.exp(below)), middle * float(np.exp(above))


def shifts(names: Sequence[str], over: Mapping[str, float], errors: CommonErrors, draws: int, seed: int) -> Floats:
    """(draws, d) log10 of the factor by which errors drawn from their priors change each parameter, all by the same
    errors; 0 for a parameter whose slope is not known."""
    rng = np.random.Generator(np.random.Philox(seed).jumped(_STREAM))
    deviations = asdict(errors)
    drawn = rng.standard_normal((draws, len(deviations))) * [*deviations.values()]
    changes = np.zeros((len(deviations), len(names)))
    for k, name in enumerate(names):
        if name in over:
            by_error = slopes(name, over[name])
            changes[:, k] = [by_error[error] for error in deviations]
    return np.asarray(drawn @ changes / _LN10)
