"""report.html: one file that needs nothing else, for a colleague, a notebook or the printer.

No script and no request to anywhere: the style and the pictures (SVG) stand in the page. Every word that came from a
file or a command line goes through `escape`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files

from cavirheo.reporting import fitted
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

_READING = """
<p><b>Before a number is used, look at its picture.</b> The points are the measurement; the line is a simulation of
the bubble <i>with the answer</i>, not a curve drawn through the points. The lower panel is what is left between the
two.</p>
<p>{badge[ok]} The simulation of the answer follows the measurement over the window. {badge[model_does_not_fit]} It
does not: the material obeys another law, or the radius scale, the frame times or R<sub>max</sub> are off; G and µ are
then the nearest that the model has, not properties. {badge[outside_training_range]} The answer lies where the network
was never trained, or at a bound of the range that a fit searches: not a value.
{badge[failed]} There is no answer; the reason is given, and no mean contains the
curve. “ok” does not prove the material law: several laws can draw one curve.</p>
<p><b>Intervals.</b> {intervals} The ± of a group is the standard deviation over its answered curves (n − 1 below),
whatever their verdicts: it shows how well shots repeat, not the error that they share, such as that of the radius
scale.</p>
<p><b>The window matters.</b> µ depends on how many collapses are looked at: fits of the first collapse alone commonly
give about twice the µ of fits over three. Compare values of µ only for equal windows, and state the window with them.
For soft gels, 1 % in the radius scale, the frame rate or the time of R<sub>max</sub> moves G by about 1 kPa.</p>
"""
_NUISANCES = {  # label, factor from SI, unit
    "time_origin": ("time origin", 1e6, "µs"),
    "radius_scale": ("radius scale", 1.0, ""),
    "max_radius_factor": ("R<sub>max</sub> factor", 1.0, ""),
}
_POINT = (
    "This method gives a single value for each parameter and no interval; none is shown, because none is known. "
    "The scatter within a group is the only measure of spread here."
)
_INTERVAL = "Numbers in brackets span the central 90 % of the posterior, given the model and its assumptions."


def render(result: Result, pictures: Mapping[int, str], group_pictures: Mapping[int, str]) -> str:
    """The page. `pictures` and `group_pictures`: an <svg> element for the index of a curve or a group, where drawn."""
    factor, unit = result.modulus_unit
    style = files("cavirheo.reporting").joinpath("report.css").read_text(encoding="utf-8")
    badges = {verdict: _badge(verdict) for verdict in digits.VERDICTS}
    points = all(record.viscosity_Pa_s.q05 is None for record in result.curves if record.answered)
    body = [
        _header(result),
        "<main>",
        *(f'<p class="message">{escape(note)}</p>' for note in result.notes),
        groups_table(result.groups, factor, unit),
        curves_table(result.curves, factor, unit),
        *(f'<section class="wide"><figure>{picture}</figure></section>' for picture in group_pictures.values()),
        *(
            article(number, record, factor, unit, pictures.get(number, ""))
            for number, record in enumerate(result.curves)
        ),
        '<section class="reading"><h2>How to read this</h2>',
        _READING.format(badge=badges, intervals=_POINT if points else _INTERVAL),
        "</section>",
        f"<footer>cavirheo {escape(result.version)}. The same numbers, unrounded, are in result.json.</footer>",
        "</main>",
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(_title(result))}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _title(result: Result) -> str:
    names = [group.name for group in result.groups]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "") or "no curves"


def _header(result: Result) -> str:
    n, failed = len(result.curves), sum(not record.answered for record in result.curves)
    facts = [f"{n} curve" + ("" if n == 1 else "s") + (f", {failed} not answered" if failed else "")]
    facts += [*([result.date] if result.date else []), f"cavirheo {result.version}"]
    return (
        f"<header><div><h1>{escape(_title(result))}</h1><p>Material properties from bubble radius histories · "
        f"{escape(' · '.join(facts))}</p><code>{escape(result.command)}</code></div></header>"
    )


def groups_table(groups: list[GroupRecord], factor: float, unit: str) -> str:
    """One row per group; factor and unit are those of G, as `Result.modulus_unit` gives them."""
    rows = [
        f"<tr><td>{_name(group.name)}</td><td>{group.n}</td><td>{digits.spread(group.shear_modulus_Pa, factor)}</td>"
        f"<td>{digits.spread(group.viscosity_Pa_s)}</td><td>{_median(group.shear_modulus_Pa.median, factor)}</td>"
        f"<td>{_median(group.viscosity_Pa_s.median)}</td><td>{_verdicts(group)}</td></tr>"
        for group in groups
    ]
    heads = ("group", "answered", f"G<br>{unit}", "µ<br>Pa s", f"median G<br>{unit}", "median µ<br>Pa s", "verdicts")
    return f"<section><h2>Groups: mean ± standard deviation</h2>{_table(heads, rows, 'groups')}</section>"


def curves_table(
    curves: list[CurveRecord], factor: float, unit: str, *, title: str = "Curves", linked: bool = True
) -> str:
    """One row per curve, with a link to its article if there is one in the page."""
    names = [_name(record.name) for record in curves]
    if linked:
        names = [f'<a href="#curve-{number}">{name}</a>' for number, name in enumerate(names)]
    rows = [
        f"<tr><td>{name}</td><td>{_badge(record.verdict)}</td>"
        f"<td>{_stacked(record.shear_modulus_Pa, factor)}</td><td>{_stacked(record.viscosity_Pa_s)}</td>"
        f"<td>{_stacked(record.stretch)}</td><td>{digits.micrometres(record.max_radius_m)}</td>"
        f"<td>{digits.percent(record.rmse_over_rmax)}</td><td>{_window(record)}</td></tr>"
        for name, record in zip(names, curves, strict=True)
    ]
    heads = (
        "curve", "verdict", f"G<br>{unit}", "µ<br>Pa s", "λ", "R<sub>max</sub><br>µm", "RMSE<br>% R<sub>max</sub>",
        "window",
    )  # fmt: skip
    return f"<section><h2>{title}</h2>{_table(heads, rows, 'curves')}</section>"


def article(number: int, record: CurveRecord, factor: float, unit: str, picture: str) -> str:
    """All that is known of one curve and its answer; `picture`: an <svg> element or nothing."""
    parts = [
        f'<article id="curve-{number}"><div class="head"><h3>{escape(record.name)}</h3>{_badge(record.verdict)}</div>'
    ]
    if record.answered:
        answer = {
            "shear modulus G": (record.shear_modulus_Pa, factor, unit),
            "viscosity µ": (record.viscosity_Pa_s, 1.0, "Pa s"),
            "stretch λ = R<sub>max</sub>/R<sub>0</sub>": (record.stretch, 1.0, ""),
            "R<sub>max</sub>": (Quantity(median=record.max_radius_m), 1e6, "µm"),
        }
        for name, value in record.other_parameters.items():
            label, scale, given = _NUISANCES.get(name, (escape(name), 1.0, ""))
            answer[label] = (value, scale, given)
        items = (
            f"<div><dt>{label}</dt><dd>{_stacked(value, scale, given)}</dd></div>"
            for label, (value, scale, given) in answer.items()
            if value.median is not None
        )
        parts.append(f'<dl class="answer">{"".join(items)}</dl>')
    if record.message:
        kind = "message" if record.answered else "message failed-message"
        parts.append(f'<p class="{kind}">{escape(record.message)}</p>')
    if picture:
        what = "measured radius over time" + (", simulation of the answer and residual" if record.answered else "")
        parts.append(f'<figure aria-label="{what}">{picture}</figure>')
    facts = {"window": escape(record.window.words), "differences": _differences(record)} if record.answered else {}
    facts["material"] = escape(digits.MATERIALS.get(record.material, record.material))
    facts["method"] = escape(digits.METHODS.get(record.method, record.method))
    if isinstance(source := record.provenance.get("stretch_source"), str) and record.answered:
        facts["stretch"] = escape(source)
    facts |= {key: escape(text) for key, text in fitted.facts(record, factor, unit).items()}
    if record.strain_rate_per_s is not None:
        facts["strain rate"] = (
            f"{digits.significant(record.strain_rate_per_s, 2)} 1/s, mean from R<sub>max</sub> to the first collapse"
        )
    if record.notes:
        facts["from the file"] = "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in record.notes) + "</ul>"
    parts.append(
        '<dl class="facts">' + "".join(f"<dt>{key}</dt><dd>{text}</dd>" for key, text in facts.items()) + "</dl>"
    )
    origin = {"source": record.source, **record.provenance, "seconds": round(record.seconds, 3)}
    lines = escape(json.dumps(origin, indent=1, ensure_ascii=False))
    parts.append(
        f"<details><summary>Provenance: model, settings, hashes</summary><pre>{lines}</pre></details></article>"
    )
    return "\n".join(parts)


def _differences(record: CurveRecord) -> str:
    """RMSE, MAE and the largest difference between measured and simulated radius."""
    return (
        f"RMSE {digits.percent(record.rmse_over_rmax)} %, mean absolute {digits.percent(record.mae_over_rmax)} %, "
        f"largest {digits.percent(record.max_difference_over_rmax)} % of R<sub>max</sub>"
    )


def _name(name: str) -> str:
    """Short enough for a table; the whole name shows on hovering."""
    return f'<span title="{escape(name)}">{escape(digits.elide(name, 30))}</span>'


def _table(heads: tuple[str, ...], rows: list[str], kind: str) -> str:
    head = "".join(f"<th>{text}</th>" for text in heads)
    body = f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="wide"><table class="{kind}">{body}</table></div>'


def _window(record: CurveRecord) -> str:
    collapses, *end = escape(record.window.words).split(", ", 1)
    return collapses + "".join(f"<small>{text}</small>" for text in end)


def _stacked(value: Quantity, factor: float = 1.0, unit: str = "") -> str:
    """The median with its unit, the interval small beneath it."""
    number, *interval = digits.quantity(value, factor).split(" ", 1)
    return f"{number} {unit}".rstrip() + "".join(f"<small>{text}</small>" for text in interval)


def _median(value: float | None, factor: float = 1.0) -> str:
    return digits.MISSING if value is None else digits.significant(value * factor)


def _verdicts(group: GroupRecord) -> str:
    return " ".join(_badge(verdict, f"{count} ") for verdict, count in group.verdicts.items())


def _badge(verdict: str, before: str = "") -> str:
    return f'<span class="badge {verdict}">{before}{digits.VERDICTS[verdict]}</span>'
