"""The paragraph on a result for the methods section of a paper, and the references that it cites, of references.bib."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
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
_EQUATIONS = {
    "keller-miksis": ("Keller and Miksis", "Keller1980"),
    "rayleigh-plesset": ("Rayleigh and Plesset", "Plesset1949"),
    "gilmore": ("Gilmore", "Gilmore1952"),
}
_SAMPLED = "by importance sampling of an emulator, each draw weighed by a full simulation"
_NOISES = {
    "verified": "noise of unknown size and a discrepancy between law and bubble",
    "least_squares": "white noise of unknown size",
}


class Source(NamedTuple):
    """A reference to cite: its key and its BibTeX entry."""

    key: str
    bibtex: str

    @property
    def fields(self) -> dict[str, str]:
        """Author, year, title, journal or note, and doi."""
        return dict(re.findall(r"^  (\w+) = \{(.+)\},?$", self.bibtex, re.MULTILINE))


@dataclass
class _Keys:
    """The keys of the references that a text cites, in order."""

    keys: dict[str, None] = field(default_factory=dict)

    def cited(self, *keys: str) -> str:
        """' [Key, Key]', and the keys are noted; "" for none."""
        self.keys |= dict.fromkeys(keys)
        return f" [{', '.join(keys)}]" if keys else ""


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
    program = f"@misc{{cavirheo{year},\n  author = {{{{The cavirheo developers}}}},\n  title = {{{TITLE}}},\n"
    program += f"  year = {{{year}}},\n" if year else ""
    program += f"  note = {{version {result.version}}}\n}}"
    to = _Keys()
    sizes = digits.ends([curve.max_radius_m for curve in answers], 1e6)
    bubbles = f"{digits.counted(len(answers), 'bubble')}{f' of R_max {sizes} um' if sizes else ''}"
    sentences = [
        f"Radius histories of {bubbles} were analysed with cavirheo {result.version} [cavirheo{year}].",
        *(_model(*model, to) for model in dict.fromkeys((curve.material, curve.bubble) for curve in answers)),
        *(_constants(medium, to) for medium in dict.fromkeys(curve.medium for curve in answers if curve.medium)),
        *_inference(answers, to),
    ]
    if any(group.material for group in result.groups):
        population = to.cited("Hogg2010")
        sentences.append(f"The material of a group is the centre of a population of its shots{population}.")
    sentences += [_group(group, shots, result) for group, shots in result.rows_by_group() if group.has_answer]
    verdicts = Counter(digits.VERDICT_WORDS[curve.verdict] for curve in result.curves)
    counts = ", ".join(f"{words} {count}" for words, count in verdicts.items())
    sentences.append(f"Verdicts: {counts}. Command: {result.command}")
    cited = [references()[key] for key in to.keys]
    return " ".join(filter(None, sentences)), [Source(f"cavirheo{year}", program), *cited]


def _model(material: str, bubble: Bubble, to: _Keys) -> str:
    """A sentence on law, wall and contents of a bubble."""
    keys = [source.key for part in material.split("+") for source in references_of_law(part.strip())]
    title = digits.MATERIAL_TITLES.get(material, material).partition(" (")[0]
    name, key = _EQUATIONS[bubble.motion]
    law = f"The medium was {title}{to.cited(*dict.fromkeys(keys))}, the wall followed {name}{to.cited(key)}"
    if bubble.exponent is not None:
        return f"{law}, with a polytropic gas of exponent {bubble.exponent:g}."
    law += f", with heat and mass transfer between gas, vapour and medium{to.cited('Estrada2018')}"
    if bubble.contents == "kinetic":
        law += (
            f" and vapour that condenses at a finite rate, whose diffusivity is that of Fuller{to.cited('Fuller1966')}"
        )
    return f"{law} ({bubble.title})."


def _constants(medium: Medium, to: _Keys) -> str:
    name = medium.name.removesuffix(", changed")
    changed = " with changes" if replace(medium, name=name, unusual=True) != MEDIA.get(name, medium) else ""
    key = to.cited(MEDIUM_KEYS[name]) if name in MEDIUM_KEYS else ""
    return (
        f"Constants of the medium were those of {name}{key}{changed}: density {medium.density:g} kg/m3, sound speed "
        f"{medium.sound_speed:g} m/s, surface tension {medium.surface_tension:g} N/m, pressure {medium.pressure:g} Pa, "
        f"temperature {medium.temperature:g} K."
    )


def _inference(answers: Sequence[CurveRecord], to: _Keys) -> list[str]:
    """Sentences on windows, methods, compared models and priors of the stretch."""
    sentences = []
    if collapses := sorted({curve.window.collapses for curve in answers if curve.window.collapses}):
        fewest = f"{collapses[0]} to " if len(collapses) > 1 else ""
        sentences.append(f"Each recording was compared over {fewest}{digits.counted(collapses[-1], 'collapse')}.")
    for method in dict.fromkeys(curve.method for curve in answers):
        if method in _NOISES:
            draws = f"Its posterior was sampled {_SAMPLED}{to.cited('Cornuet2012')}, with {_NOISES[method]}"
            sentences.append(f"{draws}{to.cited('Kennedy2001') if method == 'verified' else ''}; ")
            sentences[-1] += "values are medians with central 90 % intervals."
        else:
            network = f"A Bubble Dynamics Transformer{to.cited('Bu2025')}"
            sentences.append(f"{network} gave the values, at equal Cauchy and Reynolds numbers.")
    models = {curve.model for curve in answers}
    others = [model for curve in answers if curve.evidence for model in curve.other_models]
    rivals = dict.fromkeys(m.model_title for m in others if m.log_evidence is not None and m.model not in models)
    if rivals:
        preferred = sum(curve.preferred_model is not None for curve in answers)
        compared = f"The evidence{to.cited('Kass1995')} compares this with {', '.join(rivals)}"
        sentences.append(f"{compared}, and prefers one of these for {preferred} of {len(answers)}.")
    sources = dict.fromkeys(curve.diagnostics.stretch_source for curve in answers if curve.stretch_prior)
    return sentences + [f"The stretch was {source}." for source in sources]


def _group(group: GroupRecord, shots: Sequence[CurveRecord], result: Result) -> str:
    """A sentence on a group: its doubts, and its material or its only shot."""
    doubts = "".join(f"{message.text}; " for message in group.doubts)
    if group.material:
        return f"{group.name}: {doubts}{group.material.line}."
    values = []
    for name in parameters_of(shots):
        symbol, factor, unit = display_unit(name, result.modulus_unit)
        if group.value(name).known:
            values.append(f"{symbol} = {digits.quantity(group.value(name), factor, unit=unit)}")
    return f"{group.name}: {doubts}{', '.join(values)}."
