"""The paragraph on a result for the methods section of a paper (methods.txt), and the references that it cites, of
references.bib."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

from cavirheo.parameters import is_law_parameter, parameter_of
from cavirheo.physics.materials import LAWS
from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.reporting.templates import template

TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"
_DOI = re.compile(r"doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law
_CITED = re.compile(r"\[([\w, ]+)\]")  # keys in a text


@cache
def references() -> dict[str, str]:
    """The entries of references.bib, BibTeX, by their keys."""
    entries = files("cavirheo.reporting").joinpath("references.bib").read_text(encoding="utf-8").strip().split("\n\n")
    return {entry[entry.index("{") + 1 : entry.index(",")]: entry for entry in entries}


def references_of_law(material: str) -> list[str]:
    """The keys of the references whose DOIs are in the docstring of a law, or of the laws of a sum."""
    texts = (getattr(LAWS.get(name.strip()), "__doc__", None) or "" for name in material.split("+"))
    dois = [doi for text in texts for doi in _DOI.findall(text)]
    return [key for doi in dois for key, entry in references().items() if f"doi = {{{doi}}}" in entry]


def methods_paragraph(result: Result) -> tuple[str, list[str]]:
    """(the paragraph, the BibTeX entries of its references as they appear); ("", []) if no curve has an answer."""
    answers = [curve for curve in result.curves if curve.has_answer]
    if not answers:
        return "", []
    from cavirheo.inference.assumptions import AUTO, Family  # an import of half a second

    year = (result.date or "")[:4]
    program = f"@misc{{cavirheo{year},\n  author = {{{{The cavirheo developers}}}},\n  title = {{{TITLE}}},\n"
    program += f"  year = {{{year}}},\n" if year else ""
    program += f"  note = {{version {result.version}}}\n}}"
    text = template("methods.txt").render(
        result=result,
        program=f"cavirheo{year}",
        answers=answers,
        models=dict.fromkeys((curve.material, curve.bubble, curve.bubble_title) for curve in answers),
        law_priors=_law_priors(answers),
        atoms=Family(AUTO).atoms if any("liquid" in curve.switches for curve in answers) else {},
        laws=dict.fromkeys(name for group in result.groups if group.laws for name in group.laws.laws),
        verdicts=Counter(curve.verdict for curve in result.curves),
        references_of_law=references_of_law,
    )
    paragraph = " ".join(text.split())
    cited = dict.fromkeys(key for keys in _CITED.findall(paragraph) for key in keys.split(", "))
    sources = [program, *(references()[key] for key in cited if key in references())]
    return f"{paragraph} Command: {result.command}", sources


def _law_priors(answers: Sequence[CurveRecord]) -> dict[str, tuple[float, float]]:
    """Ends of the ranges of the laws' parameters, SI, by their symbols with units."""
    ranges = dict[str, tuple[float, float]]()
    for name, ends in (item for curve in answers for item in curve.provenance.get("prior", {}).items()):
        if is_law_parameter(name):
            parameter = parameter_of(name)
            ranges[f"{parameter.symbol} ({parameter.unit})"] = 10.0 ** ends[0], 10.0 ** ends[1]
    return ranges
