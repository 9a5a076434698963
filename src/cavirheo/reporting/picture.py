"""Pictures of the answers: the measured points, the simulation of the answer over them, and what is left between.

matplotlib is imported when the first picture is drawn, by its object interface alone: nothing global is left changed
and threads may draw at once. Verdicts have colours and are written out as well.
"""

from __future__ import annotations

import io
import re
import textwrap
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.curve import Floats, RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting.record import CurveRecord, GroupRecord, Pairs, curve_record
from cavirheo.writing import digits
from cavirheo.writing.style import BLUE, INK, VERMILLION, new_axes, new_figure, shades, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VERDICT_COLOURS = {
    "ok": "#00694d",
    "model_does_not_fit": "#a34a00",
    "outside_training_range": "#8a3068",
    "failed": "#b00020",
}
KILOPASCAL = (1e-3, "kPa")
_MEASURED, _SIMULATED, _RESIDUAL, _PALE = "#222222", VERMILLION, BLUE, "#b4b4b4"
_HEIGHT = 4.5  # inches
_HEADER = 0.86  # of the height of a curve's picture: name, verdict and answer stand above
_MANY = 1500  # points above which an SVG carries them as pixels
_RMAX = "Rₘₐₓ"
_QUICK: Any = {"text.hinting": "none"}  # hinting costs a fifth of the drawing and shows nothing at this resolution
_settings = Lock()  # matplotlib reads these settings from a global while it writes


def curve_figure(curve: RadiusCurve, posterior: Posterior, unit: tuple[float, str] = KILOPASCAL) -> Figure:
    """One curve and its answer; a failed one shows its measured points and the reason, and no line.

    `unit` is that of G: (factor from Pa, name). Raises InputError without matplotlib.
    """
    figure = new_figure(_HEIGHT)
    record = curve_record(curve, posterior)
    colour = VERDICT_COLOURS[record.verdict]
    write(figure, 0.085, 0.955, digits.elide(record.name, 60), size=11, weight="bold")
    write(figure, 0.975, 0.955, digits.VERDICTS[record.verdict], size=10, weight="bold", ha="right", color=colour)
    if record.answered:
        _write_answer(figure, record, unit)
        _draw_answer(figure, curve, posterior)
    else:
        reason = "\n".join(textwrap.wrap(record.message, 100, max_lines=3, placeholder=" …"))
        write(figure, 0.085, 0.93, reason, size=8.5, color=colour, va="top")
        _draw_unanswered(figure, curve)
    return figure


def _write_answer(figure: Figure, record: CurveRecord, unit: tuple[float, str]) -> None:
    answer = [] if record.shear_modulus_Pa.median is None else [f"G = {_with(record.shear_modulus_Pa, *unit)}"]
    answer.append(f"µ = {_with(record.viscosity_Pa_s, 1.0, 'Pa s')}")
    answer += [] if record.stretch.median is None else [f"λ = {digits.quantity(record.stretch)}"]
    answer.append(f"{_RMAX} = {digits.micrometres(record.max_radius_m)} µm")
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#f4f1ea", "edgecolor": "none"}
    write(figure, 0.096, 0.898, "\u2003\u2002".join(answer), size=9.5, bbox=box)
    (*_, line) = figure.texts
    line.set_fontsize(9.5 * min(1.0, 0.84 * figure.bbox.width / line.get_window_extent().width))  # within the axes


def _draw_unanswered(figure: Figure, curve: RadiusCurve) -> None:
    x, y = _Axis.of(curve), _scale(curve)
    axes = new_axes(figure, (0.085, 0.11, 0.89, 0.7), x.label, y.label)
    _points(axes, x(curve.time), y(curve.radius), _MEASURED)
    if np.isfinite(curve.radius).any():
        axes.set_ylim(bottom=0.0)
    else:
        axes.text(0.5, 0.5, "no measured radius", transform=axes.transAxes, ha="center", color=INK)
        axes.set(xticks=[], yticks=[])


