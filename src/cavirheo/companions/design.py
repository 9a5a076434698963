"""Which shot to take next, and how many: what is known of a material and what a rig can do -> design.json.

What is known are ranges, or the answers of a result.json. inference/design.py says what one shot at each setting would
tell; here these are averaged and counted; design_view.py shows them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtri

from cavirheo.arrays import Floats
from cavirheo.companions.designed import CheckedSetting, DesignedSetting
from cavirheo.errors import require
from cavirheo.inference.design import (
    Expected,
    Setting,
    expectations,
    gain,
    reached,
    shared,
    shots_wanted,
    variance,
)
from cavirheo.inference.law import Family
from cavirheo.inference.options import Options
from cavirheo.parameters import STRETCH_RANGE
from cavirheo.physics.bubble import FIELD, Bubble, Requested, bubbles_of
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.reporting.answer import CurveRecord, StoredMedium, described
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result, read_json
from cavirheo.writing import digits
from cavirheo.writing.document import Document, Quantity

STRETCHES = (4.0, 10.0)  # where nothing is known of it
RADII, RATES = (50e-6, 400e-6), (1e5, 2.5e5, 5e5, 1e6)
CHECKED = 10_000  # added to the seed, for recordings of their own
SURE = 2.0  # standard errors, by which a gain must be larger to be
NARROWEST = 0.01  # decades, to which a stretch is known from shot to shot


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
    def said(self) -> list[str]:
        """The next setting, how many shots, and what answers of recordings there say."""
        checked = (_checked_words(self.settings[one.setting], one, self.wanted_percent) for one in self.checked)
        return [*self._said, *checked]

    @property
    def _said(self) -> list[str]:
        setting, best, wanted = (
            self.settings[self.next],
            self.settings[self.best],
            f"± {self.wanted_percent:g} % (90 %)",
        )
        law = " and ".join(_law(best))
        if self.fewest is None:
            line = f"next: {_words(setting)}, where one shot tells most about {law} ({_gain(setting)})"
            return [line, f"no setting reaches ± {self.wanted_percent:g} % with 10,000 shots"]
        if setting.shots == 0:
            by = f" by {digits.counted(self.shots_before, 'shot')}" * bool(self.shots_before)
            return [f"next: nothing, {wanted} is already reached{by}; one shot more tells most at {_words(best)}"]
        more = " more" * bool(self.shots_before)
        lines = [
            f"next: {digits.counted(setting.shots or 0, 'shot')}{more} at {_words(setting)}, for {wanted} of {law}"
        ]
        if best is setting:
            return [*lines, f"one shot there tells most, too ({_gain(best)})"]
        series = "more than 10,000" if best.shots is None else str(best.shots)
        return [
            *lines,
            f"if you take one shot only: {_words(best)}, where it tells most ({_gain(best)}; there {_gain(setting)}); "
            f"{wanted} of {law} would need {series} such shots",
        ]


def design(
    known: Result | str | Path | None = None,
    *,
    group: str | None = None,
    ranges: Mapping[str, Sequence[float]] | None = None,
    material: str = "nhkv",
    bubble: Requested = "real",
    medium: Medium | str = WATER,
    max_radius: Sequence[float] = RADII,
    frame_rate: Sequence[float] = RATES,
    frames: int = 128,
    noise: float | Sequence[float] = 0.0,
    relative_noise: float = 0.01,
    exposure: float = 0.0,
    wanted: float = 0.1,
    spread: float | None = None,
    sizes: int = 5,
    draws: int = 12,
    check: int = 6,
    seed: int = 0,
    workers: int | None = None,
    command: str = "cavirheo.design",
    date: str | None = None,
    done: Callable[[], None] | None = None,
) -> Design:
    """Expected intervals of shots that a rig could take, how many reach a wanted one, and which to take next.

    Args:
        known: a result.json (or its folder's file, or the Result): its trusted answers of this law say where the
            material is. Without it `ranges` do.
        group: whose shots are the material, if the result has several groups.
        ranges: {"shear_modulus": [low, high], "viscosity": ..., "stretch": ...} in SI; a parameter without a range has
            that in which searches start. They go before what `known` says of the stretch.
        material: a law of `cavirheo laws`. bubble: "real", "field" or a `Bubble`; what is free of it is drawn where
            searches start. medium: constants of the liquid or gel, or the name of a set.
        seed: of the draws. workers: threads; default: all cores. command, date: as they stand in the document. done:
            called after each setting.
        max_radius: (low, high) in m; `sizes` radii between them are looked at.
        frame_rate: 1/s, each that the rig has. frames: how many it records.
        noise: m, standard deviation of the radius of a frame, one or one for each frame rate. relative_noise: the same
            over R_max; both add in quadrature. exposure: s, cut to the time between frames.
        wanted: half of the 90 % interval over the value, for each of the law's parameters.
        spread: decades by which shots of one material scatter; default 0, or what the answers of `known` show.
        draws: of what is known, at each setting.
        check: so many recordings of each recommended setting are answered by `infer`; 0 leaves it out.

    Raises:
        InputError: no trusted answer of this law, or a number out of its domain.

    Returns:
        The document that `cavirheo design` writes: a row for every radius and frame rate, SI.

    Source: the information of a simulation about its parameters, docs/method/design.md; how well: benchmarks/design.md.
    """
    family, liquid, bubbles = Family(material), named(medium), bubbles_of(bubble)
    message = f"design is about one bubble, got {', '.join(one.name for one in bubbles)}"
    require(len(bubbles) == 1, message, "option.bubble")
    Options(bubble=bubbles[0])
    require(0 < wanted < 1, f"wanted must be between 0 and 1, got {wanted:g}", "design.wanted")
    require(spread is None or 0 <= spread < 2, f"a spread is 0 to 2 decades, got {spread}", "design.spread")
    require(draws >= 2 and sizes >= 1, "two draws and one R_max are the least", "design.draws")
    require(0 <= check <= draws, f"check is 0 to {draws}, the draws; got {check}", "design.check")
    message = f"R_max must be (low, high) in m with 0 < low <= high, got {tuple(max_radius)}"
    require(len(max_radius) == 2 and 0 < max_radius[0] <= max_radius[1] < np.inf, message, "design.max_radius")
    message = f"frame rates must be positive, got {tuple(frame_rate)}"
    require(len(frame_rate) > 0 and all(rate > 0 for rate in frame_rate), message, "design.frame_rate")
    noises = np.atleast_1d(np.asarray(noise, dtype=float))
    message = f"noise is one number, or one for each of the {len(frame_rate)} frame rates; got {noises.size}"
    require(noises.size in (1, len(frame_rate)), message, "design.noise")
    about = _known(known, group, family, dict(ranges or {}), spread)
    law, stretches = _drawn(about, draws, seed)
    smallest, largest = max_radius
    radii = np.geomspace(smallest, largest, sizes if largest > smallest else 1)
    settings = [
        Setting(float(radius), float(rate), float(off), relative_noise, frames, min(exposure, 1.0 / rate))
        for rate, off in zip(frame_rate, np.broadcast_to(noises, len(frame_rate)), strict=True) for radius in radii
    ]  # fmt: skip
    found = expectations(
        settings, family, law, stretches, liquid, seed=seed, bubble=bubbles[0], workers=workers, done=done
    )
    half = float(np.log10(1.0 + wanted))
    gains = np.array([_gains(one, about) for one in found])
    rows = [_row(*made, family, about, half) for made in zip(settings, found, gains, strict=True)]
    require(any(row.readable for row in rows), "no recording of these settings can be read", "design.unreadable")
    counted = {i: row.shots for i, row in enumerate(rows) if row.shots is not None}
    least = min(counted.values(), default=0)
    drawn = {name: law[:, i] for i, name in enumerate(family.parameters)} | {"stretch": np.log10(stretches)}
    scatter = np.sqrt(np.diag(about.scatter))
    best = max(range(len(rows)), key=lambda i: rows[i].gain_nats)
    fewest = max((i for i in counted if counted[i] == least), key=lambda i: rows[i].gain_nats, default=None)
    if fewest is not None:  # as good within the error of so few draws: then it is also the next one
        less = gains[best] - gains[fewest]
        best = fewest if np.mean(less) <= SURE * _error(less) else best
    checked = []
    for i in dict.fromkeys((best, best if fewest is None else fewest)) if check else ():
        these = law[:check], stretches[:check], liquid
        widths = reached(settings[i], family, *these, seed=seed + CHECKED, bubble=bubbles[0], workers=workers)
        checked.append(_checked(i, check, widths, found[i], family, about, half))
    return Design(
        command=command, date=date, material=material, bubble=bubbles[0], medium=liquid,
        wanted_percent=100.0 * wanted,
        spread_decades=float(np.sqrt(np.mean(scatter**2))),
        spreads_decades=dict(zip(family.parameters, scatter.tolist(), strict=True)),
        known={name: _quantity(values) for name, values in drawn.items()}, shots_before=about.shots, settings=rows,
        best=best, fewest=fewest, checked=checked,
    )  # fmt: skip


class _Known(NamedTuple):
    """Of the material, in log10 of the law's parameters: mean (l,), covariance (l, l), and that of its shots about it
    (l, l). stretch: log10 (low, high), or (mean, deviation) where it is `measured`. shots: that say so."""

    mean: Floats
    covariance: Floats
    scatter: Floats
    stretch: tuple[float, float]
    measured: bool = False
    shots: int = 0


def _row(
    setting: Setting, found: Sequence[Expected | None], gains: Floats, family: Family, known: _Known, half: float
) -> DesignedSetting:
    read = [one for one in found if one is not None]
    share = len(read) / len(found)
    told = [shared(one.information, known.scatter) for one in read]
    half_widths = [one.half_width for one in read] or [np.full(len(known.mean), np.nan)]
    middles = np.median(
        np.array(half_widths)[np.random.default_rng(0).integers(len(half_widths), size=(200, len(half_widths)))], axis=1
    )
    low, high = 100.0 * (10.0 ** np.quantile(middles, (0.16, 0.84), axis=0) - 1.0)
    percent = 100.0 * (10.0 ** np.median(half_widths, axis=0) - 1.0)
    ends = zip(low.tolist(), high.tolist(), strict=True)
    return DesignedSetting(
        max_radius_m=setting.max_radius, frame_rate_hz=setting.frame_rate, frames=setting.frames,
        noise_m=setting.sigma, readable=share,
        half_width_percent=dict(zip(family.parameters, percent, strict=True)),
        half_width_ends_percent=dict(zip(family.parameters, ends, strict=True)),
        shots=_shots(told, share, known, half),
        gain_nats=float(np.mean(gains)), gain_error_nats=_error(gains),
    )  # fmt: skip


def _gains(found: Sequence[Expected | None], known: _Known) -> list[float]:
    """Of each draw; nothing where its recording cannot be read."""
    told = [None if one is None else shared(one.information, known.scatter) for one in found]
    return [0.0 if one is None else gain(one, known.covariance) for one in told]


def _error(values: Floats) -> float:
    """Standard error of the mean."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _shots(told: Sequence[Floats], share: float, known: _Known, half: float) -> int | None:
    """Of the middle draw, where a share of the recordings can be used."""
    counts = [shots_wanted(share * one, known.covariance, half) for one in told]
    middle = np.sort([np.inf if n is None else n for n in counts] or [np.inf])[len(counts) // 2]
    return int(middle) if np.isfinite(middle) else None


def _checked(
    chosen: int,
    recordings: int,
    widths: tuple[Floats, Floats],
    found: Sequence[Expected | None],
    family: Family,
    known: _Known,
    half: float,
) -> CheckedSetting:
    """With the information of `found` scaled by how much wider the answers' intervals are than was expected."""
    answers = len(widths[0])
    told, got = (
        np.exp(np.mean(np.log(each), axis=0)) if answers else np.full(len(known.mean), np.nan) for each in widths
    )
    scaled = [shared(one.information * np.outer(told / got, told / got), known.scatter) for one in found if one]
    percent = (dict(zip(family.parameters, 100.0 * (10.0**each - 1.0), strict=True)) for each in (told, got))
    return CheckedSetting(
        setting=chosen, recordings=recordings, answers=answers, told_percent=next(percent),
        reached_percent=next(percent), shots=_shots(scaled, answers / recordings, known, half) if answers else None,
    )  # fmt: skip


def _known(
    known: Result | str | Path | None,
    group: str | None,
    family: Family,
    ranges: dict[str, Sequence[float]],
    spread: float | None,
) -> _Known:
    unknown = ", ".join(set(ranges) - {*family.parameters, "stretch"})
    has = ", ".join((*family.parameters, "stretch"))
    require(not unknown, f"{family.name} has no {unknown}; known: {has}", "design.range")
    for name, pair in ranges.items():
        message = f"the range of {name} must be [low, high] with 0 < low < high, got {list(pair)}"
        require(len(pair) == 2 and 0 < pair[0] < pair[1] < np.inf, message, "design.range")
        ends = STRETCH_RANGE if name == "stretch" else (0.0, np.inf)
        require(ends[0] < pair[0] and pair[1] < ends[1], f"a stretch is {ends[0]:g} to {ends[1]:g}", "design.range")
    low, high = np.log10(ranges.get("stretch", STRETCHES)).tolist()
    size = len(family.parameters)
    given = None if spread is None else spread**2 * np.eye(size)
    if known is None:
        started = dict(zip(family.parameters, family.bounds(started=True), strict=True))
        logs = np.array([np.log10(ranges[name]) if name in ranges else started[name] for name in family.parameters])
        wide, alike = np.diag(np.ptp(logs, axis=1) ** 2 / 12.0), np.zeros((size, size))
        return _Known(logs.mean(axis=1), wide, alike if given is None else given, (low, high))
    result = known if isinstance(known, Result) else read_json(_file(known))
    chosen, rows = _answers(result, group, family)
    mean, covariance, scatter, shots = _material(chosen, rows, family, given)
    logs = np.log10([row.stretch.median for row in rows if row.stretch.median])
    if "stretch" in ranges or not len(logs):
        return _Known(mean, covariance, scatter, (low, high), shots=shots)
    about = float(np.mean(logs)), max(float(np.std(logs)), NARROWEST)
    return _Known(mean, covariance, scatter, about, True, shots)


def _answers(result: Result, group: str | None, family: Family) -> tuple[GroupRecord, list[CurveRecord]]:
    """The group that is the material, and its trusted answers of this law with intervals."""
    found: list[tuple[GroupRecord, list[CurveRecord]]] = []
    for one, members in result.members():
        rows = [row for row in (result.curves[i] for i in members) if row.trusted and row.material == family.name]
        rows = [row for row in rows if np.all(np.isfinite(row.logs(family.parameters)))]
        found += [(one, rows)] if rows and group in (None, one.name, rows[0].group) else []
    names = ", ".join(one.name for one, _ in found)
    message = f"no trusted answer of {family.name} with an interval among the {len(result.curves)} of the result"
    message += f" in the group {group!r} (groups: {', '.join(one.name for one in result.groups)})" if group else ""
    require(bool(found), message + ": give ranges instead", "design.no_answer")
    message = f"the result has several materials ({names}): name the group of one with --group NAME"
    require(len(found) < 2, message, "design.groups")
    return found[0]


def _material(
    group: GroupRecord, rows: Sequence[CurveRecord], family: Family, scatter: Floats | None
) -> tuple[Floats, Floats, Floats, int]:
    """Mean (l,) and covariance (l, l) of the material, covariance (l, l) of its shots about it, and how many say so: as
    the group's population has them.

    Where there is none (two shots), from the answers: the scatter, if it is not given, is that of the parameter that
    scatters most, beyond what intervals explain (DerSimonian and Laird 1986, doi:10.1016/0197-2456(86)90046-2)."""
    found = group.population
    if found and found.found and found.model.startswith(f"{family.name},"):
        mean, covariance, seen = found.known(family.parameters)
        return mean, covariance, seen if scatter is None else scatter, found.n - len(found.strays)
    logs = np.array([row.logs(family.parameters) for row in rows])  # (shots, l, 3)
    middle, variances = logs[:, :, 1], np.array([variance(ends) for ends in logs])
    if scatter is None:
        weight = 1.0 / variances
        total, mean = weight.sum(axis=0), np.average(middle, axis=0, weights=weight)
        beyond = (weight * (middle - mean) ** 2).sum(axis=0) - (len(rows) - 1)
        room = total - (weight**2).sum(axis=0) / total
        most = np.max(np.divide(beyond, room, out=np.zeros_like(room), where=room > 0).clip(0.0))
        scatter = np.asarray(most * np.eye(middle.shape[1]))
    weight = 1.0 / (variances + np.diag(scatter))
    mean = np.average(middle, axis=0, weights=weight)
    return mean, np.diag(1.0 / weight.sum(axis=0)), scatter, len(rows)


def _drawn(known: _Known, draws: int, seed: int) -> tuple[Floats, Floats]:
    """(draws, l) log10 of the law's and (draws,) stretches: normal points of a Halton sequence, so that few of them
    cover what is known; ranges are drawn evenly."""
    from scipy.stats.qmc import Halton

    cube = Halton(len(known.mean) + 1, seed=seed).random(draws)
    (first, second), normal = known.stretch, known.measured
    deviation = np.sqrt(np.diag(known.covariance))
    law = known.mean + deviation * (ndtri(cube[:, :-1]) if normal else np.sqrt(12.0) * (cube[:, :-1] - 0.5))
    logs = first + second * ndtri(cube[:, -1]) if normal else first + (second - first) * cube[:, -1]
    return law, np.clip(10.0**logs, STRETCH_RANGE[0] * 1.001, STRETCH_RANGE[1] * 0.999)


def _file(path: str | Path) -> Path:
    return Path(path) / "result.json" if Path(path).is_dir() else Path(path)


def _quantity(logs: Floats) -> Quantity:
    low, middle, high = 10.0 ** np.quantile(logs, (0.05, 0.5, 0.95))
    return Quantity(q05=low, median=middle, q95=high)


def _law(setting: DesignedSetting) -> list[str]:
    return [described(name)[0] for name in setting.half_width_percent]


def _gain(setting: DesignedSetting) -> str:
    """'2.10 ± 0.05 nats'."""
    return f"{setting.gain_nats:.2f} ± {setting.gain_error_nats:.2f} nats"


def _words(setting: DesignedSetting) -> str:
    """'R_max 250 µm at 500,000 frames/s'."""
    return f"R_max {digits.micrometres(setting.max_radius_m)} µm at {setting.frame_rate_hz:,.0f} frames/s"


def _checked_words(setting: DesignedSetting, checked: CheckedSetting, wanted: float) -> str:
    """'checked at R_max 250 µm and 500,000 frames/s, 6 recordings: G ± 41 % (expected 33), so 12 shots for ± 10 %'."""
    about = f"checked: {_words(setting)}, {digits.counted(checked.recordings, 'recording')}: "
    if not checked.answers:
        return about + "none has an interval"
    if checked.answers < checked.recordings:
        about += f"{checked.answers} with an interval, "
    pairs = (
        f"{described(name)[0]} ± {width(got)} % (expected {width(checked.told_percent[name])})"
        for name, got in checked.reached_percent.items()
    )
    about += ", ".join(pairs)
    count = "more than 10,000 shots" if checked.shots is None else digits.counted(checked.shots, "shot")
    return about + f"; so {count} for ± {wanted:g} %" * (checked.shots != 0)


def width(percent: float | None) -> str:
    """Of a column in percent."""
    return digits.MISSING if percent is None else "> 300" if percent > 300 else digits.significant(percent, 2)
