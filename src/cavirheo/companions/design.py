"""Which shot to take next, and how many: what is known of a material and what a rig can do -> design.json.

A material is known by ranges, or by the answers of a result.json. inference/design.py finds what one shot at each
setting would tell; this module averages it, counts the shots that are needed, and prints the design.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from shlex import quote
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats.qmc import Halton

from cavirheo.arrays import NORMAL_90, Floats
from cavirheo.curve import as_numbers
from cavirheo.errors import InputError, as_path, expect, expect_whole, listed, require
from cavirheo.inference.assumptions import AUTO, Family, Options
from cavirheo.inference.design import MOST_SHOTS, Draws, Expectation, Setting, shots_wanted
from cavirheo.parameters import FRAME_RATE, MOST_WIDTH, RADIUS, STRETCH_RANGE, parameter_of, require_name, symbol
from cavirheo.physics.bubble import FIELD, Bubble, Requested, bubble_of
from cavirheo.physics.media import CONSTANTS, WATER, Medium, medium
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result, StoredMedium
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, Quantity, Record, read_json

STRETCHES = (4.0, 10.0)  # range of the stretch if nothing is known about it
SIZES = 5  # number of R_max that are tried
DRAWS = 12  # from what is known, at each setting
EVEN = np.array([-1.0, 1.0]) * np.sqrt(3.0)  # ends of an even distribution, in standard deviations
UNREADABLE = "no recording of these settings can be read: give more frames, another frame rate or another R_max"
LEAST_WIDTH = 0.5  # decades between the ends of what a bound allows
STRETCH_MARGIN = 0.02  # decades beyond the stretches of the shots


@dataclass(frozen=True)
class Rig:
    """What a laboratory can film: its bubbles, its camera, and the material with its medium.

    Attributes:
        max_radius: (low, high) of the bubbles that the laser makes, m.
        frame_rate: all frame rates of the camera, 1/s.
        frames: number of frames that it records.
        noise: standard deviation of the radius of a frame over R_max.
        material: a law of `cavirheo laws`.
        medium: constants of the liquid or gel, or the name of a set of constants; None: those of the shots, or water.
        bubble: "real", "field" or a `Bubble`, whose free parameters are drawn at random.

    Raises:
        InputError: a number out of its domain or no such law, medium or bubble.
    """

    max_radius: Sequence[float] = (50e-6, 400e-6)
    frame_rate: Sequence[float] = (1e5, 2.5e5, 5e5, 1e6)
    frames: int = 128
    noise: float = 0.01
    material: str = "nhkv"
    medium: Medium | str | None = None
    bubble: Requested = "real"

    def __post_init__(self) -> None:
        laws = "design needs one law, such as nhkv, newtonian, power-law or fung + newtonian: auto chooses among these"
        require(self.material != AUTO, laws, "design.auto")
        Family(self.material)
        medium(WATER if self.medium is None else self.medium)
        Options(bubble=bubble_of(self.bubble))
        radii, rates = as_numbers("max_radius", self.max_radius), as_numbers("frame_rate", self.frame_rate)
        require(radii.shape == (2,), f"R_max must be (low, high) in m, got {self.max_radius}", "design.max_radius")
        ends = f"{1e6 * radii[0]:.6g} to {1e6 * radii[1]:.6g} um"
        require(radii[0] <= radii[1], f"R_max goes from low to high, got {ends}", "design.max_radius")
        if rates.ndim != 1 or not rates.size:
            message = f"give a list of one or more frame rates, frame_rate=[1e6] in 1/s, got {self.frame_rate}"
            raise InputError(message, "design.frame_rate")
        for radius in radii.tolist():
            RADIUS.check("the R_max of the rig", radius, "design.max_radius")
        for rate in rates.tolist():
            FRAME_RATE.check("the frame rate of the rig", rate, "design.frame_rate")
        expect(self.noise, Real, "the noise over R_max, noise=0.01")
        if not 0 < self.noise < 0.5:
            raise InputError(f"noise must be above 0 and below half of R_max, got {self.noise:g} of it", "design.noise")
        expect_whole(self.frames, "frames", 10, "design.frames")

    def settings(self) -> list[Setting]:
        """Each frame rate with each R_max."""
        smallest, largest = self.max_radius
        radii = np.geomspace(smallest, largest, SIZES if largest > smallest else 1).tolist()
        return [Setting(R, float(rate), self.noise * R, self.frames) for rate in self.frame_rate for R in radii]


class DesignedSetting(Record):
    """The expected result of a shot at one setting, over draws of the parameters from what is known."""

    max_radius_m: float
    """R_max, m."""
    frame_rate_hz: float
    """Frame rate, 1/s."""
    frames: int
    """Number of frames in a recording."""
    noise_m: float
    """Standard deviation of the radius of a frame, m."""
    readable: float
    """Share of the simulated recordings that can be read, 0 to 1."""
    half_width_percent: dict[str, Finite]
    """Half of the 90 % interval of one shot, % of the value, by parameter; median over the draws."""
    shots: int | None
    """Number of shots that bring all parameters to the wanted interval; null: more than 10,000."""

    @property
    def words(self) -> str:
        """'R_max 250 µm at 500,000 frames/s'."""
        return f"R_max {digits.micrometres(self.max_radius_m)} µm at {self.frame_rate_hz:,.0f} frames/s"


class Design(Document):
    """The settings that a rig can film, and the setting and number of the next shots."""

    kind: Literal["design"] = "design"
    material: str
    """Name of the law."""
    bubble: Bubble = FIELD
    """Model of the bubble."""
    medium: StoredMedium | None = None
    """Constants of the surrounding medium and of the bubble's contents, SI; null in a document of an older version."""
    wanted_percent: float
    """Wanted half of the 90 % interval, % of the value."""
    spreads_decades: dict[str, float] = {}
    """Standard deviation from shot to shot in each parameter, decades (log10)."""
    known: dict[str, Quantity]
    """Quantiles of the parameters and the stretch before the next shot, SI."""
    shots_before: int = 0
    """Number of answers of the result.json on which this is based."""
    settings: list[DesignedSetting]
    """Expected result at each frame rate and R_max."""
    next: int
    """Index, from 0, of the setting to take next: it reaches the wanted interval with the fewest shots or, if none
    reaches it, has the narrowest intervals."""

    @property
    def sentences(self) -> list[str]:
        """Lines of text on the next setting, and the number of shots."""
        setting, goal = self.settings[self.next], f"± {self.wanted_percent:g} % (90 %)"
        law = " and ".join(digits.shown(name).symbol for name in setting.half_width_percent)
        if setting.shots is None:
            line = f"next: no setting reaches {goal} of {law} with {MOST_SHOTS:,} shots"
            return [line, f"the narrowest intervals are expected with {setting.words}"]
        if setting.shots == 0:
            by = f" by {digits.counted(self.shots_before, 'shot')}" if self.shots_before else ""
            return [f"next: nothing, {goal} is already reached{by}"]
        more = " more" if self.shots_before else ""
        return [f"next: {digits.counted(setting.shots, 'shot')}{more} at {setting.words}, for {goal} of {law}"]