def _draw_answer(figure: Figure, curve: RadiusCurve, posterior: Posterior) -> None:
    checks, x, y = posterior.checks, _Axis.of(curve), _scale(curve)
    upper = new_axes(figure, (0.085, 0.355, 0.89, 0.445), "", y.label)
    lower = new_axes(figure, (0.085, 0.11, 0.89, 0.2), x.label, f"residual (% {_RMAX})")
    time, compared = x(curve.time), x(checks.compared_time if checks.compared_time is not None else np.empty(0))

    inside = np.zeros(len(time), dtype=bool)
    if len(compared):
        slack = 1e-6 * (time[-1] - time[0])
        inside = (time >= compared[0] - slack) & (time <= compared[-1] + slack)
    _points(upper, time, y(np.where(inside, curve.radius, np.nan)), _MEASURED, "measured")
    _points(upper, time, y(np.where(inside, np.nan, curve.radius)), _PALE, "measured, not compared")
    if checks.reconstruction_time is not None and checks.reconstruction_radius is not None:
        line = x(checks.reconstruction_time), y(checks.reconstruction_radius)
        upper.plot(*line, color=_SIMULATED, lw=1.5, label="simulation of the answer", zorder=3)
    upper.set_ylim(bottom=0.0)
    upper.legend(loc="upper right", fontsize=8, frameon=False, handlelength=1.4, borderaxespad=0.1)
    upper.tick_params(labelbottom=False)

    lower.axhline(0.0, color=INK, lw=0.8)
    if checks.residual_over_rmax is not None and len(compared):
        residual = 100.0 * checks.residual_over_rmax
        _points(lower, compared, residual, _RESIDUAL)
        reach = 1.15 * float(np.max(np.abs(residual), initial=0.1))
        lower.set_ylim(-reach, reach)
    if checks.rmse_over_rmax is not None:
        rmse = 100.0 * checks.rmse_over_rmax
        lower.axhspan(-rmse, rmse, color=_RESIDUAL, alpha=0.13, lw=0)
        write(lower, 1.0, 1.05, f"band: ± RMSE = {digits.significant(rmse, 2)} %", size=8, color=INK, ha="right")

    left, right = _view(time, compared)
    for axes in (upper, lower):
        axes.set_xlim(left, right)
    if time[-1] > right:
        write(figure, 0.975, 0.03, f"recorded until {time[-1]:.0f} µs →", size=8, color="#808080", ha="right")
    _t_star_axis(upper, left, right, 1e6 * _time_scale(curve.max_radius, posterior))


def group_figure(pairs: Pairs, group: GroupRecord, unit: tuple[float, str] = KILOPASCAL) -> Figure:
    """The shots of a group laid over each other, R/R_max over t*, beside their answers and the mean ± std of these.

    `pairs` are the group's; failed ones are counted in the title. Raises InputError without matplotlib.
    """
    figure = new_figure(3.5)
    title = f"{digits.elide(group.name, 56)}: {group.shots}"
    write(figure, 0.085, 0.94, title, size=11, weight="bold")
    left = new_axes(figure, (0.085, 0.14, 0.46, 0.72), f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}")
    mu, G = group.viscosity_Pa_s, group.shear_modulus_Pa
    label = f"{_RMAX} (µm)" if G.mean is None else f"G ({unit[1]})"
    right = new_axes(figure, (0.655, 0.14, 0.245, 0.72), label, "µ (Pa s)")

    answered = [(c, p, r) for c, p in pairs if (r := curve_record(c, p)).answered]
    radii = np.array([1e6 * curve.max_radius for curve, _, _ in answered])
    colours = shades((radii - radii.min()) / (np.ptp(radii) or 1.0)) if len(radii) else radii
    for (curve, posterior, record), top, colour in zip(answered, radii, colours, strict=True):
        t_star = (curve.time - curve.time_of_max) / _time_scale(curve.max_radius, posterior)
        left.plot(t_star, curve.radius / curve.max_radius, color=colour, lw=1.0, alpha=0.85)
        x = (top, None) if G.mean is None else _error_bar(record.shear_modulus_Pa, unit[0])
        y = _error_bar(record.viscosity_Pa_s, 1.0)
        right.errorbar(x[0], y[0], xerr=x[1], yerr=y[1], fmt="o", ms=5, color=colour, lw=1.0, mec="white", mew=0.5)
    end = max((record.window.t_star_end or 0.0 for _, _, record in answered), default=0.0)
    left.set_xlim(-1.1, 1.1 * end if end else None)
    left.set_ylim(bottom=0.0)

    if mu.mean is not None and mu.std is not None:
        if G.mean is None or G.std is None:
            right.axhspan(mu.mean - mu.std, mu.mean + mu.std, color=INK, alpha=0.12, lw=0, label="mean ± std")
            right.axhline(mu.mean, color="black", lw=1.0)
        else:
            right.errorbar(
                G.mean * unit[0], mu.mean, xerr=G.std * unit[0], yerr=mu.std,
                fmt="s", ms=4, color="black", lw=1.2, capsize=3, label="mean ± std", zorder=5,
            )  # fmt: skip
        right.legend(loc="lower left", bbox_to_anchor=(-0.05, 1.0), fontsize=8, frameon=False, borderpad=0.1)
    right.margins(0.1)
    right.autoscale_view()
    right.set_ylim(bottom=0.0)
    if G.mean is not None:
        right.set_xlim(left=0.0)
    if len(radii) and np.ptp(radii) > 0:
        _radius_bar(figure, float(radii.min()), float(radii.max()))
    return figure


def _radius_bar(figure: Figure, low: float, high: float) -> None:
    """The key to the colours: R_max in um."""
    bar = figure.add_axes((0.925, 0.14, 0.015, 0.72))
    bar.imshow(shades(np.linspace(0.0, 1.0, 64))[:, None, :], aspect="auto", origin="lower", extent=(0, 1, low, high))
    bar.set(xticks=[], yticks=[low, high])
    bar.yaxis.tick_right()
    bar.yaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
    bar.tick_params(labelsize=8, labelcolor=INK, length=0)
    bar.spines[:].set_visible(False)
    write(bar, 0.5, 1.03, f"{_RMAX}\n(µm)", size=8, ha="center", va="bottom")


