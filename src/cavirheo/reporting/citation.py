"""What a paper's methods section must say of a result, and whom it must cite."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from cavirheo.errors import InputError, require
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.media import MEDIA as KNOWN
from cavirheo.reporting.answer import CurveRecord, in_unit, parameters_of
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.reporting.sources import (
    BDT,
    DIFFUSIVITY,
    DISCREPANCY,
    EVIDENCE,
    IMR,
    MEDIA,
    MOTION,
    POPULATION,
    SAMPLING,
    Source,
    of_law,
)
from cavirheo.writing import digits

_EQUATIONS = {
    "keller-miksis": "Keller and Miksis",
    "rayleigh-plesset": "Rayleigh and Plesset",
    "gilmore": "Gilmore",
}
TITLE = "cavirheo: inertial microcavitation rheometry from a bubble radius history"

_HOW = {  # by method, what was done and whose method it is
    "verified": (
        "The posterior of the parameters was sampled: draws of a trained proposal were weighed by the likelihood of "
        "the full simulation (adaptive multiple importance sampling [Cornuet2012]), with noise of unknown size and a "
        "discrepancy between law and bubble that was inferred along with them [Kennedy2001].",
        (SAMPLING, DISCREPANCY),
    ),
    "laplace": ("The maximum of the posterior and the Gaussian about it were found by Gauss-Newton steps.", ()),
    "least_squares": (
        "The parameters were fitted by least squares on the simulation; intervals, where given, are of draws weighed "
        "by the likelihood.", (),
    ),
    "amortised": ("The answer is that of a trained posterior network, not verified by simulations.", ()),
    "bdt": ("A Bubble Dynamics Transformer [Bu2025] gave the values, at equal Cauchy and Reynolds numbers.", (BDT,)),
}  # fmt: skip


def methods(result: Result) -> tuple[str, list[Source]]:
    """The paragraph, and whom it cites in the order of appearance. Raises InputError: no curve has an answer."""
    answered = [curve for curve in result.curves if curve.answered]
    require(bool(answered), "no curve of this result has an answer: there is nothing to cite", "cite.nothing")
    own = Source("{The cavirheo developers}", (result.date or "")[:4], TITLE, f"version {result.version}", "")
    cited = [own]
    said = [
        _shots(answered, result),
        *_motion(answered, cited),
        *_model(answered, cited),
        *_media(answered, cited),
        *_window(answered),
    ]
    for method in dict.fromkeys(curve.method for curve in answered):
        words, sources = _HOW[method]
        cited += sources
        said.append(words)
    said += _rivals(answered, cited)
    said += _prior(answered)
    said.append("Values are medians with central 90 % intervals." if _intervals(answered) else "")
    if any(group.population and group.population.found for group in result.groups):
        said.append(
            "The material of a group is the centre of a population of its shots, which was inferred from their "
            f"posteriors and priors, together with the scatter of the shots about it [{POPULATION.key}]."
        )
        cited.append(POPULATION)
    said += [_group(group, [result.curves[i] for i in of], result) for group, of in result.members()]
    said += [_passed(result.curves), f"Command: {result.command}"]
    unique: dict[str, Source] = {}
    for source in cited:
        unique.setdefault(source.key, source)
    return " ".join(filter(None, said)), list(unique.values())


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
    of = f"{digits.counted(len(answered), 'bubble')} ({files}{size}{rate})"
    return f"Radius histories of {of} were analysed with cavirheo {result.version} [cavirheo{(result.date or '')[:4]}]."


def _motion(answered: list[CurveRecord], cited: list[Source]) -> list[str]:
    """The equations of the wall, each with what the gas does."""
    said = []
    for motion, exponent in dict.fromkeys((curve.bubble.motion, curve.bubble.exponent) for curve in answered):
        source = MOTION[motion]
        gas = f"with heat and mass transfer between gas, vapour and medium [{IMR.key}]"
        if exponent is not None:
            gas = f"with a polytropic gas of exponent {exponent:g}"
        said.append(f"The wall follows the equation of {_EQUATIONS[motion]} [{source.key}], {gas}.")
        cited += [source] if exponent is not None else [source, IMR]
    return said


def _model(answered: list[CurveRecord], cited: list[Source]) -> list[str]:
    said = []
    for model in dict.fromkeys((curve.material, curve.bubble) for curve in answered):
        material, bubble = model
        sources = [source for part in material.split("+") for source in of_law(part.strip())]
        cited += sources
        keys = list(dict.fromkeys(source.key for source in sources))
        law = digits.MATERIALS.get(material, material).partition(" (")[0] + (f" [{', '.join(keys)}]" if keys else "")
        vapour = "vapour in equilibrium at the wall"
        if bubble.contents == "kinetic":
            vapour = f"vapour that condenses at a finite rate, with its diffusivity by [{DIFFUSIVITY.key}]"
            cited.append(DIFFUSIVITY)
        damped = "; the surroundings damp the motion (confinement damping)" * (bubble.confinement_damping != 0)
        count = sum((c.material, c.bubble) == model for c in answered)
        hurt = "" if bubble.damage == "none" else f", damaged ({bubble.damage})"
        said.append(f"The medium of {digits.counted(count, 'curve')}: {law}{hurt}; {vapour}{damped}.")
    return said


def _rivals(answered: list[CurveRecord], cited: list[Source]) -> list[str]:
    """The models beside which the answers stand with an evidence, whose the values are, and what is preferred."""
    compared = [one for one in answered if one.evidence]
    own = {one.model: one.itself.in_words for one in compared}
    others = (other for one in compared for other in one.other_models if other.log_evidence is not None)
    rivals = {other.in_words for other in others if other.model not in own}
    if not rivals:
        return []
    cited.append(EVIDENCE)
    preferred = Counter(other.in_words for one in compared if (other := one.preferred))
    found = [f"it prefers {model} in {n} of {digits.counted(len(compared), 'curve')}" for model, n in preferred.items()]
    return [
        f"Values are those of {' or '.join(own.values())}. The evidence [{EVIDENCE.key}] compares this with "
        f"{', '.join(sorted(rivals))}: {', '.join(found) or 'it rejects the given values in no curve'}."
    ]


def _passed(curves: Sequence[CurveRecord]) -> str:
    """How many passed the checks, and what is wrong with the others; those that count besides."""
    verdicts = Counter("ok" if one.verdict == "undetermined" else one.verdict for one in curves)
    others = [f"{n} {digits.VERDICTS[verdict]}" for verdict, n in verdicts.items() if verdict != "ok"]
    wrong = f"; verdicts of the others: {', '.join(others)}" * bool(others)
    count = digits.counting(sum(one.trusted for one in curves), len(curves))
    return (
        f"{verdicts['ok']} of {digits.counted(len(curves), 'curve')} passed the checks of the program (reconstruction "
        f"error, bounds of the ranges, plausibility of the recording){wrong}. {count} in values of groups."
    )


def _media(answered: list[CurveRecord], cited: list[Source]) -> list[str]:
    """The constants by their names; nothing of a document of an older version, which does not hold them."""
    said = []
    media = dict.fromkeys(curve.medium for curve in answered if curve.medium)
    for medium in media:
        groups = dict.fromkeys(curve.group for curve in answered if curve.medium == medium)
        name = medium.name.removesuffix(", changed")
        of = f" of {', '.join(groups)}" if len(media) > 1 else ""
        other = " with changes" if replace(medium, name=name, unusual=True) != KNOWN.get(name, medium) else ""
        key = ""
        if source := MEDIA.get(name):
            cited.append(source)
            key = f" [{source.key}]"
        said.append(
            f"Constants of the medium{of} are those of {name}{key}{other}: density {medium.density:g} kg/m3, sound "
            f"speed {medium.sound_speed:g} m/s, surface tension {medium.surface_tension:g} N/m, pressure "
            f"{medium.pressure:g} Pa, temperature {medium.temperature:g} K."
        )
    return said


def _window(answered: list[CurveRecord]) -> list[str]:
    windows = sorted({curve.window.collapses for curve in answered if curve.window.collapses})
    ends = [curve.window.t_star_end for curve in answered if curve.window.t_star_end]
    if windows and ends:
        *few, last = windows
        collapses = " or ".join([*map(str, few), digits.counted(last, "collapse")])
        return [f"Simulations were compared with the recordings over {collapses} (t/t_c up to {_range(ends)})."]
    return []


def _prior(answered: list[CurveRecord]) -> list[str]:
    sources = Counter(curve.diagnostics.stretch_source for curve in answered if curve.stretch_prior)
    stated = [f"The stretch of {digits.counted(n, 'curve')} was {source}." for source, n in sources.items()]
    if not any(curve.method in ("verified", "laplace", "amortised") for curve in answered):
        return stated
    found = []
    names = [name for curve in answered for name in ("shear_modulus", "viscosity") if _median(curve, name)]
    names += [] if all(curve.stretch_prior for curve in answered) else ["stretch"]
    for name in dict.fromkeys(names):
        about = PARAMETERS[name]
        if about.searched:
            low, high = (10.0**end for end in about.searched)
            found.append(f"{about.symbol} {low:.3g} to {high:.3g}{'' if about.unit == '1' else ' ' + about.unit}")
    return [
        f"Priors are uniform in the logarithm ({', '.join(found)}); time origin, radius scale and R_max were free "
        "within their doubts.",
        *stated,
    ]


def _median(curve: CurveRecord, name: str) -> float | None:
    return {"shear_modulus": curve.shear_modulus_Pa, "viscosity": curve.viscosity_Pa_s}[name].median


def _intervals(answered: list[CurveRecord]) -> bool:
    return any(curve.viscosity_Pa_s.q05 is not None or curve.stretch.q05 is not None for curve in answered)


def _group(group: GroupRecord, members: Sequence[CurveRecord], result: Result) -> str:
    """Its material with the interval, which is the line of the table; of a single trusted shot its values; else the
    mean and the standard deviation of the trusted ones. Nothing where none is trusted."""
    if group.headline:
        return f"{group.name}: {group.headline}."
    trusted, n = [one for one in members if one.trusted], group.n if group.n_trusted is None else group.n_trusted
    values = []
    for name in parameters_of(trusted):
        symbol, factor, unit = in_unit(name, result.modulus_unit)
        text = digits.quantity(trusted[0].itself.quantity(name), factor, unit=unit)
        if n > 1:
            text = f"{digits.spread(group.spread(name), factor).replace('±', '+-')} {unit}".rstrip()
        values += [f"{symbol} = {text}"] if digits.MISSING not in text else []
    over = f" (mean and standard deviation of {n} shots)" if n > 1 else ""
    first = f"{group.warning}; " if group.warning else ""
    return f"{group.name}: {first}{', '.join(values)}{over}." if values and n else ""


def _range(values: list[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"
