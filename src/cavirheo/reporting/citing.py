"""What a paper's methods section must say of a result, and whom it must cite."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from typing import NamedTuple

from cavirheo.errors import InputError, require
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.laws import LAWS
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits

TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"
_SOURCE = re.compile(r"([A-Z][\w,. ]+?) (\d{4}), doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law


class Source(NamedTuple):
    authors: str
    year: str
    title: str
    where: str
    doi: str

    @property
    def key(self) -> str:
        """Estrada2018; of the program, cavirheo2026."""
        return ("cavirheo" if self.authors[0] == "{" else re.split(r"[ ,]", self.authors)[0]) + self.year

    @property
    def bibtex(self) -> str:
        named = {"author": self.authors, "year": self.year, "title": self.title, "journal": self.where, "doi": self.doi}
        kind = "misc" if self.where.startswith(("arXiv", "version")) else "article"
        named = {("note" if kind == "misc" and name == "journal" else name): text for name, text in named.items()}
        lines = [f"  {name} = {{{text}}}" for name, text in named.items() if text]
        return f"@{kind}{{{self.key},\n" + ",\n".join(lines) + "\n}"


_IMR = Source(
    "Estrada, J. B. and Barajas, C. and Henann, D. L. and Johnsen, E. and Franck, C.", "2018",
    "High strain-rate soft material characterization via inertial cavitation",
    "Journal of the Mechanics and Physics of Solids", "10.1016/j.jmps.2017.12.006",
)  # fmt: skip
_WALL = Source(
    "Keller, J. B. and Miksis, M.", "1980", "Bubble oscillations of large amplitude",
    "The Journal of the Acoustical Society of America", "10.1121/1.384720",
)  # fmt: skip
_DIFFUSIVITY = Source(
    "Fuller, E. N. and Schettler, P. D. and Giddings, J. C.", "1966",
    "New method for prediction of binary gas-phase diffusion coefficients", "Industrial and Engineering Chemistry",
    "10.1021/ie50677a007",
)  # fmt: skip
_BDT = Source(
    "Bu, L. and others", "2025", "Bubble Dynamics Transformer: Microrheology at Ultra-High Strain Rates",
    "arXiv:2506.11936", "",
)  # fmt: skip
_SAMPLING = Source(
    "Cornuet, J.-M. and Marin, J.-M. and Mira, A. and Robert, C. P.", "2012", "Adaptive multiple importance sampling",
    "Scandinavian Journal of Statistics", "10.1111/j.1467-9469.2011.00756.x",
)  # fmt: skip
_DISCREPANCY = Source(
    "Kennedy, M. C. and O'Hagan, A.", "2001", "Bayesian calibration of computer models",
    "Journal of the Royal Statistical Society: Series B", "10.1111/1467-9868.00294",
)  # fmt: skip
_HOW = {  # by method, what was done and whose method it is
    "verified": (
        "The posterior of the parameters was sampled: draws of a trained proposal were weighed by the likelihood of "
        "the full simulation (adaptive multiple importance sampling [Cornuet2012]), with noise of unknown size and a "
        "discrepancy between law and bubble that was inferred along with them [Kennedy2001].",
        (_SAMPLING, _DISCREPANCY),
    ),
    "laplace": ("The maximum of the posterior and the Gaussian about it were found by Gauss-Newton steps.", ()),
    "least_squares": (
        "The parameters were fitted by least squares on the simulation; intervals, where given, are of draws weighed "
        "by the likelihood.", (),
    ),
    "amortised": ("The answer is that of a trained posterior network, not verified by simulations.", ()),
    "bdt": ("A Bubble Dynamics Transformer [Bu2025] gave the values, at equal Cauchy and Reynolds numbers.", (_BDT,)),
}  # fmt: skip


def methods(result: Result) -> tuple[str, list[Source]]:
    """The paragraph, and whom it cites in the order of appearance. Raises InputError: no curve has an answer."""
    answered = [curve for curve in result.curves if curve.answered]
    require(bool(answered), "no curve of this result has an answer: there is nothing to cite", "cite.nothing")
    own = Source("{The cavirheo developers}", (result.date or "")[:4], TITLE, f"version {result.version}", "")
    cited = [own, _WALL, _IMR]
    said = [_shots(answered, result), *_model(answered, cited)]
    for method in dict.fromkeys(curve.method for curve in answered):
        words, sources = _HOW[method]
        cited += sources
        said.append(words)
    said += _prior(answered)
    said.append("Values are medians with central 90 % intervals." if _intervals(answered) else "")
    said += [_group(group, result) for group in result.groups]
    trusted = sum(curve.trusted for curve in answered)
    said.append(
        f"{trusted} of {len(result.curves)} curves passed the checks of the program (reconstruction error, bounds of "
        "the ranges, plausibility of the recording); means are over these."
    )
    said.append(f"Command: {result.command}")
    unique = list({source.key: source for source in cited}.values())
    return " ".join(filter(None, said)), unique


def methods_if_any(result: Result) -> tuple[str, list[Source]]:
    """As `methods`; nothing where no curve has an answer."""
    with suppress(InputError):
        return methods(result)
    return "", []


def _shots(answered: list[CurveRecord], result: Result) -> str:
    sizes = [1e6 * curve.max_radius_m for curve in answered if curve.max_radius_m]
    rates = [curve.strain_rate_per_s for curve in answered if curve.strain_rate_per_s]
    files = ", ".join(f"{name}: {n}" for name, n in Counter(curve.group for curve in answered).items())
    size = f", R_max {_range(sizes)} um" if sizes else ""
    rate = f", strain rates {_range(rates)} 1/s" if rates else ""
    with_what = f"cavirheo {result.version} [cavirheo{(result.date or '')[:4]}]"
    return f"Radius histories of {len(answered)} bubbles ({files}{size}{rate}) were analysed with {with_what}."


def _model(answered: list[CurveRecord], cited: list[Source]) -> list[str]:
    said = [
        "The wall follows the equation of Keller and Miksis [Keller1980], with heat and mass transfer between gas, "
        "vapour and medium [Estrada2018]."
    ]
    for model in dict.fromkeys((curve.material, curve.contents, curve.damage) for curve in answered):
        material, contents, damage = model
        keys = []
        for part in material.split("+"):
            for authors, year, doi in _SOURCE.findall(getattr(LAWS.get(part.strip()), "__doc__", None) or ""):
                cited.append(Source(authors.replace(" et al", " and others"), year, "", "", doi))
                keys.append(cited[-1].key)
        law = digits.MATERIALS.get(material, material).partition(" (")[0] + (f" [{', '.join(keys)}]" if keys else "")
        vapour = "vapour in equilibrium at the wall"
        if contents == "kinetic":
            vapour = f"vapour that condenses at a finite rate, with its diffusivity by [{_DIFFUSIVITY.key}]"
            cited.append(_DIFFUSIVITY)
        count = sum((c.material, c.contents, c.damage) == model for c in answered)
        hurt = "" if damage == "none" else f", damaged ({damage})"
        said.append(f"The medium of {count} curves: {law}{hurt}; {vapour}.")
    windows = sorted({curve.window.collapses for curve in answered if curve.window.collapses})
    ends = [curve.window.t_star_end for curve in answered if curve.window.t_star_end]
    if windows and ends:
        collapses = " or ".join(map(str, windows))
        said.append(f"They were compared with the recordings over {collapses} collapses (t/t_c up to {_range(ends)}).")
    return said


def _prior(answered: list[CurveRecord]) -> list[str]:
    if not any(curve.method in ("verified", "laplace", "amortised") for curve in answered):
        return []
    found = []
    names = [name for curve in answered for name in ("shear_modulus", "viscosity") if _median(curve, name)]
    for name in dict.fromkeys([*names, "stretch"]):
        about = PARAMETERS[name]
        if about.searched:
            low, high = (10.0**end for end in about.searched)
            found.append(f"{about.symbol} {low:.3g} to {high:.3g}{'' if about.unit == '1' else ' ' + about.unit}")
    return [
        f"Priors are uniform in the logarithm ({', '.join(found)}); time origin, radius scale and R_max were free "
        "within their doubts."
    ]


def _median(curve: CurveRecord, name: str) -> float | None:
    return {"shear_modulus": curve.shear_modulus_Pa, "viscosity": curve.viscosity_Pa_s}[name].median


def _intervals(answered: list[CurveRecord]) -> bool:
    return any(curve.viscosity_Pa_s.q05 is not None or curve.stretch.q05 is not None for curve in answered)


def _group(group: GroupRecord, result: Result) -> str:
    factor, unit = result.modulus_unit
    values = []
    for symbol, spread, by, of in (
        ("G", group.shear_modulus_Pa, factor, unit), ("mu", group.viscosity_Pa_s, 1.0, "Pa s"),
    ):  # fmt: skip
        if spread.mean is not None:
            scatter = f" +- {digits.significant(spread.std * by)}" if spread.std is not None else ""
            values.append(f"{symbol} = {digits.significant(spread.mean * by)}{scatter} {of}")
    n = group.n if group.n_trusted is None else group.n_trusted
    return f"{group.name}: {', '.join(values)} (mean and standard deviation of {n} shots)." if values and n else ""


def _range(values: list[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"
