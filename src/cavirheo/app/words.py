"""Tables and facts as HTML; numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.model import card, shipped
from cavirheo.posterior import Checks
from cavirheo.writing import digits

_FEW = 4  # remarks that are shown unfolded
NOTHING = '<div class="report"><p class="quiet">{}</p></div>'


def style() -> str:
    """The style of the page: that of the report for all that stands in .report, and its own."""
    report = files("cavirheo.reporting").joinpath("report.css").read_text(encoding="utf-8")
    return ".report {\n" + report + "}\n" + files("cavirheo.app").joinpath("app.css").read_text(encoding="utf-8")


def report(*parts: str) -> str:
    return f'<div class="report">{"".join(parts)}</div>'


def models() -> list[tuple[str, str]]:
    """(label, name) of every shipped model."""
    about = {name: card(path) for name, path in shipped().items()}
    laws = {name: digits.MATERIALS.get(one["material"], one["material"]) for name, one in about.items()}
    return [(f"{law.partition(' (')[0]} · {name}", name) for name, law in laws.items()]


def found(curves: Sequence[RadiusCurve], problems: Sequence[str]) -> str:
    """What was found in the files: a row per shot, the warnings in full, and the files that could not be read."""
    bad = "".join(f'<p class="message failed-message" role="alert">{escape(problem)}</p>' for problem in problems)
    if not curves:
        return report(bad or '<p class="quiet">Nothing loaded yet.</p>')
    heads = (
        "shot",
        "R<sub>max</sub><br>µm",
        "frame rate<br>1000/s",
        "frames<br>with radius",
        "recorded<br>µs",
        "collapses",
    )
    rows = "".join(_row(curve) for curve in curves)
    head = "".join(f"<th scope=col>{text}</th>" for text in heads)
    table = f'<div class="wide"><table class="found"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    return report(bad, warnings(curves), f"<section>{table}{notes(curves)}</section>")


def _row(curve: RadiusCurve) -> str:
    rate = curve.frame_rate
    measured = int(np.isfinite(curve.radius).sum())
    span = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    try:
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    except InputError:
        top = collapses = digits.MISSING
    cells = (
        top,
        digits.significant(rate / 1000) if rate else digits.MISSING,
        f"{measured} of {len(curve.time)}",
        span,
        collapses,
    )
    name = escape(digits.elide(curve.name, 36))
    return f'<tr><td title="{escape(curve.name)}">{name}</td>' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def warnings(curves: Sequence[RadiusCurve]) -> str:
    """What must not be overlooked: curves without R_max, and scales that make no sense."""
    said: dict[str, list[str]] = {}
    for curve in curves:
        try:
            top = curve.max_radius
        except InputError as error:
            said.setdefault(str(error).removeprefix(f"{curve.name}: ").replace("--rmax-um", "step 2"), []).append(
                curve.name
            )
        else:
            if top and (warning := curve.scale_warning()):
                said.setdefault(warning, []).append(curve.name)
    return messages(said)


def notes(curves: Sequence[RadiusCurve], *, shown: bool = False) -> str:
    """What was recognised, converted or left out, each once with the shots that it concerns."""
    said: dict[str, list[str]] = {}
    for curve in curves:
        for note in curve.notes:
            said.setdefault(note, []).append(curve.name)
    about = {note: "all shots" if len(names) == len(curves) else _some(names) for note, names in said.items()}
    lines = "".join(
        f"<li>{escape(note)}" + (f" <small>({escape(about[note])})</small></li>" if len(curves) > 1 else "</li>")
        for note in said
    )
    if shown:
        return f"<h3>What was recognised, converted or left out</h3><ul>{lines}</ul>"
    return f"<details><summary>What was recognised, converted or left out</summary><ul>{lines}</ul></details>"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def stopped(done: int, left: Sequence[str]) -> str:
    """Which shots a stop left out."""
    if not left:
        return ""
    return (
        f'<p class="message" role="status"><b>Stopped: {done} of {done + len(left)} shots done.</b> '
        f"Not run: {escape(_some(left))}.</p>"
    )


def differences(checks: Checks) -> str:
    """'RMSE 1.2 %, mean absolute 0.9 %, largest 4 % of R_max'."""
    return (
        f"RMSE {digits.percent(checks.rmse_over_rmax)} %, mean absolute {digits.percent(checks.mae_over_rmax)} %, "
        f"largest {digits.percent(checks.max_difference_over_rmax)} % of R<sub>max</sub>"
    )


def messages(said: dict[str, list[str]]) -> str:
    """Each message once, after the names of the shots that it is about; more than a few are folded."""
    lines = "".join(
        f'<p class="message" role="status"><b>{escape(_some(names))}</b>: {escape(text)}</p>'
        for text, names in said.items()
        if text
    )
    if len(said) > _FEW:
        return f"<section><details><summary>{len(said)} remarks on single shots</summary>{lines}</details></section>"
    return lines
