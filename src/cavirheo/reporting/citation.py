"""The paragraph on a result for the methods section of a paper, and the references that it cites, of references.bib."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from cavirheo.physics.bubble import Bubble
from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import MEDIA, Medium
from cavirheo.reporting.answer import CurveRecord, display_unit, parameters_of
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits

TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"
MEDIUM_KEYS = {"bu2026": "Bu2025", "estrada2018": "Estrada2018", "zhu2025": "Zhu2025", "yang2020": "Yang2020"}  # by set
_DOI = re.compile(r"doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law
_CITED = re.compile(r"\[([\w, ]+)\]")  # keys in a text
_EQUATIONS = {
    "keller-miksis": "Keller and Miksis [Keller1980]",
    "rayleigh-plesset": "Rayleigh and Plesset [Plesset1949]",
    "gilmore": "Gilmore [Gilmore1952]",
}
_SAMPLED = "Posteriors were sampled by importance sampling of an emulator, each draw weighed by a full simulation"
_INTERVALS = "values are medians with central 90 % intervals"
_METHODS = {
    "verified": f"{_SAMPLED} [Cornuet2012], with noise of unknown size and a discrepancy between law and bubble "
    f"[Kennedy2001]; {_INTERVALS}.",
    "least_squares": f"{_SAMPLED} [Cornuet2012], with white noise of unknown size; {_INTERVALS}.",
    "bdt": "A Bubble Dynamics Transformer [Bu2025] gave the values, at equal Cauchy and Reynolds numbers.",
}
_STRETCH_PRIORS = {"stretch_prior.file": "from the file", "stretch_prior.late_plateau": "from the late plateau"}


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
    dois = _DOI.findall(getattr(LAWS.get(name), "__doc__", None) or "")
    return [source for doi in dois for source in references().values() if source.fields.get("doi") == doi]


def methods_paragraph(result: Result) -> tuple[str, list[Source]]:
    """(the paragraph, its references in order of appearance); ("", []) if no curve has an answer."""
    answers = [curve for curve in result.curves if curve.has_answer]
    if not answers:
        return "", []
    year = (result.date or "")[:4]
    program = f"@misc{{cavirheo{year},\n  author = {{{{The cavirheo developers}}}},\n  title = {{{TITLE}}},\n"
    program += f"  year = {{{year}}},\n" if year else ""
    program += f"  note = {{version {result.version}}}\n}}"
    sizes = digits.ends([curve.max_radius_m for curve in answers], 1e6)
    bubbles = f"{digits.counted(len(answers), 'bubble')}{f' of R_max {sizes} um' if sizes else ''}"
    verdicts = Counter(digits.VERDICT_WORDS[curve.verdict] for curve in result.curves)
    has_material = any(group.population.has_material for group in result.groups)
    laws = ", ".join(dict.fromkeys(name for group in result.groups if group.laws for name in group.laws.laws))
    sentences = [
        f"Radius histories of {bubbles} were analysed with cavirheo {result.version} [cavirheo{year}].",
        *(_model(*model) for model in dict.fromkeys((curve.material, curve.bubble) for curve in answers)),
        *(_constants(medium) for medium in dict.fromkeys(curve.medium for curve in answers if curve.medium)),
        *_inference(answers),
        f"The law was chosen by the evidence [Kass1995] among {laws}." if laws else "",
        "The material of a group is the centre of a population of its shots [Hogg2010]." if has_material else "",
        *(_group(group, shots, result) for group, shots in result.rows_by_group() if group.has_answer),
        f"Verdicts: {', '.join(f'{words} {count}' for words, count in verdicts.items())}.",
    ]
    paragraph = " ".join(filter(None, sentences))
    cited = dict.fromkeys(key for keys in _CITED.findall(paragraph) for key in keys.split(", "))
    sources = [Source(f"cavirheo{year}", program), *(references()[key] for key in cited if key in references())]
    return f"{paragraph} Command: {result.command}", sources


def _cited(keys: Iterable[str]) -> str:
    """' [Key, Key]'; "" for none."""
    keys = ", ".join(dict.fromkeys(keys))
    return f" [{keys}]" if keys else ""


def _model(material: str, bubble: Bubble) -> str:
    """A sentence on law, wall and contents of a bubble."""
    keys = [source.key for part in material.split("+") for source in references_of_law(part.strip())]
    title = digits.MATERIAL_TITLES.get(material, material).partition(" (")[0]
    law = f"The medium was {title}{_cited(keys)}, the wall followed {_EQUATIONS[bubble.motion]}"
    if bubble.exponent is not None:
        return f"{law}, with a polytropic gas of exponent {bubble.exponent:g}."
    law += ", with heat and mass transfer between gas, vapour and medium [Estrada2018]"
    if bubble.contents == "kinetic":
        law += " and vapour that condenses at a finite rate, whose diffusivity is that of Fuller [Fuller1966]"
    return f"{law} ({bubble.title})."


def _constants(medium: Medium) -> str:
    name = medium.name.removesuffix(", changed")
    changed = " with changes" if replace(medium, name=name, unusual=True) != MEDIA.get(name, medium) else ""
    key = _cited([MEDIUM_KEYS[name]] if name in MEDIUM_KEYS else [])
    return (
        f"Constants of the medium were those of {name}{key}{changed}: density {medium.density:g} kg/m3, sound speed "
        f"{medium.sound_speed:g} m/s, surface tension {medium.surface_tension:g} N/m, pressure {medium.pressure:g} Pa, "
        f"temperature {medium.temperature:g} K."
    )


def _inference(answers: Sequence[CurveRecord]) -> list[str]:
    """Sentences on windows, methods and priors of the stretch."""
    sentences = []
    if collapses := sorted({curve.window.collapses for curve in answers if curve.window.collapses}):
        fewest = f"{collapses[0]} to " if len(collapses) > 1 else ""
        sentences.append(f"Each recording was compared over {fewest}{digits.counted(collapses[-1], 'collapse')}.")
    sentences += [_METHODS.get(method, "") for method in dict.fromkeys(curve.method for curve in answers)]
    for code, source in _STRETCH_PRIORS.items():
        priors = [curve.stretch_prior for curve in answers if code in [message.code for message in curve.messages]]
        if priors:
            means, deviations = (digits.ends([prior[key] for prior in priors]) for key in ("mean", "std"))
            sentences.append(f"The prior of the stretch was normal, {source}: mean {means}, deviation {deviations}.")
    return sentences


def _group(group: GroupRecord, shots: Sequence[CurveRecord], result: Result) -> str:
    """A sentence on a group: its doubts, and its material or its only shot."""
    doubts = "".join(f"{message.text}; " for message in group.doubts)
    if group.population.has_material:
        return f"{group.name}: {doubts}{group.population.line}."
    values = []
    for name in parameters_of(shots):
        symbol, factor, unit = display_unit(name, result.modulus_unit)
        if group.value(name).known:
            values.append(f"{symbol} = {digits.quantity(group.value(name), factor, unit=unit)}")
    return f"{group.name}: {doubts}{', '.join(values)}."
