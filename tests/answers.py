"""Curves of known truth, and answers that are not computed, for tests of what is done with answers."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

import cavirheo
from cavirheo import Bubble, NeoHookeanKelvinVoigt, Posterior, RadiusCurve, load, simulate
from cavirheo.messages import Message
from cavirheo.posterior import Checks, Evidence
from cavirheo.reporting import result, write_report

NAMES = ("log10_shear_modulus", "log10_viscosity")
COMMAND = "cavirheo infer shots.mat -o out"
CENTRE = np.array([3.8, -1.4])  # log10 of 6.3 kPa and 0.04 Pa s
FLAT = {NAMES[0]: (1.0, 7.0), NAMES[1]: (-4.0, 1.0)}
GEL = NeoHookeanKelvinVoigt(8e3, 0.05)


def messages(*texts: str, code: str = "test") -> tuple[Message, ...]:
    """Messages with a sentence of their own each."""
    return tuple(Message(code, {"text": text}) for text in texts if text)


def simulated(material=GEL, *, frames=80, frame=1e-6, noise=0.0, seed=3, within=None, **given) -> RadiusCurve:
    """A bubble (`within`: the Bubble) recorded from its maximum on, with independent noise in units of R_max."""
    about = {"max_radius": 250e-6, "stretch": 7.0, "time": frame * np.arange(frames), "bubble": within or Bubble()}
    about |= {name: given.pop(name) for name in ("max_radius", "stretch", "time", "medium") if name in given}
    run = simulate(material, **about)
    scatter = noise * about["max_radius"] * np.random.default_rng(seed).standard_normal(len(run.time))
    return RadiusCurve(run.time, run.radius + scatter, **{"meta": {"name": "shot"}, **given})


def fit(curve: RadiusCurve, *args: Any, **options: Any) -> Posterior:
    """Of the field's bubble alone, with which shots are simulated."""
    return cavirheo.fit(curve, *args, **{"bubble": "field", **options})


def bubble(name="shot[1]", group="shots", source="data/shots.mat", top=2.6e-4, frames=160, **meta) -> RadiusCurve:
    """A history of the right look: growth, three collapses, a plateau; with three frames missing."""
    t_c = top * np.sqrt(998.0 / 101325.0)
    t = np.linspace(-0.7, 6.0, frames)
    wave = np.abs(np.cos(np.pi * t / 1.9)) ** 0.7
    radius = top * (0.12 + 0.88 * np.exp(-np.maximum(t, 0.0) / 0.9) * wave)
    radius[[50, 51, 52]] = np.nan
    notes = ("3 of 160 frames without a radius (NaN)",)
    about = {"name": name, "group": group, "source": source, "notes": notes, **meta}
    return RadiusCurve(t * t_c + 1e-4, radius, meta=about)


def empty(name="shot[3]", group="shots", source="data/shots.mat") -> RadiusCurve:
    meta = {"name": name, "group": group, "source": source}
    return RadiusCurve(np.empty(0), np.empty(0), meta=meta, unusable="cell 3 of 5 is empty")


def answer(curve, G=6100.0, mu=0.021, *, draws=1, verdict="ok", message="", material="nhkv", stretch=9.1) -> Posterior:
    """G and mu, with 5 % of a decade of scatter in several draws."""
    rng = np.random.default_rng(0)
    after = (curve.time >= curve.time_of_max) & np.isfinite(curve.radius)
    time = curve.time[after][:60]
    residual = 0.01 * np.sin(np.arange(len(time)))
    line = np.linspace(time[0], time[-1], 200)
    said = messages(message, code="test")
    if verdict == "check_input":  # is never without an input warning
        said = messages(message or "it is odd", code="check_input.test")
    checks = Checks(
        verdict,
        said,
        rmse_over_rmax=float(np.sqrt(np.mean(residual**2))),
        collapses=2,
        t_star_end=2.6,
        compared_time=time,
        residual_over_rmax=residual,
        reconstruction_time=line,
        reconstruction_radius=np.interp(line, time, curve.radius[after][:60]),
        time_scale=curve.max_radius * np.sqrt(998.0 / 101325.0),
    )
    names = NAMES if material == "nhkv" else NAMES[1:]
    centre = np.log10([G, mu])[-len(names) :]
    theta = centre + (0.05 * rng.standard_normal((draws, len(names))) if draws > 1 else 0.0) * np.ones((draws, 1))
    about: dict[str, Any] = {"stretch": stretch, "seconds": 0.4}
    units = ("Pa", "Pa s")[-len(names) :]
    return Posterior(names, units, theta, checks, material, "bdt", {"model": "bdt-viscoelastic"}, **about)


def unanswered(message="cell 3 of 5 is empty") -> Posterior:
    return Posterior(NAMES, ("Pa", "Pa s"), np.empty((0, 2)), Checks("failed", messages(message)), "nhkv", "bdt")


def holds(posterior: Posterior, share=0.9, **truth: float) -> bool:
    """Whether the intervals hold these values."""
    ends = {name: posterior.interval(name, share) for name in truth}
    return all(ends[name][0] < value < ends[name][1] for name, value in truth.items())


def with_verdict(posterior: Posterior, verdict: str, *said: Message) -> Posterior:
    return replace(posterior, checks=replace(posterior.checks, verdict=verdict, messages=said))


def with_evidence(posterior: Posterior, log: float, error: float = 0.1) -> Posterior:
    return replace(posterior, evidence=Evidence(log, error))


def seen(mean, width, draws=600, *, seed=0, names=NAMES, **more) -> Posterior:
    """Draws of a Gaussian posterior with exactly this mean (d,) and standard deviation."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((draws, len(names)))
    z = (z - z.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(z.T, bias=True).reshape(len(names), -1))).T
    theta = np.asarray(mean) + z * width
    about = {"prior": {name: FLAT[name] for name in names}, **more}
    law = "nhkv" if len(names) == 2 else "newtonian"
    return Posterior(names, ("Pa", "Pa s")[-len(names) :], theta, Checks("ok"), law, "verified", **about)


def shots(n, spread=0.05, width=0.05, *, seed=1, centre=CENTRE, away=()) -> list[Posterior]:
    """Shots about a material, each seen with its own error; those in `away` half a decade off."""
    rng = np.random.default_rng(seed)
    truths = centre + spread * rng.standard_normal((n, 2))
    truths[list(away)] = np.asarray(centre) + 0.5
    return [seen(truth + width * rng.standard_normal(2), width, seed=i) for i, truth in enumerate(truths)]


def document_of(pairs: Sequence[tuple[RadiusCurve, Posterior]], command: str = COMMAND, **about: Any) -> Any:
    """The document of these curves and answers."""
    return result(pairs, command, **about)


def written(folder: Path | str, pairs: Sequence[tuple[RadiusCurve, Posterior]], command: str = COMMAND, **about) -> Any:
    """It, written with its report and loaded again."""
    how = {name: about.pop(name) for name in ("draw", "replace") if name in about}
    write_report(folder, pairs, document_of(pairs, command, **about), **how)
    return load(folder)


class Page(HTMLParser):
    """Collects ids, tags and text, and holds that tags close in order."""

    VOID = ("meta", "br", "img")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.attributes: list[tuple[str, str | None]] = []
        self.text: list[str] = []
        self.feed(text)
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes += attrs
        self.ids += [value for key, value in attrs if key == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert tag in self.VOID or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def same(one: Any, other: Any) -> bool:
    """Whether both are of one class and hold the same, arrays and parts of parts included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, Exception):
        return str(one) == str(other) and vars(one) == vars(other)
    return bool(one == other)