def print_table(document: Design) -> None:
    """Print a line per setting, then the recommended setting and the number of shots."""

    def half_width(percent: float | None) -> str:  # that of a bound, with ends that are far apart, is no number
        if percent is None:
            return digits.MISSING
        return "bound" if percent > 100.0 * (np.sqrt(MOST_WIDTH) - 1.0) else digits.number(percent, count=2)

    symbols = [digits.shown(name).symbol for name in document.settings[0].half_width_percent]
    heads = ["R_max\nµm", "frames/s", *(f"{symbol}\n± %" for symbol in symbols), "readable\n%", "shots"]
    title = f"{document.material}: expected 90 % interval of one shot, and shots for ± {document.wanted_percent:g} %"
    rows = [
        [
            digits.micrometres(setting.max_radius_m),
            f"{setting.frame_rate_hz:,.0f}",
            *map(half_width, setting.half_width_percent.values()),
            f"{100 * setting.readable:.0f}",
            digits.MISSING if setting.shots is None else str(setting.shots),
        ]
        for setting in document.settings
    ]
    terminal.print_table(heads, rows, title=title, bold=document.next)
    terminal.print_remarks({}, document.notes)
    for line in document.sentences:
        terminal.print_text(line, style="bold")


def design(
    known: Result | str | Path | None = None,
    rig: Rig | None = None,
    *,
    group: str | None = None,
    ranges: Mapping[str, Sequence[float]] | None = None,
    wanted: float = 0.1,
    seed: int = 0,
    done: Callable[[], None] | None = None,
) -> Design:
    """Expected intervals of shots that a rig could take, the shots needed for a wanted interval, and the next setting,
    by the information of emulated recordings (docs/how-to/design.md; accuracy: docs/validation.md).

    Args:
        known: a result.json, its folder, or the `Result`. Its trusted answers of this law give the law's parameters;
            without it `ranges` do.
        rig: what can be filmed; default: `Rig()`.
        group: name of the group whose shots are of the material, if the result has several groups.
        ranges: {"G": [low, high], "mu": ..., "lambda": ...} in SI, within those that `infer` searches; default: those
            in which searches start, and 4 to 10 for the stretch. With `known` only that of the stretch may be given.
        wanted: half of the 90 % interval over the value, for each of the law's parameters.
        seed: of the draws from what is known. done: called after each shot.

    Raises:
        InputError: no trusted answer of this law, a number out of its domain, or a bubble unknown to the emulator.

    Returns:
        The document that `cavirheo design` writes: a row for every radius and frame rate, SI.
    """
    expect(wanted, Real, "the wanted half of an interval over the value, such as 0.1")
    require(0 < wanted < 1, f"wanted must be between 0 and 1, got {wanted:g}", "design.wanted")
    expect_whole(seed, "seed", 0, "option.seed")
    rig = rig or Rig()
    expect(rig, Rig, "a Rig such as Rig(frames=128), or none")
    family = Family(rig.material)
    before = _known(known, group, family, _log_ranges(family, ranges or {}))
    low, high = np.transpose(list(before.ends.values()))
    logs = low + (high - low) * Halton(len(low), seed=seed).random(DRAWS)  # few of its points cover the ranges
    liquid = medium(rig.medium or (before.media or [WATER])[0])
    shots = Draws(family, logs[:, :-1], 10.0 ** logs[:, -1], liquid, bubble_of(rig.bubble), seed)
    covariance, scatter = np.diag((high - low)[:-1] ** 2 / 12.0), np.diag(before.spreads**2)
    settings, rows = rig.settings(), []
    for setting, expected in zip(settings, shots.expectations(settings, done), strict=True):
        needed = shots_wanted(expected, covariance, scatter, np.log10(1.0 + wanted))
        rows.append(_row(setting, expected, family.parameters, needed))
    require(any(row.readable for row in rows), UNREADABLE, "design.unreadable")
    quantiles = 10.0 ** np.quantile(logs, (0.05, 0.5, 0.95), axis=0)
    return Design(
        command="cavirheo.design",
        notes=[*before.notes, *_differences(liquid, before.media)],
        material=rig.material,
        bubble=shots.bubble,
        medium=liquid,
        wanted_percent=100.0 * wanted,
        spreads_decades=dict(zip(family.parameters, before.spreads.tolist(), strict=True)),
        known={name: Quantity.from_interval(*three) for name, three in zip(before.ends, quantiles.T, strict=True)},
        shots_before=before.shots,
        settings=rows,
        next=min(range(len(rows)), key=lambda k: _effort(rows[k])),
    )