def save_png(path: str | Path, figure: Figure, dpi: int = 150) -> None:
    """Write the figure as PNG."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.dpi = dpi
    canvas = FigureCanvasAgg(figure)
    with _settings, matplotlib.rc_context(_QUICK):
        canvas.print_png(str(path), metadata={"Software": "cavirheo"}, pil_kwargs={"compress_level": 1})


def svg(figure: Figure, name: str, *, header: bool = True) -> str:
    """The figure as an <svg> element to stand in a page beside others: `name` (unique in the page) salts its ids.

    Without `header` the lines of text above the axes are left out, for a page that has them in its own type.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    figure.dpi = 72
    none = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    lines = [] if header else [text for text in figure.texts if text.get_position()[1] > _HEADER]
    for line in lines:
        line.set_visible(False)
    with _settings, matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, **_QUICK}):
        FigureCanvasSVG(figure).print_svg(buffer, metadata=none)
    for line in lines:
        line.set_visible(True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"""'DejaVu Sans'[^;"]*""", "system-ui, 'DejaVu Sans', sans-serif", text)
    used = set(re.findall(r"#([\w.-]+)[\")]", text))
    text = re.sub(r' id="([\w.-]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r"\n\s*", "\n", text)
    width, height = 72.0 * figure.get_size_inches()
    top = 0.0 if header else (1.0 - _HEADER) * height
    box = f'viewBox="0 {top:g} {width:g} {height - top:g}"'
    return re.sub(r"<svg [^>]*>", f'<svg {_SVG} {box} role="img">', text, count=1)


_SVG = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'style="stroke-linejoin:round;stroke-linecap:butt"'
)


class _Axis:
    """SI numbers -> what stands on an axis."""

    def __init__(self, origin: float, factor: float, label: str) -> None:
        self.origin, self.factor, self.label = origin, factor, label

    def __call__(self, values: Floats) -> Floats:
        return (values - self.origin) * self.factor

    @staticmethod
    def of(curve: RadiusCurve) -> _Axis:
        if curve.time_unscaled:
            return _Axis(0.0, 1.0, "time (no scale)")
        try:
            return _Axis(curve.time_of_max, 1e6, f"time after {_RMAX} (µs)")
        except InputError:
            return _Axis(0.0, 1e6, "time of the recording (µs)")


def _scale(curve: RadiusCurve) -> _Axis:
    if curve.unscaled:
        return _Axis(0.0, 1.0 / float(np.nanmax(curve.radius, initial=1e-300)), "R / largest R")
    return _Axis(0.0, 1e6, "R (µm)")


def _time_scale(max_radius: float, posterior: Posterior) -> float:
    """t_c = R_max sqrt(rho/p), s, with the medium of the answer (water at one atmosphere where it names none)."""
    medium = posterior.provenance.get("medium")
    medium = medium if isinstance(medium, dict) else {}
    return max_radius * float(np.sqrt(medium.get("density", 998.0) / medium.get("pressure", 101325.0)))


def _view(times: Floats, compared: Floats) -> tuple[float, float]:
    """From the first frame to half a window beyond the window: a long quiet tail would squeeze what was compared."""
    first, last = float(times[0]), float(times[-1])
    if len(compared):
        last = min(last, float(compared[-1] + 0.5 * (compared[-1] - compared[0])))
        first = max(first, float(compared[0] - (compared[-1] - compared[0])))
    margin = 0.015 * (last - first)
    return first - margin, last + margin


def _t_star_axis(axes: Axes, left: float, right: float, t_c: float) -> None:
    """t* in whole numbers along the top: drawn by hand, at a tenth of the time of a second axis."""
    step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 10**9) if (right - left) / t_c / s < 9)
    marks = np.arange(np.ceil(left / t_c / step), np.floor(right / t_c / step) + 1) * step
    along = axes.get_xaxis_transform()
    axes.plot(marks * t_c, np.ones(len(marks)), "|", ms=5, color="#aaaaaa", transform=along, clip_on=False)
    for mark in marks:
        axes.text(mark * t_c, 1.035, f"{mark + 0.0:.0f}", transform=along, fontsize=7.5, color="#808080", ha="center")
    write(axes, -0.008, 1.035, "t*", size=7.5, color="#808080", ha="right")


def _points(axes: Axes, x: Floats, y: Floats, colour: str, label: str | None = None) -> None:
    if np.isfinite(y).any():
        size = float(np.interp(np.count_nonzero(np.isfinite(y)), [50, 400], [3.6, 2.0]))
        axes.plot(x, y, "o", ms=size, mew=0, color=colour, label=label, rasterized=len(x) > _MANY, zorder=2)


def _with(value: Any, factor: float, unit: str) -> str:
    """'6.1 kPa [5.4, 6.9]'."""
    number, *interval = digits.quantity(value, factor).split(" ", 1)
    return " ".join([number, unit, *interval])


def _error_bar(value: Any, factor: float) -> tuple[float, list[list[float]] | None]:
    if value.q05 is None or value.q95 is None:
        return value.median * factor, None
    return value.median * factor, [[factor * (value.median - value.q05)], [factor * (value.q95 - value.median)]]
