"""Estimations that begin with a search over windows that grow by a collapse: a fit, and a law without a network.

A fit takes the noise as independent from frame to frame. Its size, and the part of it that the motion of the wall
makes, are learnt from the residuals of the best simulation (`Experiment.reweighted`). Models are compared, and the
answer is judged, by the noise of a posterior, which allows for differences that no simulation follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import SolverError
from cavirheo.inference.assumptions import FREE
from cavirheo.inference.experiment import SOLVER_ERROR
from cavirheo.inference.search import POLISH, ROUNDS, LeastSquares, Search
from cavirheo.inference.verify.mode import Mode, Target, climb, modes, same, with_noise
from cavirheo.inference.verify.sampler import Mixture, Proposal, Sample
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.inference.verify.verification import Estimation, Verification
from cavirheo.messages import Message
from cavirheo.physics.accuracy import DEFAULT, ROUGH
from cavirheo.posterior import Evidence, Posterior, WindowAnswer, correlations

AT_BOUND = 1e-3  # of a range: nearer to its end is "at the bound"


class SearchedEstimation(Estimation):
    """An estimation that begins with a search over growing windows. modes: the modes that it found, the best first,
    with the noise of a posterior."""

    def __init__(self, settings: Verification, curve: RadiusCurve, answer: Posterior) -> None:
        super().__init__(settings, curve, answer)
        self.search = Search(self.shot, 0.0 if self.shot.clean else TUNING.search_distance)
        self.modes: list[Mode] = []
        for _ in ROUNDS[:1] if settings.level == "map" else ROUNDS:
            earlier, new = ([self.target.start(x) for x in some] for some in self.search.starts())
            self.modes = modes(self.target, earlier, maxima=self.modes)
            if not (self.modes and self.search.only_noise(self._missed)):
                self.modes = modes(self.target, new, maxima=self.modes)
            if self.modes and self.search.is_finished(self._missed):
                break

    @property
    def _missed(self) -> Floats:
        """Residuals of the best mode over R_max, of the frames that count."""
        return self.noise.split(self.modes[0].residual)[0]

    def starts(self) -> list[Floats]:
        """u (d,) of each mode."""
        return [mode.u for mode in self.modes]

    def scanned(self) -> list[Floats]:
        """No places: the search has looked all over the ranges."""
        return []

    windowed = scanned


class FitEstimation(SearchedEstimation):
    """The estimation of a fit. fitted_modes: modes with its own noise, the best first."""

    method = "least_squares"

    def __init__(self, settings: Verification, curve: RadiusCurve, answer: Posterior) -> None:
        super().__init__(settings, curve, answer)
        followed = (mode for mode in self.modes if self._weigh(self._at(mode)))
        first = next(followed, None)  # a rough simulation may miss the chain limit that stops the default one
        if first is None:
            raise SolverError(f"no mode of {self.shot.family.name} could be simulated")
        if mode := climb(self.target, first.u, ROUGH):
            self._weigh(self._at(mode))
            first = mode
        remaining = [mode for mode in self.modes if not same(mode, first)]
        if self.shot.options.stretch == "plateau" and not self.shot.stretch_prior:
            self.messages.append(Message("stretch.no_plateau"))
        self.fitted_modes = [with_noise(mode, self.target.noise) for mode in (first, *remaining)]

    def _at(self, mode: Mode) -> Floats:
        """x (all,) of a mode."""
        return self.target.with_camera(mode.u[None], self.target.camera.z(mode.residual)[None])[0]

    def _weigh(self, x: Floats) -> bool:
        """Learn the weights of frames from the simulation of x (all,). Whether it did not fail."""
        prediction = self.shot.predict(x, DEFAULT)
        if prediction is None:
            return False
        self.shot = self.shot.reweighted(prediction)
        self.target = Target(self.shot, self.prior, self.shot.white_noise(), self.target.workers)
        return True

    @cached_property
    def network(self) -> Proposal:
        """Gaussians about the modes, and wider ones, because posteriors are curved."""
        fitted = self.fitted_modes
        places, shapes = [mode.u for mode in fitted], [mode.covariance for mode in fitted]
        return Mixture.of_modes(places, shapes, [mode.log_evidence for mode in fitted]).widened(TUNING.fit_wide_share)

    def _nearest(self, x: Floats) -> tuple[Floats, float]:
        """x (all,) and its misfit, infinite if the model may come nearer; for frames with less noise than the solver's
        error, least squares of default simulations from x find the nearest."""
        shot = self.shot
        if shot.misfit(self._missed) > SOLVER_ERROR:
            return x, np.inf
        x = LeastSquares(shot).minimise(np.clip(x, *shot.bounds.T), DEFAULT, POLISH).x
        return x, shot.misfit(shot.difference(x))

    def _answer(
        self, draws: tuple[Floats, Floats], sample: Sample | None, best: Mode, evidence: Evidence,
        maxima: Sequence[Mode], more: Mapping[str, Any], limit: Estimation | None = None,
    ) -> Posterior:  # fmt: skip
        nearest = min(self.modes, key=lambda mode: float(mode.squares(best.u[None])[0]))
        remaining = [mode for mode in self.modes if mode is not nearest]
        answer = super()._answer(draws, sample, best, Evidence(nearest.log_evidence), [best, *remaining], more, limit)
        shot = self.shot
        fit_details: dict[str, Any] = {
            "free": {name: answer.best[name] for name in shot.free if name in FREE.values()},
            "correlations": correlations(answer.names, answer.theta, answer.log_weight),
            "frames": len(shot.measured),
            "frames_per_independent_residual": shot.noise_factor**2,
        }
        windows = self._windows(shot.from_best(answer.best))
        fit_details |= {"simulations": shot.simulations.runs, "failed_simulations": shot.simulations.failures}
        diagnostics = replace(answer.diagnostics, **fit_details)
        return replace(answer, windows=windows, diagnostics=diagnostics, provenance=answer.provenance | fit_details)

    def _windows(self, x: Floats) -> dict[str, WindowAnswer]:
        """The answers of the windows: x (all,) for the whole one, and for a shorter one the minimum that is reached
        from the best of its search, or from x if that is nearer."""
        windows, view = dict[str, WindowAnswer](), self.shot.view
        end_of_last = self.shot.cut_to(view.collapses or None).view.end  # the whole window may end elsewhere
        whole = view.collapses if abs(end_of_last - view.end) < 1e-6 * view.end else "all"
        for (collapses, end), shot in self.search.shots.items():
            (low, high), fit, best = shot.bounds.T, LeastSquares(shot), x
            stage = self.search.stages.get((collapses, end))
            if stage is not None:
                nearest = min((x, stage), key=lambda point: float(np.sum(fit.residuals(point, ROUGH) ** 2)))
                best = fit.minimise(nearest, ROUGH).x
            missed = float(np.sqrt(np.mean(shot.difference(best) ** 2)))
            values = {name: value for name, value in shot.all_values(best).items() if name not in FREE.values()}
            at_end = np.minimum(best - low, high - best) < AT_BOUND * (high - low)
            at_bound = tuple(name for name, at in zip(shot.names, at_end, strict=True) if at)
            rmse = missed if np.isfinite(missed) else None
            windows[str(collapses or whole)] = WindowAnswer(values, shot.view.end / shot.time_scale, rmse, at_bound)
        return windows
