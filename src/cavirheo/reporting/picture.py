"""Pictures of the answers: the measured points, the simulation of the best draw over them, and what is left between."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parameters import AT_RATE
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit, parameters_of
from cavirheo.reporting.group import CONSTANTS, GroupRecord
from cavirheo.reporting.record import Pairs
from cavirheo.writing import digits, style
from cavirheo.writing.document import Quantity, Spread
from cavirheo.writing.style import BLACK, BLUE, BOX, INK, VERMILLION, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTSIDE, _GREY = "#b4b4b4", "#808080"
_LEFT, _WIDTH, _RIGHT = 0.085, 0.889, 0.974  # of the axes, in widths of the figure
_UPPER, _LOWER = (_LEFT, 0.355, _WIDTH, 0.445), (_LEFT, 0.11, _WIDTH, 0.2)
_WHOLE = (_LEFT, 0.111, _WIDTH, 0.6975)  # of a curve without an answer
HEAD = 0.155  # of the height of a curve's picture: name, verdict and answer, which the report says itself
DPI = 110  # of a curve's picture: sharp where a page shows it, and half the bytes of 150
_RMAX = "Rₘₐₓ"
_MARKS = ("s", "^", "D", "v")  # of published values


class CurvePicture:
    """A figure whose axes, lines and words are made once and filled by curve after curve: making them takes longest."""

    def __init__(self) -> None:
        from matplotlib.patches import Rectangle

        self.figure = style.new_figure(4.5)
        figure = self.figure
        figure.set_dpi(DPI)  # words are measured as they will be drawn
        self.upper = style.new_axes(figure, _WHOLE, " ", " ")
        self.lower = style.new_axes(figure, _LOWER, " ", " ")
        for axes, height in ((self.upper, _WHOLE[3]), (self.lower, _LOWER[3])):
            axes.xaxis.set_label_coords(0.5, -0.066 / height)
            axes.yaxis.set_label_coords(-0.06, 0.5)
        self.name = write(figure, _LEFT, 0.955, "", size=11, weight="bold")
        self.verdict = write(figure, _RIGHT, 0.955, "", size=10, weight="bold", ha="right")
        self.box = figure.add_artist(Rectangle((_LEFT, 0.88), _WIDTH, 0.054, color=BOX, lw=0))
        self.answer = write(figure, _LEFT + 0.013, 0.8965, "", size=9.5)
        self.reason = write(figure, _LEFT, 0.935, "", size=8.5, va="top")
        self.nothing = write(figure, 0.5, 0.46, "no measured radius", size=10, ha="center")
        self.rmse = write(figure, _RIGHT, 0.321, "", size=8, color=INK, ha="right")
        self.model = write(figure, _LEFT, 0.025, "", size=8, color=_GREY)
        self.until = write(figure, _RIGHT, 0.025, "", size=8, color=_GREY, ha="right")
        self.t_star = self._t_star_axis()

        dots: dict[str, Any] = {"ls": "", "marker": "o", "mew": 0}
        looks = [("measured", {"color": BLACK, **dots}), ("measured, not compared", {"color": OUTSIDE, **dots})]
        looks.append((digits.simulated(""), {"color": VERMILLION, "lw": 1.5}))
        self.lines: list[Any] = []
        self.key: list[tuple[Any, Any]] = []
        for row, (label, look) in enumerate(looks):
            x, y, place = [0.742, 0.755, 0.768], 0.95 - 0.083 * row, self.upper.transAxes
            self.lines += self.upper.plot([], [], label=label, **look)
            (sample,) = self.upper.plot(x, [y] * 3, transform=place, ms=3.6, markevery=[1], **look)
            self.key.append((sample, write(self.upper, 0.78, y, label, size=8, va="center_baseline")))
        self.band = self.lower.axhspan(0.0, 0.0, color=BLUE, alpha=0.13, lw=0)
        self.lower.axhline(0.0, color=INK, lw=0.8)
        self.residual = self.lower.plot([], [], color=BLUE, label="residual", **dots)[0]

    def _t_star_axis(self) -> Any:
        """t* in whole numbers along the top."""
        from matplotlib.ticker import MaxNLocator

        axes: Any = self.upper.twiny()
        axes.spines[:].set_visible(False)
        axes.tick_params(labelsize=7.5, labelcolor=_GREY, color="#aaaaaa", length=5, direction="inout", pad=1)
        axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 5, 10], integer=True))
        axes.yaxis.set_visible(False)
        write(axes, -0.008, 1.035, "t*", size=7.5, color=_GREY, ha="right")
        return axes

    def show(self, curve: RadiusCurve, checks: Checks, record: CurveRecord, unit: Unit) -> Figure:
        """One curve and its answer; a failed one shows its measured points and the reason, and no line.

        `record` is the row of the curve. Save the figure before the next.
        """
        answered, look = record.answered, digits.LOOKS[record.verdict]
        self.name.set_text(digits.printable(digits.elide(record.name, 60)))
        self.verdict.set(text=look.words, color=look.colour)
        self.lines[2].set_label(said := digits.simulated(record.method))
        self.key[2][1].set_text(said)
        reason = [] if answered else textwrap.wrap(digits.printable(record.message), 100, max_lines=3, placeholder=" …")
        self.reason.set(text="\n".join(reason), color=look.colour)
        self.upper.set_position(_UPPER if answered else _WHOLE)
        self.upper.tick_params(labelbottom=not answered)
        self.upper.xaxis.label.set_visible(not answered)
        for part in (self.box, self.answer, self.lower, self.rmse, self.until, self.model):
            part.set_visible(answered)
        if answered:
            self._write_answer(record, unit)
        self.upper.set_visible(known := bool(np.isfinite(curve.radius).any()))
        self.nothing.set_visible(not known)
        self.t_star.set_visible(answered and checks.time_scale is not None)
        if known:
            self._show_lines(curve, checks if answered else Checks("failed"))
        return self.figure

    def _write_answer(self, record: CurveRecord, unit: tuple[float, str]) -> None:
        answer = []
        for name in (*parameters_of([record]), "stretch"):
            symbol, factor, written = in_unit(name, unit)
            value = record.itself.quantity(name)
            answer += [] if value.median is None else [f"{symbol} = {digits.quantity(value, factor, unit=written)}"]
        answer.append(f"{_RMAX} = {digits.micrometres(record.max_radius_m)} µm")
        self.model.set_text(digits.elide(f"model: {record.itself.in_words}", 56))
        for size in np.arange(9.5, 5.0, -0.25):  # within the box; glyphs have whole pixels, so no size can be computed
            self.answer.set(text="\u2003\u2002".join(answer), fontsize=size)
            if self.answer.get_window_extent().width < (_WIDTH - 0.04) * self.figure.bbox.width:
                break

    def _show_lines(self, curve: RadiusCurve, checks: Checks) -> None:
        lines = lines_of(curve, checks)
        time, radius, inside = lines.time, lines.radius, lines.inside
        parts = ((time[inside], radius[inside]), (time[~inside], radius[~inside]), (lines.simulated, lines.drawn))
        for line, (sample, label), part in zip(self.lines, self.key, parts, strict=True):
            sample.set_visible(_fill(line, *part) and checks.verdict != "failed")
            label.set_visible(sample.get_visible())
        view, (along, up) = lines.view, lines.labels
        self.upper.set(xlim=view, ylim=(0.0, lines.top), xlabel=along, ylabel=up)
        if checks.time_scale is not None:
            self.t_star.set_xlim(np.array(view) / (lines.per_second * checks.time_scale))

        rmse, reach = lines.rmse, lines.reach
        self.lower.set(xlim=view, ylim=(-reach, reach), xlabel=along, ylabel=f"residual (% {_RMAX})")
        self.band.set(y=-rmse, height=2.0 * rmse)
        self.rmse.set_text(f"band: ± RMSE = {digits.significant(rmse, 2)} %" if rmse else "")
        _fill(self.residual, lines.compared, lines.residual)
        self.until.set_text(f"recorded until {time[-1]:.0f} µs →" if time[-1] > view[1] else "")


class Lines(NamedTuple):
    """What a picture of a curve shows, in the units of its axes: time and radius of the frames and whether they were
    compared; the simulation that is drawn; the residual of the compared frames, %; the ends of the axes."""

    time: Floats
    radius: Floats
    inside: np.ndarray
    simulated: Floats
    drawn: Floats
    compared: Floats
    residual: Floats
    view: tuple[float, float]
    top: float
    reach: float
    rmse: float
    labels: tuple[str, str]
    per_second: float


def lines_of(curve: RadiusCurve, checks: Checks) -> Lines:
    """Of a curve that has measured radii."""
    x, y = _scales(curve)
    time, radius, drawn = x(curve.time), y(curve.radius), y(checks.reconstruction_radius)
    compared, simulated = x(checks.compared_time), x(checks.reconstruction_time)
    residual = _Scale(0.0, 100.0, "%")(checks.residual_over_rmax)
    inside = np.full(len(time), checks.verdict == "failed")
    if len(compared):
        slack = 1e-6 * (time[-1] - time[0])
        inside = (time >= compared[0] - slack) & (time <= compared[-1] + slack)
    top = 1.05 * max(float(np.nanmax(radius)), float(np.max(drawn, initial=0.0)))
    rmse = 100.0 * (checks.rmse_over_rmax or 0.0)
    reach = 1.15 * max(float(np.max(np.abs(residual), initial=0.1)), rmse)
    about = _view(time, compared), top, reach, rmse, (x.label, y.label), x.factor
    return Lines(time, radius, inside, simulated, drawn, compared, residual, *about)


def group_picture(pairs: Pairs, records: Sequence[CurveRecord], group: GroupRecord, unit: Unit) -> Figure:
    """The shots of a group laid over each other, R/R_max over t*, beside their answers, and what these say of the
    material: its centre and 90 % of its shots, or the mean ± std; and published values.

    `pairs` and `records` are the group's; failed ones are counted in the title, those not trusted drawn as rings.
    """
    shots = [(c, p.checks, r) for (c, p), r in zip(pairs, records, strict=True) if r.answered]
    names = parameters_of([record for *_, record in shots])
    upper = next((name for name in CONSTANTS if name in names), names[0])
    beside = ["shear_modulus"] if "shear_modulus" in names and upper != "shear_modulus" else []
    all_elastic = beside and all(record.shear_modulus_Pa.median is not None for *_, record in shots)
    beside += [] if all_elastic and upper not in group.slopes else ["R_max"]
    height = 3.5 + 1.7 * (len(beside) - 1)
    bottom = 0.486 / height  # of all axes
    figure = style.new_figure(height)
    head = f"{digits.elide(group.name, 32)}: {group.shots}"
    write(figure, _LEFT, 1.0 - 0.19 / height, head, size=11, weight="bold")
    models = dict.fromkeys(record.itself.in_words for *_, record in shots)
    said = filter(None, [*models, group.basis])
    write(figure, _LEFT, 1.0 - 0.35 / height, digits.elide("; ".join(said), 90), size=8.5, color=INK)
    radii = np.array([1e6 * curve.max_radius for curve, _, _ in shots])
    low, high = (radii.min(), radii.max()) if len(radii) else (0.0, 0.0)
    colours = [tuple(tone) for tone in style.shades((radii - low) / ((high - low) or 1.0))]

    end = max((record.window.t_star_end or 0.0 for *_, record in shots), default=0.0) or 1.0
    tall = 1.0 - bottom - 0.5 / height
    axes = style.new_axes(figure, (_LEFT, bottom, 0.459, tall), f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}")
    for (curve, checks, record), colour in zip(shots, colours, strict=True):
        if checks.time_scale:
            t_star = (curve.time - curve.time_of_max) / checks.time_scale
            axes.plot(t_star, curve.radius / curve.max_radius, color=colour, lw=1.0, alpha=0.85, label=record.name)
    axes.set(xlim=(-1.1, 1.1 * end), ylim=(0.0, 1.06))
    share = (tall - 0.72 / height * (len(beside) - 1)) / len(beside)
    for k, across in enumerate(beside):
        place = (0.656, 1.0 - 0.5 / height - share - k * (share + 0.72 / height), 0.245, share)
        _scatter(figure, place, [record for *_, record in shots], colours, group, unit, upper, across)
    if high > low:  # the key to the colours
        bar: Any = figure.add_axes((0.925, bottom, 0.0155, tall), xticks=[], yticks=[low, high], frame_on=False)
        tones = style.shades(np.linspace(1.0, 0.0, 32))[:, None]
        bar.imshow(tones, aspect="auto", extent=(0.0, 1.0, low, high))
        bar.yaxis.set_major_formatter("{x:.0f}")
        bar.tick_params(left=False, labelleft=False, labelright=True, labelsize=8, labelcolor=INK)
        bar.set_title(f"{_RMAX}\n(µm)", fontsize=8, color=INK)
    return figure


def _scatter(
    figure: Figure, place: tuple[float, float, float, float], records: Sequence[CurveRecord], colours: list[Any],
    group: GroupRecord, unit: Unit, upper: str, across: str,
) -> None:  # fmt: skip
    """A parameter over another or over R_max, with intervals; over R_max with the power law of its slope."""
    x, (mean_x, std_x), x_label = _along(across, records, group, unit)
    y, (mean, std), y_label = _along(upper, records, group, unit)
    axes = style.new_axes(figure, place, x_label, y_label)
    axes.hlines(y[:, 0], x[:, 1], x[:, 2], colors=colours, lw=1.0)
    axes.vlines(x[:, 0], y[:, 1], y[:, 2], colors=colours, lw=1.0)
    inside = [tone if record.trusted else "white" for tone, record in zip(colours, records, strict=True)]
    axes.scatter(x[:, 0], y[:, 0], s=25, c=inside, edgecolors=colours, zorder=2)
    over_size = across == "R_max"
    if over_size and (slope := group.slopes.get(upper)):
        line = np.linspace(x[:, 0].min(), x[:, 0].max(), 60)
        known = (y[:, 0] > 0) & [record.trusted or slope.n_trusted < slope.n for record in records]
        level = np.median(np.log(y[known, 0]) - (slope.median or 0.0) * np.log(x[known, 0]))
        label = f"{_RMAX}^{slope.words}"
        axes.plot(line, np.exp(level) * line ** (slope.median or 0.0), color="black", lw=1.0, label=label)
    elif not over_size and _material(axes, group, unit, across, upper):
        pass
    elif mean is not None and std is not None:
        if over_size:
            axes.axhspan(mean - std, mean + std, color=INK, alpha=0.12, lw=0)
            axes.axhline(mean, color="black", lw=1.0, label="mean ± std")
        else:
            axes.errorbar(
                mean_x or 0.0, mean, std, std_x or 0.0, "o", color="black", ms=4.5, lw=1.2, label="mean ± std"
            )
    shown = {} if over_size and group.shear_modulus_Pa.mean is not None else group.published  # once
    for k, (method, values) in enumerate(shown.items()):
        _published(axes, method, values, unit, across, upper, _MARKS[k % len(_MARKS)])
    if "white" in inside:
        axes.scatter([], [], s=25, color="white", edgecolor=INK, label="not trusted")
    axes.margins(0.1)
    style.around(axes, x=not over_size)
    if axes.get_legend_handles_labels()[0]:
        key = {"frameon": False, "fontsize": 8, "handletextpad": 0.3, "columnspacing": 1.0, "borderpad": 0.0}
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.01), ncols=2, **key)


def _material(axes: Any, group: GroupRecord, unit: Unit, across: str, upper: str) -> bool:
    """The centre with its interval, and the contour of the shots; whether there is one."""
    contour = group.population.contour() if group.population else None
    if group.population is None or contour is None or (across, upper) != ("shear_modulus", "viscosity"):
        return False
    factor = in_unit(across, unit)[1]
    axes.plot(factor * contour[:, 1], contour[:, 0], "k--", lw=1.0, zorder=3, label="90 % of shots")
    x, y = (_ends([group.population.centre(name)], by)[0] for name, by in ((across, factor), (upper, 1.0)))
    ends = [[[one[0] - one[1]], [one[2] - one[0]]] for one in (x, y)]
    axes.errorbar(x[0], y[0], ends[1], ends[0], "o", color="black", ms=4.5, lw=1.2, zorder=3, label="material")
    return True


def _published(axes: Any, method: str, values: Mapping[str, Spread], unit: Unit, x: str, y: str, mark: str) -> None:
    """Mean ± std of a method, where it has what the axes show."""
    known = [(values.get(name, Spread()), in_unit(name, unit)[1]) for name in (x, y) if name != "R_max"]
    if any(value.mean is None for value, _ in known):
        return
    at = [(factor * (value.mean or 0.0), factor * (value.std or 0.0)) for value, factor in known]
    look: Any = {"color": VERMILLION, "lw": 1.0, "label": digits.elide(method, 14)}
    if len(at) == 2:
        axes.errorbar(at[0][0], at[1][0], at[1][1], at[0][1], mark, ms=5.0, **look)
    else:
        axes.axhline(at[0][0], ls=":", **look)


def _along(
    name: str, records: Sequence[CurveRecord], group: GroupRecord, unit: Unit
) -> tuple[Floats, tuple[float | None, float | None], str]:
    """(n, 3) medians and intervals of a parameter or of R_max, mean and deviation of the group, the axis's label."""
    if name == "R_max":
        radii = [1e6 * (record.max_radius_m or np.nan) for record in records]
        return np.column_stack([radii] * 3), (None, None), f"{_RMAX} (µm)"
    symbol, factor, written = in_unit(name, unit)
    spread = group.spread(name)
    scaled = [None if value is None else factor * value for value in (spread.mean, spread.std)]
    viscous = name in ("viscosity", AT_RATE)
    values = _ends([one.viscosity if viscous else one.itself.quantity(name) for one in records], factor)
    return values, (scaled[0], scaled[1]), f"{symbol} ({written})" if written else symbol


