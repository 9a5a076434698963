"""Analysis: the settings for the analysis of a curve, used by `infer`, `fit`, the command line, app and cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from itertools import product, repeat
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np

from cavirheo.curve import RadiusCurve, as_curves
from cavirheo.errors import InputError, expect_whole, require
from cavirheo.inference.answer import answer
from cavirheo.inference.assumptions import FREE, FREE_BY_DEFAULT, SCALE_BOUND, Family, Options, check_stretch
from cavirheo.inference.checks import ANALYSIS_ERRORS, curve_warnings, failed_checks, wall_warnings, warned
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.model import DEFAULT, Network, card, path_of
from cavirheo.inference.network_answer import check_outputs, read_draws, read_values
from cavirheo.inference.posterior_network import KNOWN_BUBBLES, PosteriorModel, kind_of, network_of
from cavirheo.inference.verify import verify
from cavirheo.messages import Message, is_input_warning
from cavirheo.parallel import Executor, Threads, cores, default_executor, one_blas_thread, run_jobs
from cavirheo.parameters import LOG10, units
from cavirheo.physics.bubble import FIELD, Bubble, Requested, bubbles_of
from cavirheo.physics.media import CONSTANTS, WATER, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.posterior import Checks, Posterior
from cavirheo.writing.packing import content_hash

_log = logging.getLogger(__name__)
AUTO_LAWS = ("nhkv", "newtonian", "power-law", "fung + newtonian")  # laws of material="auto": gels and liquids
LEVELS = ("auto", "none", "map", "full")  # of verification (inference/verify)
_METHODS = {"infer": "inferring", "bdt": "inferring", "fit": "fitting", "search": "searching"}
Job = tuple[RadiusCurve, Posterior | None]  # a curve, and the answer with which its analysis starts
_LABELS = {"name", "label", "group", "group_source", "column", "notes", "hints", "source", "source_sha256"}
_LABELS |= {"flags", "contact_sheet"}  # keys of `RadiusCurve.meta` on which no answer depends


@dataclass(frozen=True)
class Analysis:
    """The settings for the analysis of a curve. Equal settings are stored in one form, however they are written.

    Attributes:
        method: "infer" (a posterior network, then weighted draws) or "bdt" (the paper's networks), which `model`
            decides; "fit" (the conventional fit); or "search" (the posterior from a search over windows that grow).
        model: the network of infer and bdt, as in `infer`.
        material, medium, stretch, window, trust_input, discrepancy, seed: as in `infer`; the window of fit and search
            as in `fit_many`.
        bubble: as in `infer`; stored as a tuple of `Bubble`.
        given: names of the constants of `medium` that the user gave, which those of a file do not replace; default: all
            if a medium is given.
        verify: as in `infer`; for fit and search "map" (the maximum) or "auto" (weighted draws that start there).
        end, free, t0_bound, scale_bound, weights, others: as in `fit_many`; a search uses them, too.
        ranges: prior ranges of a search, as in `Verification`.

    Raises:
        InputError: an unknown model, law or bubble, a setting outside its domain, or settings that exclude each other.
    """

    method: Literal["infer", "bdt", "fit", "search"] = "infer"
    model: str | Path = DEFAULT
    material: str | None = None
    bubble: Requested | None = None
    medium: Medium | str | None = None
    stretch: float | str | None = None
    window: int | str | None = None
    trust_input: bool = False
    verify: str = "auto"
    discrepancy: bool = True
    seed: int = 0
    end: float | None = None
    free: Sequence[str] | str | None = None
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    weights: str = "learnt"
    others: bool = True
    ranges: Mapping[str, Sequence[float]] | None = None
    given: Collection[str] | None = None

    def __post_init__(self) -> None:
        require(self.method in _METHODS, f"method must be {', '.join(_METHODS)}, got {self.method!r}", "option.method")
        levels = LEVELS if self._networked else ("auto", "map")
        message = f"verify must be {', '.join(levels[:-1])} or {levels[-1]}, got {self.verify!r}"
        require(self.verify in levels, message, "option.verify")
        expect_whole(self.seed, "seed", 0, "option.seed")
        name = str(self.model)
        model = str(Path(name).absolute()) if name.endswith(".onnx") else name  # other processes have other folders
        settings: dict[str, Any] = {"model": model, "medium": WATER, "given": self.given or ()}
        if self.medium is not None:
            settings["medium"] = medium_of(self.medium)
            settings["given"] = tuple(CONSTANTS if self.given is None else self.given)
        kind = card(path_of(str(self.model))) if self._networked else {}
        point = kind.get("kind") == "point"
        settings["bubble"] = bubbles_of(("field" if point else "real") if self.bubble is None else self.bubble)
        if self.free is None:
            settings["free"] = FREE_BY_DEFAULT if self.method == "fit" else tuple(FREE)
        if self._networked:
            settings["method"] = "bdt" if point else "infer"
        if point:
            settings["verify"] = "none" if self.verify == "auto" else self.verify
            message = f"the model {self.model} answers {kind['material']}: leave out material {self.material!r}, or "
            require(self.material in (None, kind["material"]), f"{message}the model", "option.material")
        usual = "auto" if self._networked and self.verify != "none" else "nhkv"
        settings["material"] = self.material or (kind["material"] if point else usual)
        for name, value in settings.items():
            object.__setattr__(self, name, value)
        self.check(())
        for bubble in self.bubbles:
            object.__setattr__(self, "free", self._options(bubble).free)
        if point:
            answerable = self.bubbles == (FIELD,) or self.verify != "none"
            message = f"the model {self.model} knows the field's bubble alone: leave out bubble or the model, or give "
            require(answerable, f"{message}verify map", "option.bubble")
            check_stretch(None if self.stretch == "free" else self.stretch)
            if self.window is not None:
                expect_whole(self.window, "collapses in the window", 1, "option.window")
            return
        for law in self.laws:
            Family(law)
        if self.verify == "none":
            message = "auto compares models by their evidence, which a verification finds: leave out --verify none"
            require(self.material != "auto" and len(self.bubbles) == 1, message, "option.auto")
            message = f"the network by itself knows {KNOWN_BUBBLES}: leave out verify none"
            require(all(map(kind_of, self.bubbles)), message, "option.bubble")

    @property
    def _networked(self) -> bool:
        return self.method in ("infer", "bdt")

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        """The bubbles that are analysed."""
        return bubbles_of(self.bubble)  # type: ignore[arg-type]

    @property
    def laws(self) -> Sequence[str]:
        """The laws that are analysed; with damage, those with an elastic part. Raises InputError: none has one."""
        laws = AUTO_LAWS if self.material == "auto" and self.method != "infer" else (str(self.material),)
        if self.bubbles[0].damage == "none":
            return laws
        elastic = [law for law in laws if Family(law).elastic]
        message = f"damage needs a law with an elastic part, {', '.join(laws)} has none: leave out damage, or add a "
        require(bool(elastic), f"{message}spring", "physics.damage_without_elasticity")
        return elastic

    @property
    def activity(self) -> str:
        """A word for the work in progress."""
        return "weighing" if self.starting_analysis else _METHODS[self.method]

    @property
    def starting_analysis(self) -> Analysis | None:
        """The analysis whose answers are the start of this one; None if this one starts with the curves alone."""
        return replace(self, verify="map") if self.method == "search" and self.verify != "map" else None

    def _options(self, bubble: Bubble) -> Options:
        cut = (self.window, self.end, self.stretch)
        return Options(*cut, self.free, self.t0_bound, self.scale_bound, self.weights, bubble)  # type: ignore[arg-type]

    @property
    def network(self) -> Network | PosteriorModel:
        """The network of infer and bdt. Raises InputError."""
        return network_of(str(self.model))

    def medium_for(self, curve: RadiusCurve) -> Medium:
        """The medium of a curve: with the plausible constants that its file states, but those that the user gave.
        Raises InputError: it would boil."""
        stated = {name: value for name, value in curve.medium.items() if name not in (self.given or ())}
        used = {name: value for name, value in stated.items() if CONSTANTS[name].low <= value <= CONSTANTS[name].high}
        return medium_of(self.medium or WATER, unusual=True, **used)

    def key(self, curve: RadiusCurve) -> str:
        """A hash that identifies the answer: of the samples of the curve and its metadata, of all settings, of the
        version of this package and of the network. The curve's name, file and group do not change it."""
        content = {field.name: getattr(curve, field.name) for field in fields(curve)}
        if len(curve.time):  # a curve without samples keeps its labels, which distinguish it
            content["meta"] = {name: value for name, value in curve.meta.items() if name not in _LABELS}
        network_sha256 = self.network.sha256 if self._networked else ""
        return content_hash([version("cavirheo"), network_sha256, self, content])

    def check(self, curves: Sequence[RadiusCurve]) -> None:
        """Raises InputError: none of these curves can be answered with these settings, because the wall is within R_max
        of every curve. If it is within R_max of some curves, only these fail."""
        largest = [float(np.max(curve.radius, initial=0.0, where=curve.radius > 0)) for curve in curves]
        for bubble in self.bubbles:
            if bubble.wall_distance is not None:
                bubble.inertia(min(largest, default=0.0))

    def run(
        self,
        curves: Sequence[RadiusCurve],
        workers: int | None = None,
        done: Callable[[int, Posterior], None] | None = None,
        starts: Sequence[Posterior] | None = None,
    ) -> list[Posterior]:
        """An answer for each curve, in their order, computed on `workers` cores (default: all), on whose number it does
        not depend. done: called with the index and the answer of each curve when it is ready. starts: the `start` of
        `answer` for each curve. Raises InputError: none of the curves can be answered with these settings."""
        curves = as_curves(curves)
        self.check(curves)
        function, jobs, executor = self._workload(curves, starts, None, workers)
        return run_jobs(function, jobs, executor, done)

    def flow(
        self,
        curves: Sequence[RadiusCurve],
        starts: Sequence[Posterior | None] | None = None,
        executor: Executor | None = None,
    ) -> Generator[tuple[int, Posterior], None, None]:
        """(index of the curve, its answer) in the order in which they are ready, computed by an executor or on all
        cores of this machine. starts: as in `run`. Closing the generator cancels the curves that have not started."""
        function, jobs, chosen = self._workload(curves, starts, executor, None)
        return chosen.map_unordered(function, jobs)

    def _workload(
        self,
        curves: Sequence[RadiusCurve],
        starts: Sequence[Posterior | None] | None,
        executor: Executor | None,
        workers: int | None,
    ) -> tuple[Callable[[Job], Posterior], list[Job], Executor]:
        """The function that answers one job, the job of each curve, and the executor."""
        threads = 1 if executor else max(cores(workers) // max(len(curves), 1), 1)
        chosen = executor or (Threads(workers) if self.verify == "none" else default_executor(len(curves), workers))
        jobs = list(zip(curves, starts or repeat(None, len(curves)), strict=True))
        return partial(_answer, self, threads), jobs, chosen

    def answer(self, curve: RadiusCurve, start: Posterior | None = None, *, workers: int | None = None) -> Posterior:
        """The answer for one curve, on `workers` threads; if it fails, it has no draws and gives the reason. start: the
        answer of `starting_analysis`, if it is known."""
        try:
            medium = self.medium_for(curve)
        except InputError as error:  # the constants of the file and the user's exclude each other
            return replace(self, given=tuple(CONSTANTS))._failed(curve, error)
        settled = replace(self, medium=medium, given=tuple(CONSTANTS)) if curve.medium else self
        answer = settled._answer_in_medium(curve, start, workers)
        new = [message for message in self._stated(curve, medium) if message not in answer.checks.messages]
        doubts = [message for message in new if is_input_warning(message.code)]
        said = [message for message in new if message not in doubts]
        checks = replace(answer.checks, messages=(*said, *answer.checks.messages))
        return replace(answer, checks=warned(checks, doubts, self.trust_input)) if new else answer

    def _answer_in_medium(self, curve: RadiusCurve, start: Posterior | None, workers: int | None) -> Posterior:
        shared = ("medium", "stretch", "seed", "discrepancy", "free", "t0_bound", "scale_bound", "ranges")
        settings: dict[str, Any] = {name: getattr(self, name) for name in shared} | {"level": self.verify}
        if self.method == "infer":
            settings["network"] = self.network
        elif self.method == "bdt":
            settings["bubble"] = self.bubbles
        elif self.method == "fit":
            settings |= {"weights": self.weights, "rival": self.others}
        else:
            settings["search"] = self.starting_analysis is None
        try:
            with one_blas_thread:
                if self.method == "infer" and self.verify != "none":
                    return self._sampled(curve, workers)
                answers = [start] if start else self.starts(curve, workers)
                if self.verify == "none":
                    return answers[0]
                return verify(curve, answers, workers=workers, **settings)
        except InputError:  # no curve can be answered with these settings
            raise
        except Exception as error:  # a defect of this package or of a library: only this curve fails
            _log.exception("%s has no answer", curve.name)
            return self._failed(curve, error)

    def _failed(self, curve: RadiusCurve, error: Exception) -> Posterior:
        """The answer for a curve whose analysis ended with an error."""
        checks = failed_checks(error, curve, self.medium_for(curve))
        return replace(self._empty_answer(curve, self.laws[0], self.bubbles[0]), checks=checks)

    def _sampled(self, curve: RadiusCurve, workers: int | None) -> Posterior:
        """The posterior of a curve: draws of the emulator, each weighed by a simulation."""
        began, medium, bubble = perf_counter(), self.medium_for(curve), self.bubbles[0]
        empty = self._empty_answer(curve, str(self.material), bubble)
        try:
            shot = Experiment(curve, Family(str(self.material)), medium, self._options(bubble))
            found = answer(empty, shot, discrepancy=self.discrepancy, seed=self.seed, workers=workers)
            warnings = [*curve_warnings(curve, medium), *wall_warnings(shot)]
            found = replace(found, checks=warned(found.checks, warnings, self.trust_input))
        except ANALYSIS_ERRORS as error:  # only this curve fails
            found = replace(empty, checks=failed_checks(error, curve, medium))
        return replace(found, seconds=perf_counter() - began)

    def starts(self, curve: RadiusCurve, workers: int | None = None) -> list[Posterior]:
        """The answers that start the verification, one for each law and bubble; a failed one gives the reason."""
        if self.starting_analysis:
            return [self.starting_analysis.answer(curve, workers=workers)]
        if self.method == "bdt":
            return [self._start(curve, str(self.material), FIELD)]
        return [self._start(curve, law, bubble) for law, bubble in product(self.laws, self.bubbles)]

    def _start(self, curve: RadiusCurve, law: str, bubble: Bubble) -> Posterior:
        """The start for one law and bubble: window, input warnings, and the answer of the network, if there is one."""
        began, network, medium = perf_counter(), self.network if self._networked else None, self.medium_for(curve)
        if isinstance(network, Network):
            check_outputs(network)
        empty = self._empty_answer(curve, law, bubble, network)
        try:
            if isinstance(network, Network):
                stretch: Any = None if self.stretch == "free" else self.stretch
                values, warnings = read_values(curve, network, medium, stretch, self.window)  # type: ignore[arg-type]
            else:
                shot = Experiment(curve, Family(law), medium, self._options(bubble))
                checks = Checks("unverified" if network else "ok", t_star_end=shot.view.end / shot.time_scale)
                values, warnings = {"checks": checks}, []
                if network:
                    values, warnings = read_draws(shot, network, checks, self.discrepancy, self.seed, self.verify)
                warnings += wall_warnings(shot)
            values["checks"] = warned(values["checks"], [*curve_warnings(curve, medium), *warnings], self.trust_input)
        except ANALYSIS_ERRORS as error:  # only this curve fails
            values = {"checks": failed_checks(error, curve, medium)}
        provenance = {**empty.provenance, **values.pop("provenance", {})}
        return replace(empty, **values, provenance=provenance, seconds=perf_counter() - began)

    def _stated(self, curve: RadiusCurve, medium: Medium) -> Iterator[Message]:
        """What the file states of medium and stretch, and whether it is used."""
        for name, stated in curve.medium.items():
            plausible, used = CONSTANTS[name], getattr(medium, name)
            values: dict[str, Any] = {"name": name, "stated": stated, "used": used, "unit": plausible.unit}
            if used == stated:
                yield Message("stated.used", values)
            elif name in (self.given or ()):
                yield Message("stated.replaced", values)
            else:
                yield Message("check_input.constant", values | {"low": plausible.low, "high": plausible.high})
        if curve.stretch and self.stretch not in (None, curve.stretch):
            values = {"name": "stretch", "stated": curve.stretch, "used": self.stretch, "unit": ""}
            yield Message("stated.replaced", values)

    def _empty_answer(
        self, curve: RadiusCurve, law: str, bubble: Bubble, network: Network | PosteriorModel | None = None
    ) -> Posterior:
        """An answer without any value."""
        details: dict[str, Any] = {"model": network.name, "model_sha256": network.sha256} if network else {}
        if isinstance(network, Network):
            method, names, details["problem_id"] = "bdt", network.outputs, network.problem.id
        else:
            names = tuple(LOG10 + name for name in Family(law).parameters)
            if network:
                method, names = "amortised", (*names, "stretch")
            else:
                method, details["options"] = "least_squares", asdict(self._options(bubble))
        provenance = {"cavirheo": version("cavirheo"), **details, "source_sha256": curve.source_sha256}
        conditions: dict[str, Any] = {"bubble": bubble, "medium": self.medium_for(curve)}
        draws = np.empty((0, len(names)))
        return Posterior(names, units(names), draws, Checks("failed"), law, method, provenance, **conditions)


def _answer(analysis: Analysis, workers: int, job: Job) -> Posterior:
    """Answer one job of an executor."""
    return analysis.answer(*job, workers=workers)
