"""Analysis: the settings for the analysis of a curve, used by `infer`, `fit`, the command line, app and cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from functools import partial, wraps
from importlib.metadata import version
from inspect import Parameter, signature
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, TypedDict, TypeVar

import numpy as np

from cavirheo.curve import RadiusCurve, as_curves
from cavirheo.errors import InputError, SolverError, expect, expect_whole, require
from cavirheo.inference.answer import sampled_answer
from cavirheo.inference.assumptions import AUTO, FREE, FREE_BY_DEFAULT, Family, Options, check_stretch
from cavirheo.inference.bdt import Network, network_of, read_values
from cavirheo.inference.emulator import emulator
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.input_warnings import answer_warnings, curve_warnings, warned
from cavirheo.inference.network_files import network_name
from cavirheo.messages import Message, message_of_error
from cavirheo.parallel import Executor, cores, default_executor, one_blas_thread
from cavirheo.parameters import LOG10, units
from cavirheo.physics.bubble import FIELD, Bubble, Requested, bubble_of
from cavirheo.physics.media import CONSTANTS, WATER, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.posterior import Checks, Posterior
from cavirheo.writing.export import content_hash

_log = logging.getLogger(__name__)
DEFAULT = "posterior"  # the model of `infer` that is no network: draws of the emulator, weighed by simulations
_METHODS = {"infer": "inferring", "bdt": "reading", "fit": "fitting"}
# errors with which the analysis of one curve may fail: numbers that are refused (InputError and LinAlgError are
# ValueErrors), simulations that fail, and a curve too large for the memory
ANALYSIS_ERRORS = ValueError, ArithmeticError, SolverError, MemoryError
_LABELS = {"name", "label", "group", "group_source", "notes", "hints", "source", "source_sha256"}
_LABELS |= {"flags", "contact_sheet"}  # keys of `RadiusCurve.meta` on which no answer depends


class _Settings(TypedDict, total=False):
    medium: Medium | str | None
    stretch: float | str | None
    trust_input: bool
    bubble: Requested | None
    seed: int


class InferSettings(_Settings, total=False):
    """Keywords of `infer`, which describes them."""

    model: str | Path
    material: str | None
    window: int | None
    discrepancy: bool


class FitSettings(_Settings, total=False):
    """Keywords of `fit`, which describes them."""

    window: int | str | None
    end: float | None
    free: Sequence[str] | str | None


@dataclass(frozen=True)
class Analysis:
    """The settings for the analysis of a curve. Equal settings are stored in one form, however they are written.

    Attributes:
        method: "infer" (the posterior), "fit" (the same with white noise, as the field fits), or "bdt" (one of the
            paper's networks, which `model` names).
        model: "posterior", or the network of bdt, as in `infer`.
        material, medium, stretch, window, trust_input, discrepancy, seed: as in `infer`.
        bubble: as in `infer`; stored as a `Bubble`.
        end, free: as in `fit`.
        given: names of the constants of `medium` that the user gave, which those of a file do not replace; default: all
            if a medium is given.

    Raises:
        InputError: an unknown model, law or bubble, a setting outside its domain, or settings that exclude each other.
    """

    method: Literal["infer", "bdt", "fit"] = "infer"
    model: str | Path = DEFAULT
    material: str | None = None
    bubble: Requested | None = None
    medium: Medium | str | None = None
    stretch: float | str | None = None
    window: int | str | None = None
    trust_input: bool = False
    discrepancy: bool = True
    seed: int = 0
    end: float | None = None
    free: Sequence[str] | str | None = None
    given: Collection[str] | None = None

    def __post_init__(self) -> None:
        require(self.method in _METHODS, f"method must be {', '.join(_METHODS)}, got {self.method!r}", "option.method")
        expect_whole(self.seed, "seed", 0, "option.seed")
        for switch in ("trust_input", "discrepancy"):
            expect(getattr(self, switch), bool | np.bool_, f"True or False as {switch}")
        name = str(self.model)
        point = self.method != "fit" and name != DEFAULT
        settings: dict[str, Any] = {"medium": WATER, "given": self.given or ()}
        settings["model"] = network_name(name) if point else name
        if self.medium is not None:
            settings["medium"] = medium_of(self.medium)
            settings["given"] = tuple(CONSTANTS if self.given is None else self.given)
        usual = AUTO if self.method == "infer" else "nhkv"
        if point:
            usual = network_of(name).problem.material_name
            settings["method"] = "bdt"
            message = f"the model {name} answers {usual}: leave out material {self.material!r}, or the model"
            require(self.material in (None, usual), message, "option.material")
        settings["material"] = usual if self.material is None else self.material
        settings["bubble"] = bubble_of(("field" if point else "real") if self.bubble is None else self.bubble)
        if self.free is None:
            settings["free"] = FREE_BY_DEFAULT if self.method == "fit" else tuple(FREE)
        if self.method == "fit":
            settings["discrepancy"] = False
        for key, value in settings.items():
            object.__setattr__(self, key, value)
        options = self.options
        object.__setattr__(self, "free", options.free)
        Family(str(self.material)).check_damage(self._bubble)
        if point:
            message = f"the model {name} knows the field's bubble alone: leave out bubble or the model"
            require(self._bubble == FIELD, message, "option.bubble")
            if not self.discrepancy:
                raise self.idle_error("--exact-law (discrepancy=False)")
            check_stretch(None if self.stretch == "free" else self.stretch)

    @property
    def _bubble(self) -> Bubble:
        return self.bubble  # type: ignore[return-value]

    def idle_error(self, names: str) -> InputError:
        """The error that settings are given on which the values of this network do not depend."""
        message = f"the values of the model {self.model} do not depend on {names}: leave that out, or the model"
        return InputError(message, "option.idle")

    @property
    def activity(self) -> str:
        """A word for the work in progress."""
        return _METHODS[self.method]

    @property
    def options(self) -> Options:
        """Options of the experiment. Raises InputError: a setting outside its domain."""
        return Options(self.window, self.end, self.stretch, self.free, self._bubble)  # type: ignore[arg-type]

    @property
    def network(self) -> Network:
        """The network of bdt. Raises InputError."""
        return network_of(str(self.model))

    def medium_for(self, curve: RadiusCurve) -> Medium:
        """The medium of a curve: with the constants that its file states, but those that the user gave. Raises
        InputError: no such liquid is known, or it would boil."""
        stated = {name: value for name, value in curve.medium.items() if name not in (self.given or ())}
        for name, value in stated.items():
            advice = f" (--{name} gives another)"
            CONSTANTS[name].check(f"the {name} that the file states", value, "physics.implausible", advice)
        return medium_of(self.medium or WATER, unusual=True, **stated)

    def experiment(self, curve: RadiusCurve) -> Experiment:
        """A curve as it is compared; with a network at most as much of it as this reads. Raises InputError."""
        medium, options = self.medium_for(curve), self.options
        if self.method == "bdt":
            problem = self.network.problem
            end = problem.grid_step(curve.max_radius, medium) * (problem.frames - 1)
            options = replace(options, end=end, free=())
        return Experiment(curve, Family(str(self.material)), medium, options)

    def key(self, curve: RadiusCurve) -> str:
        """A hash that identifies the answer: of the samples of the curve and its metadata, of all settings, of the
        version of this package and of the network. The curve's name, file and group do not change it."""
        content = {field.name: getattr(curve, field.name) for field in fields(curve)}
        if len(curve.time):  # a curve without samples keeps its labels, which distinguish it
            content["meta"] = {name: value for name, value in curve.meta.items() if name not in _LABELS}
        weights = self.network.sha256 if self.method == "bdt" else emulator().sha256
        return content_hash([version("cavirheo"), weights, self, content])

    def check(self, curves: Sequence[RadiusCurve]) -> None:
        """Raises InputError: the wall is within R_max of every curve (if of some, only these fail), or curves have an
        exposure, on which no network depends, and none is of a recording, which it was needed to measure."""
        recorded = any(curve.meta.get("video") for curve in curves)
        if self.method == "bdt" and not recorded and any(curve.exposure for curve in curves):
            raise self.idle_error("--exposure-us (exposure_s of a curve)")
        if self._bubble.wall_distance is not None:
            largest = [np.max(curve.radius, initial=0.0, where=curve.radius > 0) for curve in curves]
            self._bubble.inertia(float(min(largest, default=0.0)))

    def run(
        self,
        curves: Sequence[RadiusCurve],
        workers: int | None = None,
        done: Callable[[int, Posterior], None] | None = None,
    ) -> list[Posterior]:
        """An answer for each curve, in their order, computed on `workers` cores (default: all), on whose number it does
        not depend. done: called with the index and the answer of each curve when it is ready. Raises InputError: none
        of the curves can be answered with these settings."""
        curves = as_curves(curves)
        self.check(curves)
        answers = dict[int, Posterior]()
        with closing(self.flow(curves, workers=workers)) as flow:
            for index, answer in flow:
                answers[index] = replace(answer, curve=curves[index])
                if done:
                    done(index, answers[index])
        return [answers[index] for index in range(len(curves))]

    def flow(
        self, curves: Sequence[RadiusCurve], executor: Executor | None = None, workers: int | None = None
    ) -> Generator[tuple[int, Posterior], None, None]:
        """(index of the curve, its answer) in the order in which they are ready, computed by an executor or on
        `workers` cores of this machine, without its curve. Closing it drops the curves that have not started."""
        threads = 1 if executor else max(cores(workers) // max(len(curves), 1), 1)
        executor = executor or default_executor(len(curves), workers)
        return executor(partial(self.answer, workers=threads), list(curves))

    def answer(self, curve: RadiusCurve, *, workers: int | None = None) -> Posterior:
        """The answer for one curve, on `workers` threads; if it fails, it has no draws and gives the reason."""
        began, network = perf_counter(), self.network if self.method == "bdt" else None
        empty = self._empty_answer(curve, network)
        try:
            medium = self.medium_for(curve)
            empty = replace(empty, medium=medium)
            with one_blas_thread:
                shot = self.experiment(curve)
                if network:
                    found = replace(empty, **read_values(shot, network))
                    warnings = curve_warnings(curve, medium)
                else:
                    how: dict[str, Any] = {"discrepancy": self.discrepancy, "seed": self.seed, "workers": workers}
                    found = sampled_answer(empty, shot, **how)
                    warnings = [*curve_warnings(curve, medium), *answer_warnings(shot, found)]
            found = replace(found, checks=warned(found.checks, warnings, self.trust_input))
            messages = (*self._stated(curve, medium), *found.checks.messages)
            found = replace(found, checks=replace(found.checks, messages=messages))
        except Exception as error:  # only this curve fails
            if isinstance(error.__cause__, KeyboardInterrupt):  # compiled code was interrupted
                raise error.__cause__ from None
            if isinstance(error, ANALYSIS_ERRORS):
                _log.debug("%s has no answer", curve.name, exc_info=error)
            else:  # a defect of this package or of a library
                _log.exception("%s has no answer", curve.name)
            causes = curve_warnings(curve, empty.medium or WATER)
            found = replace(empty, checks=warned(Checks("failed", (message_of_error(error),)), causes, False))
        return replace(found, seconds=perf_counter() - began)

    def _stated(self, curve: RadiusCurve, medium: Medium) -> Iterator[Message]:
        """What the file states of medium and stretch, and whether it is used."""
        for name, stated in curve.medium.items():
            used = getattr(medium, name)
            values: dict[str, Any] = {"name": name, "stated": stated, "used": used, "unit": CONSTANTS[name].unit}
            yield Message("stated.used" if used == stated else "stated.replaced", values)
        if curve.stretch and self.stretch not in (None, curve.stretch):
            values = {"name": "stretch", "stated": curve.stretch, "used": self.stretch, "unit": ""}
            yield Message("stated.replaced", values)

    def _empty_answer(self, curve: RadiusCurve, network: Network | None) -> Posterior:
        """An answer without any value."""
        law, medium = str(self.material), medium_of(self.medium or WATER)
        names = tuple(LOG10 + name for name in Family(law).parameters)
        method, details = "least_squares" if self.method == "fit" else "verified", dict[str, Any]()
        if network:
            method, names = "bdt", network.outputs
            details = {"model": network.name, "model_sha256": network.sha256, "problem_id": network.problem.id}
        else:
            details["options"] = asdict(self.options)
        given = {*(self.given or ()), *curve.medium}
        assumed = {name: getattr(medium, name) for name in ("density", "pressure") if name not in given}
        provenance = {"cavirheo": version("cavirheo"), **details, "source_sha256": curve.source_sha256}
        provenance["assumed"] = assumed
        provenance["ignored"] = [name for name in curve.meta.get("ignored", ()) if name in assumed]
        draws = np.empty((0, len(names)))
        conditions: dict[str, Any] = {"bubble": self._bubble, "medium": medium}
        return Posterior(names, units(names), draws, Checks("failed"), law, method, provenance, **conditions)


Function = TypeVar("Function", bound=Callable[..., Any])


def takes_settings(kind: type) -> Callable[[Function], Function]:
    """A decorator: the function takes the settings of a TypedDict, which notebooks complete and `help` shows. It raises
    InputError for another keyword."""
    defaults = {field.name: field.default for field in fields(Analysis)}
    settings = [Parameter(name, Parameter.KEYWORD_ONLY, default=defaults[name]) for name in kind.__annotations__]

    def decorate(function: Function) -> Function:
        plain = signature(function)
        *first, _ = plain.parameters.values()
        complete = plain.replace(parameters=[*first, *settings])

        @wraps(function)
        def checked(*arguments: Any, **keywords: Any) -> Any:
            if unknown := ", ".join(sorted(keywords.keys() - complete.parameters.keys())):
                known = ", ".join(complete.parameters)
                constants = f" (constants by medium=Medium({unknown}=...))" if unknown in CONSTANTS else ""
                message = f"{function.__name__} has no option {unknown}{constants}; it has {known}"
                raise InputError(message, "option.name")
            return function(*arguments, **keywords)

        checked.__signature__ = complete  # type: ignore[attr-defined]
        return checked  # type: ignore[return-value]

    return decorate
