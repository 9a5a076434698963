"""An answer simulated again: with other values of its parameters, and with those of its draws."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import cast

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.assumptions import FREE, Family, Options, check_stretch
from cavirheo.inference.checks import Window, window
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.model import Network
from cavirheo.inference.network_answer import network_window
from cavirheo.messages import of_error
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.bubble import FIELD, REAL
from cavirheo.physics.media import medium as medium_of
from cavirheo.posterior import Checks, Posterior

DRAWS = 40  # of a posterior, that its band is made of
Band = tuple[Floats, Floats, Floats]


def compared_window(curve: RadiusCurve, analysis: Analysis) -> Window:
    """What is compared with the answer of this analysis. Raises InputError."""
    medium, collapses = medium_of(analysis.medium), cast("int | None", analysis.window)
    network = analysis.network if analysis.method == "bdt" else None
    if isinstance(network, Network):
        return network_window(network, curve, medium, collapses)
    return Experiment(curve, Family("newtonian"), medium, Options(collapses)).view  # of any law


def checks_with(curve: RadiusCurve, posterior: Posterior, values: Mapping[str, float], analysis: Analysis) -> Checks:
    """With these parameters (natural name, SI) in place of those of the answer, or why that cannot be simulated."""
    try:
        return _checks(_experiment(curve, posterior, analysis), posterior, values)
    except (InputError, SolverError) as error:
        return Checks("failed", (of_error(error),))


def band(curve: RadiusCurve, posterior: Posterior, analysis: Analysis, level: float = 0.9) -> Band | None:
    """(s on the measurement's clock, lower and upper radius (m)) of the central part of what the draws simulate; None
    of an answer without draws, or that cannot be simulated."""
    time, lines = posterior.checks.reconstruction_time, list[Floats]()
    if time is None or len(posterior.theta) < 2:
        return None
    parts = list(posterior.laws.values()) or [posterior]
    logs = np.array([part.evidence.log if part.evidence else 0.0 for part in parts])
    rng = np.random.default_rng(0)
    counts = rng.multinomial(DRAWS, np.exp(logs - log_sum(logs)))
    for part, count in zip(parts, counts, strict=True):
        rows = rng.choice(len(part.theta), count, p=part.weights)
        try:
            lines += _lines(_experiment(curve, part, analysis), part, rows, time)
        except (InputError, SolverError):
            return None
    if len(lines) < DRAWS // 2:
        return None
    tail = 0.5 - 0.5 * level
    low, high = np.quantile(np.array(lines), (tail, 1.0 - tail), axis=0)
    return time, low, high


def _experiment(curve: RadiusCurve, posterior: Posterior, analysis: Analysis) -> Experiment:
    """A curve, the model that answers it, and the window that was compared. Raises InputError."""
    frames, medium = posterior.checks.compared_time, medium_of(analysis.medium)
    compared = None if frames is None else window(curve, end=frames[-1] - curve.time_of_max)
    end = (compared or compared_window(curve, analysis)).end
    options = Options(None, end * (1.0 + 1e-9), None, tuple(FREE), bubble=posterior.bubble)
    return Experiment(curve, Family(posterior.material), medium, options)


def _checks(shot: Experiment, posterior: Posterior, values: Mapping[str, float]) -> Checks:
    """Without any damping a real bubble is its limit, the field's. Raises InputError, SolverError."""
    check_stretch(values.get("stretch"))
    if posterior.bubble == REAL and values.get("confinement_damping") == 0.0:
        shot = Experiment(shot.curve, shot.family, shot.medium, replace(shot.options, bubble=FIELD))
    return shot.checks(shot.from_best({**posterior.best, **values}), "ok", [])


def _lines(shot: Experiment, posterior: Posterior, rows: Iterable[int], time: Floats) -> list[Floats]:
    """(n,) radius (m) at these times of each draw that can be simulated."""
    lines = list[Floats]()
    for row in rows:
        with suppress(InputError, SolverError):
            values = {name: float(posterior.draws(name)[row]) for name in posterior.parameters}
            checks = _checks(shot, posterior, values)
            if checks.reconstruction_time is not None and checks.reconstruction_radius is not None:
                lines.append(np.interp(time, checks.reconstruction_time, checks.reconstruction_radius))
    return lines


def slider(posterior: Posterior, name: str, factor: float = 1.0) -> dict[str, float] | None:
    """minimum, maximum, step and value of a parameter that is changed by hand, in SI times `factor`; None where the law
    has none of this name. It starts at the answer, or where searches start, and runs from nearly zero to a round number
    about thrice as large; the stretch over the usual ones."""
    if name not in (*Family(posterior.material).parameters, "stretch"):
        return None
    middle = 10.0 ** float(np.mean(PARAMETERS[name].started))  # type: ignore[arg-type]
    value = float(f"{posterior.best.get(name, middle) * factor:.4g}")
    if name == "stretch":
        return {"minimum": 1.2, "maximum": max(20.0, value), "step": 0.05, "value": value}
    top = float(f"{3.0 * max(value, 1e-6):.1g}")
    low = float(f"{top / 500:.1g}")
    return {"minimum": low, "maximum": top, "step": low, "value": value}
