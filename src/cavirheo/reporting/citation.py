"""The paragraph on a result for the methods section of a paper, and the references to cite: the entries of
references.bib whose keys are in the paragraph."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from cavirheo.parameters import PARAMETERS
from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import MEDIA as MEDIUM_SETS
from cavirheo.reporting.answer import CurveRecord, display_unit, parameters_of
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.material import KEYS
from cavirheo.reporting.record import Result
from cavirheo.writing import digits

TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"
MEDIUM_KEYS = {"bu2026": "Bu2025", "estrada2018": "Estrada2018", "zhu2025": "Zhu2025", "yang2020": "Yang2020"}  # by set
_DOI = re.compile(r"doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law
_EQUATIONS = {
    "keller-miksis": "Keller and Miksis [Keller1980]",
    "rayleigh-plesset": "Rayleigh and Plesset [Plesset1949]",
    "gilmore": "Gilmore [Gilmore1952]",
}
_METHODS = {  # the sentence with its citations, by method of the answer
    "verified": (
        "The posterior of the parameters was sampled by adaptive importance sampling [Cornuet2012] of a network that "
        "was trained on simulations, and each draw was weighed by a full simulation, with noise of unknown size and a "
        "discrepancy between law and bubble that was inferred along with them [Kennedy2001]."
    ),
    "least_squares": (
        "The parameters were fitted to the simulation under white noise of unknown size: their posterior was sampled "
        "by adaptive importance sampling [Cornuet2012] of a network that was trained on simulations, and each draw was "
        "weighed by a full simulation."
    ),
    "bdt": "A Bubble Dynamics Transformer [Bu2025] gave the values, at equal Cauchy and Reynolds numbers.",
}
_POPULATION = (
    "The material of a group is the centre of a population of its shots, which was inferred from their posteriors and "
    "priors, together with the scatter of the shots about it [Hogg2010]."
)


class Source(NamedTuple):
    """A reference to cite: its key and its BibTeX entry."""

    key: str
    bibtex: str

    @property
    def fields(self) -> dict[str, str]:
        """Author, year, title, journal or note, and doi."""
        return dict(re.findall(r"^  (\w+) = \{(.+)\},?$", self.bibtex, re.MULTILINE))


@cache
def references() -> dict[str, Source]:
    """The entries of references.bib by their keys."""
    entries = files("cavirheo.reporting").joinpath("references.bib").read_text(encoding="utf-8").strip().split("\n\n")
    sources = (Source(entry[entry.index("{") + 1 : entry.index(",")], entry) for entry in entries)
    return {source.key: source for source in sources}


def references_of_law(name: str) -> list[Source]:
    """The references whose DOIs are in the docstring of a law; an empty list for a name that is no law."""
    by_doi = {source.fields.get("doi", ""): source for source in references().values()}
    return [by_doi[doi] for doi in _DOI.findall(getattr(LAWS.get(name), "__doc__", None) or "")]


def methods_paragraph(result: Result) -> tuple[str, list[Source]]:
    """(the paragraph, its references in order of appearance); ("", []) if no curve has an answer."""
    answers = [curve for curve in result.curves if curve.has_answer]
    if not answers:
        return "", []
    year = (result.date or "")[:4]
    sentences = [*_experiment(answers, result), *_inference(answers, result)]
    words = dict.fromkeys(re.findall(r"\w+", " ".join(sentences)))
    sources = [references()[word] for word in words if word in references()]
    sentences += [_group_sentence(group, shots, result) for group, shots in result.rows_by_group()]
    verdicts = Counter("ok" if curve.trusted else curve.verdict for curve in result.curves)
    failures = [f"{n} {digits.VERDICT_STYLES[verdict].words}" for verdict, n in verdicts.items() if verdict != "ok"]
    wrong = f"; verdicts of the others: {', '.join(failures)}" * bool(failures)
    count = digits.counted_shots(sum(curve.trusted for curve in result.curves), len(result.curves))
    sentences += [
        f"{verdicts['ok']} of {digits.counted(len(result.curves), 'curve')} passed the checks of the program "
        f"(reconstruction error, bounds of the ranges, plausibility of the recording){wrong}. {count} in values of "
        f"groups. Command: {result.command}"
    ]
    entry = {"author": "{The cavirheo developers}", "year": year, "title": TITLE, "note": f"version {result.version}"}
    fields = ",\n".join(f"  {name} = {{{text}}}" for name, text in entry.items() if text)
    program = Source(f"cavirheo{year}", f"@misc{{cavirheo{year},\n{fields}\n}}")
    return " ".join(filter(None, sentences)), [program, *sources]


def _experiment(answers: list[CurveRecord], result: Result) -> Iterator[str]:
    """Sentences on the shots, the equations of wall, gas and medium, and those constants that the result contains."""
    sizes = [1e6 * curve.max_radius_m for curve in answers if curve.max_radius_m]
    rates = [curve.strain_rate_per_s for curve in answers if curve.strain_rate_per_s]
    files = ", ".join(f"{name}: {n}" for name, n in Counter(curve.group for curve in answers).items())
    size = f", R_max {_range(sizes)} um" if sizes else ""
    rate = f", strain rates {_range(rates)} 1/s" if rates else ""
    of = f"{digits.counted(len(answers), 'bubble')} ({files}{size}{rate})"
    year = (result.date or "")[:4]
    yield f"Radius histories of {of} were analysed with cavirheo {result.version} [cavirheo{year}]."

    for motion, exponent in dict.fromkeys((curve.bubble.motion, curve.bubble.exponent) for curve in answers):
        gas = "with heat and mass transfer between gas, vapour and medium [Estrada2018]"
        if exponent is not None:
            gas = f"with a polytropic gas of exponent {exponent:g}"
        yield f"The wall follows the equation of {_EQUATIONS[motion]}, {gas}."

    for (material, bubble), count in Counter((curve.material, curve.bubble) for curve in answers).items():
        cited = (source.key for part in material.split("+") for source in references_of_law(part.strip()))
        keys, law = ", ".join(dict.fromkeys(cited)), digits.MATERIAL_TITLES.get(material, material).partition(" (")[0]
        law += f" [{keys}]" if keys else ""
        vapour = "vapour in equilibrium at the wall"
        if bubble.contents == "kinetic":
            vapour = "vapour that condenses at a finite rate, with its diffusivity by [Fuller1966]"
        damped = "; the surroundings damp the motion (confinement damping)" * (bubble.confinement_damping != 0)
        hurt = "" if bubble.damage == "none" else f", damaged ({bubble.damage})"
        yield f"The medium of {digits.counted(count, 'curve')}: {law}{hurt}; {vapour}{damped}."

    media = dict.fromkeys(curve.medium for curve in answers if curve.medium)
    for medium in media:
        groups = dict.fromkeys(curve.group for curve in answers if curve.medium == medium)
        name = medium.name.removesuffix(", changed")
        of = f" of {', '.join(groups)}" if len(media) > 1 else ""
        changed = " with changes" if replace(medium, name=name, unusual=True) != MEDIUM_SETS.get(name, medium) else ""
        key = f" [{MEDIUM_KEYS[name]}]" if name in MEDIUM_KEYS else ""
        yield (
            f"Constants of the medium{of} are those of {name}{key}{changed}: density {medium.density:g} kg/m3, sound "
            f"speed {medium.sound_speed:g} m/s, surface tension {medium.surface_tension:g} N/m, pressure "
            f"{medium.pressure:g} Pa, temperature {medium.temperature:g} K."
        )


def _inference(answers: list[CurveRecord], result: Result) -> Iterator[str]:
    """Sentences on the window, the methods, the compared models, the priors, and what the values are."""
    windows = sorted({curve.window.collapses for curve in answers if curve.window.collapses})
    if windows and (ends := [curve.window.t_star_end for curve in answers if curve.window.t_star_end]):
        *few, last = windows
        collapses = " or ".join([*map(str, few), digits.counted(last, "collapse")])
        yield f"Simulations were compared with the recordings over {collapses} (t/t_c up to {_range(ends)})."
    yield from (_METHODS[method] for method in dict.fromkeys(curve.method for curve in answers))

    compared = [curve for curve in answers if curve.evidence]
    models = {curve.model: curve.model_title for curve in compared}
    alternatives = (model for curve in compared for model in curve.other_models if model.log_evidence is not None)
    if rivals := {model.model_title for model in alternatives if model.model not in models}:
        preferred = Counter(model.model_title for curve in compared if (model := curve.preferred_model))
        count = digits.counted(len(compared), "curve")
        verdicts = ", ".join(f"it prefers {model} in {n} of {count}" for model, n in preferred.items())
        yield f"Values are those of {' or '.join(models.values())}."
        verdicts = verdicts or "it prefers none of these to the given values"
        yield f"The evidence [Kass1995] compares this with {', '.join(sorted(rivals))}: {verdicts}."

    if any(curve.method in ("verified", "least_squares") for curve in answers):
        names = [name for curve in answers for name in KEYS if curve.value(name).known]
        names += [] if all(curve.stretch_prior for curve in answers) else ["stretch"]
        ranges = []
        for symbol, unit, searched, *_ in map(PARAMETERS.__getitem__, dict.fromkeys(names)):
            if searched:
                low, high = (10.0**end for end in searched)
                ranges.append(f"{symbol} {low:.3g} to {high:.3g}" + ("" if unit == "1" else f" {unit}"))
        free = "time origin, radius scale and R_max were free within their priors"
        yield f"Priors are uniform in the logarithm ({', '.join(ranges)}); {free}."
    stated = Counter(curve.diagnostics.stretch_source for curve in answers if curve.stretch_prior)
    yield from (f"The stretch of {digits.counted(n, 'curve')} was {source}." for source, n in stated.items())

    if any(value.q05 is not None for curve in answers for value in (curve.viscosity_Pa_s, curve.stretch)):
        yield "Values are medians with central 90 % intervals."
    if any(group.material for group in result.groups):
        yield _POPULATION


def _group_sentence(group: GroupRecord, members: Sequence[CurveRecord], result: Result) -> str:
    """Sentence on a group: its material, or its only shot, and its doubts; "" without an answer."""
    if not group.has_answer:
        return ""
    doubts = "".join(f"{message.text}; " for message in group.doubts)
    if group.material:
        return f"{group.name}: {doubts}{group.material.line}."
    values = []
    for name in parameters_of(members):
        symbol, factor, unit = display_unit(name, result.modulus_unit)
        text = digits.quantity(group.value(name), factor, unit=unit)
        values += [f"{symbol} = {text}"] if digits.MISSING not in text else []
    return f"{group.name}: {doubts}{', '.join(values)}." if values else ""


def _range(values: list[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"