class _Scale(NamedTuple):
    """SI numbers -> what stands on an axis."""

    origin: float
    factor: float
    label: str

    def __call__(self, values: Floats | None) -> Floats:
        return np.empty(0) if values is None else (values - self.origin) * self.factor


def _scales(curve: RadiusCurve) -> tuple[_Scale, _Scale]:
    """Of time and radius."""
    x, y = _Scale(0.0, 1e6, "time of the recording (µs)"), _Scale(0.0, 1e6, "R (µm)")
    if curve.time_unscaled:
        x = _Scale(0.0, 1.0, "time (no scale)")
    else:
        with suppress(InputError):  # no maximum
            x = _Scale(curve.time_of_max, 1e6, f"time after {_RMAX} (µs)")
    if curve.unscaled:
        y = _Scale(0.0, 1.0 / float(np.nanmax(curve.radius, initial=1e-300)), "R / largest R")
    return x, y


def _view(times: Floats, compared: Floats) -> tuple[float, float]:
    """From the first frame to half a window beyond the window: a long quiet tail would squeeze what was compared."""
    first, last = float(times[0]), float(times[-1])
    if len(compared):
        last = min(last, float(compared[-1] + 0.5 * (compared[-1] - compared[0])))
        first = max(first, float(compared[0] - (compared[-1] - compared[0])))
    margin = 0.015 * (last - first) or 1.0
    return first - margin, last + margin


def _fill(line: Any, x: Floats, y: Floats) -> bool:
    """Whether there is anything to show; fewer dots are larger."""
    line.set_data(x, y)
    count = np.count_nonzero(np.isfinite(y))
    line.set_markersize(np.interp(count, [50, 400], [3.6, 2.0]))
    return bool(count)


def _ends(values: Sequence[Quantity], factor: float = 1.0) -> Floats:
    """(n, 3) medians and intervals; the median thrice where there is none."""
    known = factor * np.array([(value.median, value.q05, value.q95) for value in values], dtype=float).reshape(-1, 3)
    return np.where(np.isnan(known), known[:, :1], known)