def _differences(liquid: Medium, media: Sequence[Medium]) -> list[str]:
    """A note if the medium of a design is not that of the shots."""
    names = [name for name in CONSTANTS if any(getattr(one, name) != getattr(liquid, name) for one in media)]
    return [f"the medium of this design differs from that of the shots in {listed(names)}"] if names else []


def _row(setting: Setting, expected: Sequence[Expectation | None], names: Sequence[str], shots: int) -> DesignedSetting:
    """The row of a setting, in which so many shots are needed. A recording that cannot be read has no half-width."""
    widths = [shot.half_width for shot in expected if shot is not None]
    decades = np.median(widths or [np.full(len(names), np.nan)], axis=0)
    return DesignedSetting(
        max_radius_m=setting.max_radius,
        frame_rate_hz=setting.frame_rate,
        frames=setting.frames,
        noise_m=setting.noise,
        readable=len(widths) / len(expected),
        half_width_percent=dict(zip(names, 100.0 * (10.0**decades - 1.0), strict=True)),
        shots=shots if shots <= MOST_SHOTS else None,
    )


def _effort(row: DesignedSetting) -> tuple[float, float]:
    """By which settings are compared: the number of shots, then the widest interval."""
    widths = (np.inf if width is None else width for width in row.half_width_percent.values())
    return np.inf if row.shots is None else row.shots, max(widths)


def _log_ranges(family: Family, ranges: Mapping[str, Sequence[float]]) -> dict[str, Floats]:
    """log10 of the ends of ranges, by name. Raises InputError: no such parameter, or a range that is not searched."""
    expect(ranges, Mapping, "ranges by parameter, such as {'G': [1e3, 1e4]}")
    ends = {}
    for text, pair in ranges.items():
        name = require_name(text, (*family.parameters, "stretch"), family.name, "design.range")
        if name in ends:
            raise InputError(f"the range of {name} is given twice", "design.range")
        low, high = np.round(10.0 ** np.array(parameter_of(name).search_range), 12)
        values = as_numbers("ranges", pair)
        if values.shape != (2,) or not low <= values[0] < values[1] <= high:
            expected = f"must be [low, high] with {low:g} <= low < high <= {high:g}, where `infer` searches"
            raise InputError(f"the range of {name} {expected}, got {pair}", "design.range")
        ends[name] = np.log10(values)
    return ends


class Known(NamedTuple):
    """What is known of a material. ends: log10 of the ends of an even distribution of each parameter of the law, then
    of the stretch. spreads: (l,) standard deviation of the shots about the material, decades. shots: on which this is
    based. notes: what was taken for bounds, and why this is doubtful. media: of the shots."""

    ends: dict[str, Floats]
    spreads: Floats
    shots: int
    notes: Sequence[str] = ()
    media: Sequence[Medium] = ()


