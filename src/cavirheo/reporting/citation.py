"""The paragraph on a result for the methods section of a paper (methods.txt), and the references that it cites, of
references.bib."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from cavirheo.physics.materials import LAWS
from cavirheo.physics.media import MEDIA, Medium
from cavirheo.reporting.html import template
from cavirheo.reporting.record import Result

TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"
MEDIUM_KEYS = {"bu2026": "Bu2025", "estrada2018": "Estrada2018", "zhu2025": "Zhu2025", "yang2020": "Yang2020"}  # by set
_DOI = re.compile(r"doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law
_CITED = re.compile(r"\[([\w, ]+)\]")  # keys in a text
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
    priors = {
        source: [curve.stretch_prior for curve in answers if code in [message.code for message in curve.messages]]
        for code, source in _STRETCH_PRIORS.items()
    }
    text = template("methods.txt").render(
        result=result,
        program=f"cavirheo{year}",
        answers=answers,
        models=dict.fromkeys((curve.material, curve.bubble, curve.bubble_title) for curve in answers),
        media=[_with_name(medium) for medium in dict.fromkeys(curve.medium for curve in answers if curve.medium)],
        stretch_priors=priors,
        laws=dict.fromkeys(name for group in result.groups if group.laws for name in group.laws.laws),
        verdicts=Counter(curve.verdict for curve in result.curves),
        keys_of_laws=_keys_of_laws,
        MEDIUM_KEYS=MEDIUM_KEYS,
    )
    paragraph = " ".join(text.split())
    cited = dict.fromkeys(key for keys in _CITED.findall(paragraph) for key in keys.split(", "))
    sources = [Source(f"cavirheo{year}", program), *(references()[key] for key in cited if key in references())]
    return f"{paragraph} Command: {result.command}", sources


def _keys_of_laws(material: str) -> list[str]:
    """The keys of the references of a law, or of a sum of laws."""
    return [source.key for part in material.split("+") for source in references_of_law(part.strip())]


def _with_name(medium: Medium) -> tuple[Medium, str, bool]:
    """(medium, name of its constants, whether some of them were changed)."""
    name = medium.name.removesuffix(", changed")
    return medium, name, replace(medium, name=name, unusual=True) != MEDIA.get(name, medium)
