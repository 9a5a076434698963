"""Which shot to take next, and how many: design.json (`Design`), what it says, its table and its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.reporting.answer import StoredMedium
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, Quantity, Record
from cavirheo.writing.style import INK, new_axes, new_figure, plain_ticks, shades, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LARGEST_RATIO = 100.0  # of the smallest: what is above is of no use


class DesignedSetting(Record):
    """What a shot at one setting would tell, over the draws of what is known.

    Attributes:
        max_radius_m: R_max, m.
        frame_rate_hz: frames per second.
        frames: in a recording.
        noise_m: standard deviation of a radius, m.
        readable: share of recordings that can be read.
        half_width_percent: by parameter, half of the 90 % interval of one shot over the median, that of the middle
            draw.
        half_width_ends_percent: by parameter, between which the middle draw is with 68 % for so few draws (bootstrap).
        shots: how many bring all parameters to what is wanted; null: more than 10,000.
        gain_nats: expected information gain of one shot about the law's parameters, mean over the draws.
        gain_error_nats: its standard error.
    """

    max_radius_m: float
    frame_rate_hz: float
    frames: int
    noise_m: float
    readable: float
    half_width_percent: dict[str, Finite]
    half_width_ends_percent: dict[str, tuple[Finite, Finite]] = {}
    shots: int | None
    gain_nats: float
    gain_error_nats: float = 0.0

    @property
    def words(self) -> str:
        """'R_max 250 µm at 500,000 frames/s'."""
        return f"R_max {digits.micrometres(self.max_radius_m)} µm at {self.frame_rate_hz:,.0f} frames/s"

    @property
    def gain(self) -> str:
        """'2.10 ± 0.05 nats'."""
        return f"{self.gain_nats:.2f} ± {self.gain_error_nats:.2f} nats"


class CheckedSetting(Record):
    """What `infer` gives at a recommended setting.

    Attributes:
        setting: index in `settings`.
        recordings: how many were simulated.
        answers: how many of them were answered with an interval.
        told_percent: by parameter, half of the 90 % interval over the median as expected, geometric mean.
        reached_percent: the same as answered.
        shots: as in `settings`, with the information that was reached.
    """

    setting: int
    recordings: int
    answers: int
    told_percent: dict[str, Finite]
    reached_percent: dict[str, Finite]
    shots: int | None


class Design(Document):
    """Which shot to take next, and how many.

    Attributes:
        material: the law.
        bubble: what is assumed of the bubble.
        medium: the constants of what surrounds it, SI; null in a document of an older version.
        wanted_percent: half of the 90 % interval over the median that is wanted.
        spread_decades: scatter from shot to shot, root mean square over the parameters, in log10.
        spreads_decades: that of each parameter.
        known: what is known of the parameters and the stretch before, SI.
        shots_before: answers of the result.json that this rests on.
        settings: one for each R_max and frame rate.
        best: index of the setting with the largest gain: where one shot tells most.
        fewest: index of the setting with the fewest shots, which is to be taken next; null where none reaches what is
            wanted.
        checked: recordings simulated there and answered, if that was asked for.
    """

    kind: Literal["design"] = "design"
    material: str
    bubble: Bubble = FIELD
    medium: StoredMedium | None = None
    wanted_percent: float
    spread_decades: float
    spreads_decades: dict[str, float] = {}
    known: dict[str, Quantity]
    shots_before: int = 0
    settings: list[DesignedSetting]
    best: int
    fewest: int | None
    checked: list[CheckedSetting] = []

    @property
    def next(self) -> int:
        """Index of the setting to take next: where what is wanted needs the fewest shots; where none reaches it, where
        one shot tells most."""
        return self.best if self.fewest is None else self.fewest

    @property
    def sentences(self) -> list[str]:
        """The next setting, how many shots, and what answers of recordings there say."""
        setting, best = self.settings[self.next], self.settings[self.best]
        goal = f"± {self.wanted_percent:g} % (90 %)"
        law = " and ".join(digits.described(name)[0] for name in best.half_width_percent)
        if self.fewest is None:
            lines = [
                f"next: {setting.words}, where one shot tells most about {law} ({setting.gain})",
                f"no setting reaches ± {self.wanted_percent:g} % with 10,000 shots",
            ]
        elif setting.shots == 0:
            by = f" by {digits.counted(self.shots_before, 'shot')}" * bool(self.shots_before)
            lines = [f"next: nothing, {goal} is already reached{by}; one shot more tells most at {best.words}"]
        else:
            more = " more" * bool(self.shots_before)
            shots, series = digits.counted(setting.shots or 0, "shot"), best.shots or "more than 10,000"
            single = (
                f"if you take one shot only: {best.words}, where it tells most ({best.gain}; there {setting.gain}); "
            )
            single += f"{goal} of {law} would need {series} such shots"
            lines = [
                f"next: {shots}{more} at {setting.words}, for {goal} of {law}",
                f"one shot there tells most, too ({best.gain})" if best is setting else single,
            ]
        return [*lines, *(self._words(checked) for checked in self.checked)]

    def _words(self, checked: CheckedSetting) -> str:
        """'checked: R_max 250 µm at 500,000 frames/s, 6 recordings: G ± 41 % (expected 33); so 12 shots for ± 10 %'."""
        text = f"checked: {self.settings[checked.setting].words}, {digits.counted(checked.recordings, 'recording')}: "
        if not checked.answers:
            return text + "none has an interval"
        text += f"{checked.answers} with an interval, " * (checked.answers < checked.recordings)
        text += ", ".join(
            f"{digits.described(name)[0]} ± {width(got)} % (expected {width(checked.told_percent[name])})"
            for name, got in checked.reached_percent.items()
        )
        count = "more than 10,000 shots" if checked.shots is None else digits.counted(checked.shots, "shot")
        return text + f"; so {count} for ± {self.wanted_percent:g} %" * (checked.shots != 0)


def width(percent: float | None) -> str:
    """Of a column in percent."""
    return digits.MISSING if percent is None else "> 300" if percent > 300 else digits.significant(percent, 2)


def print_table(document: Design) -> None:
    """A line per setting, then the next one and the number of shots."""
    from rich.text import Text

    console, names = terminal.console(), list(document.settings[0].half_width_percent)
    heads = ["frames/s", *(f"{digits.described(name)[0]}\n± %" for name in names), "readable\n%", "shots", "gain\nnats"]
    title = f"{document.material}: expected 90 % interval of one shot, and shots for ± {document.wanted_percent:g} %"
    table = terminal.table("R_max\nµm", heads, title=title)
    for k, setting in enumerate(document.settings):
        shots = digits.MISSING if setting.shots is None else str(setting.shots)
        row = [f"{setting.frame_rate_hz:,.0f}", *(width(setting.half_width_percent[name]) for name in names)]
        row += [f"{100 * setting.readable:.0f}", shots, f"{setting.gain_nats:.2f}"]
        style = "bold" if k in (document.best, document.fewest) else ""
        table.add_row(digits.micrometres(setting.max_radius_m), *row, style=style)
    console.print(table)
    for line in document.sentences:
        console.print(Text(line, "bold"))


def picture(document: Design) -> Figure:
    """The shots that are wanted, and the half-width of each parameter, over R_max and frame rate; the next setting is
    ringed. Bars: the error of so few draws."""
    names, settings = list(document.settings[0].half_width_percent), document.settings
    word = "already reached" if any(setting.shots == 0 for setting in settings) else "reached by no setting"
    panels: list[tuple[str, list[Any], list[Any], str]] = [  # title, values, their ends, the word without any
        (
            f"{digits.described(name)[0]}: ± % of one shot",
            [setting.half_width_percent[name] for setting in settings],
            [setting.half_width_ends_percent.get(name, (None, None)) for setting in settings],
            "none",
        )
        for name in names
    ]
    no_ends = [(None, None)] * len(settings)
    shots = [setting.shots for setting in settings]
    panels.append((f"shots for ± {document.wanted_percent:g} %", shots, no_ends, word))
    figure, wide = new_figure(3.0), 0.86 / len(panels)
    write(figure, 0.07, 0.93, f"{document.material}: which shot next", size=11, weight="bold")
    write(figure, 0.07, 0.865, digits.elide(document.sentences[0], 110), size=8.5, color=INK)
    for k, (title, values, ends, empty) in enumerate(panels):
        axes = new_axes(figure, (0.07 + k * wide, 0.16, wide - 0.06, 0.58), "R_max (µm)", "")
        axes.set_title(title, fontsize=9, color=INK, loc="left")
        _draw(axes, document, values, ends)
        if not (finite := [value for value in values if value]):
            axes.set(xticks=[], yticks=[], xlabel="")
            write(axes, 0.5, 0.5, empty, size=9, color=INK, ha="center", va="center")
            continue
        axes.set(xscale="log", yscale="log")
        axes.margins(x=0.08)  # of a ring
        axes.set_ylim(0.7 * min(finite), min(1.4 * max(finite), LARGEST_RATIO * min(finite)))
        for axis in (axes.xaxis, axes.yaxis):
            plain_ticks(axis, (1, 2, 5))
        axes.minorticks_off()
    axes.legend(frameon=False, fontsize=7.5, loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)
    return figure


def _draw(axes: Axes, document: Design, values: list[Any], ends: list[Any]) -> None:
    """A line of each frame rate."""
    settings = document.settings
    rates = sorted({setting.frame_rate_hz for setting in settings})
    for rate, tone in zip(rates, shades(np.linspace(0.0, 1.0, len(rates))), strict=True):
        at = [i for i, setting in enumerate(settings) if setting.frame_rate_hz == rate and values[i]]
        x = [1e6 * settings[i].max_radius_m for i in at]
        axes.plot(x, [values[i] for i in at], "o-", color=tone, ms=4, lw=1.3, label=f"{1e-3 * rate:g} kfps")
        low, high = np.array([ends[i] for i in at], dtype=float).reshape(-1, 2).T
        axes.vlines(x, low, high, color=tone, lw=0.9)
    if values[document.next]:
        radius = 1e6 * settings[document.next].max_radius_m
        axes.plot(radius, values[document.next], "o", ms=10, mfc="none", mec="black")