def _known(known: Result | str | Path | None, group: str | None, family: Family, given: dict[str, Floats]) -> Known:
    """What is known by given and usual ranges; or by the answer of a group of a result, and the given range of the
    stretch. Raises InputError: no group has an answer by this law or the default model, with intervals or bounds of all
    parameters of the law; or several have."""
    if known is None:
        message = "group names one of a result: give the result.json, or leave out group (--group)"
        require(group is None, message, "design.group")
        usual = dict(zip(family.parameters, family.bounds(started=True), strict=True))
        return Known(usual | {"stretch": np.log10(STRETCHES)} | given, np.zeros(len(usual)), 0)
    if of_law := [name for name in given if name != "stretch"]:
        message = f"a result and a range of {listed(of_law)}: give one of them; both say what is known"
        raise InputError(message, "design.range")
    if not isinstance(known, Result):
        path = as_path(known)
        known = read_json(path / "result.json" if path.is_dir() else path, lambda _: Result)
    groups = [(record, _of_group(record, rows, family)) for record, rows in known.rows_by_group()]
    usable = {record.name: one for record, one in groups if one}
    chosen = [one for name, one in usable.items() if group in (None, name)]
    if len(chosen) == 1:
        return chosen[0]._replace(ends=chosen[0].ends | given)
    asked = [record for record, _ in groups if group in (None, record.name)]
    if usable and (chosen or not asked):
        names = listed(map(quote, usable), 12)
        message = f"a design is for one material of the result: add --group with one of {names}; in Python group="
        raise InputError(message, "design.groups")
    wanted = f"{family.name} with intervals of {listed(map(symbol, family.parameters))}"
    found = "; ".join(f"{record.name}: {record.population.model or 'none'}" for record, _ in groups)
    others = {record.population.laws[0] for record in asked if record.has_answer} - {family.name, AUTO}
    instead = " or ".join([*(f"--material {law}" for law in sorted(others)), "ranges without the result"])
    message = f"no answer of {wanted} for {group or 'any group'} ({found}): give {instead}"
    raise InputError(message, "design.no_answer")


def _of_group(record: GroupRecord, rows: Sequence[CurveRecord], family: Family) -> Known | None:
    """What the answer of a group says. None: it is by another law, or lacks an interval."""
    answer, ends, notes = record.population, dict[str, Floats](), list[str]()
    if {family.name, AUTO}.isdisjoint(answer.laws):
        return None
    for name, *ranges in zip(family.parameters, family.bounds(), family.bounds(started=True), strict=True):
        value = answer.value(name)
        ends[name] = _ends_of(value, *ranges)
        if value.bound in ("upper", "lower", "undetermined"):
            taken = 10.0 ** ends[name]
            shown = digits.shown(name, taken[1])
            drawn = f"{digits.ends(taken, shown.factor, 2)} {shown.unit}".rstrip()
            notes.append(f"{shown.named(value)}: this design draws it from {drawn}")
    if not np.all(np.isfinite([*ends.values()])):
        return None
    stretches = np.log10([row.stretch.median for row in rows if row.stretch.median] or STRETCHES)
    around = [stretches.min() - STRETCH_MARGIN, stretches.max() + STRETCH_MARGIN]
    ends["stretch"] = np.clip(around, *np.log10(STRETCH_RANGE))
    spreads = np.array([answer.spreads_decades.get(name, Quantity()).median or 0.0 for name in family.parameters])
    notes += [f"{record.name} is in doubt: {doubt.text}" for doubt in record.doubts]
    media = [row.medium for row in rows if row.medium]
    return Known(ends, spreads, answer.n - len(answer.outliers), notes, media)


def _ends_of(value: Quantity, searched: Floats, started: Floats) -> Floats:
    """log10 of the ends of an even distribution as wide as the interval of a value, within the range that is searched.
    The open side of a bound ends where searches start, a decade from its limit at least. NaN where there is neither, or
    where none of it is within the range."""
    low, high = (np.log10(end or np.nan) for end in (value.q05, value.q95))
    bottom, top = searched
    if value.bound == "undetermined":
        return started
    if value.bound == "upper":
        low, high = np.minimum(started[0], high - 1.0), np.maximum(high, bottom + LEAST_WIDTH)
    elif value.bound == "lower":
        low, high = np.minimum(low, top - LEAST_WIDTH), np.maximum(started[1], low + 1.0)
    else:
        middle = 0.5 * (low + high) if value.bound == "wide" else np.log10(value.median or np.nan)
        low, high = middle + EVEN * (high - low) / (2.0 * NORMAL_90)
    ends = np.clip([low, high], bottom, top)
    return ends if ends[0] < ends[1] else np.full(2, np.nan)
