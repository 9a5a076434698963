"""All sweeps of one material: rheometer.json (`Rheometry`) and its tables, and its values beside those of bubbles.

Numbers are SI (a strain of 1 is 100 %) and finite, or null where not found; `message` of a sweep then says why.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from cavirheo.companions.rheometer import Sweep, frequency_sweep, strain_sweep
from cavirheo.reporting.group import Published, PublishedValue
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Spread, spread_of, write_rows
from cavirheo.writing.style import BLUE, INK, VERMILLION, headed, named_curves, plain_ticks, two_panels, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NARROWEST = 5.0  # highest over lowest viscosity of an axis
_MARK: Any = {"ls": "none", "ms": 8, "mew": 1.4, "mec": INK, "mfc": "none", "zorder": 4, "clip_on": False}


class Column(NamedTuple):
    """A number of a sweep in table and picture: words: in a picture, "µ = {} Pa s", or "". field: of the sweep."""

    head: str
    words: str
    field: str
    factor: float = 1.0


class Rheometry(Document):
    """All sweeps of one material, and what was found in them.

    Attributes:
        material: its name.
        tolerance: part of G' by which it may leave its plateau.
        at_rad_per_s: frequency at which mu is taken, rad/s.
        shear_modulus_Pa: G: the plateau of the frequency sweeps; without one, that of the strain sweeps of a solid, Pa.
        shear_modulus_from: where G comes from.
        viscosity_Pa_s: G''/omega at this frequency, Pa s.
        sweeps: those over strain, then those over frequency.
    """

    kind: Literal["rheometer"] = "rheometer"
    material: str
    tolerance: float
    at_rad_per_s: float
    shear_modulus_Pa: Spread
    shear_modulus_from: str
    viscosity_Pa_s: Spread
    sweeps: list[Sweep]

    def of(self, kind: str) -> list[Sweep]:
        return [sweep for sweep in self.sweeps if sweep.kind == kind]

    @property
    def unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of moduli in all tables and pictures of this document."""
        return digits.modulus_unit([sweep.plateau_storage_Pa for sweep in self.sweeps])

    @property
    def published(self) -> Published:
        """As values of another method, which names the regime: a viscosity at this frequency is not a bubble's."""
        strain, frequency = self.of("strain"), self.of("frequency")
        omegas = [end for s in frequency for end in (s.x_from, s.x_to)] or [s.held for s in strain]
        strains = _present(s.held for s in frequency) or _present(s.plateau_to for s in strain)
        deformation = f"strain ≤ {digits.percent(max(strains))} %" if strains else "small strain"
        values = {
            "shear_modulus": self.shear_modulus_Pa,
            f"viscosity_at_{self.at_rad_per_s:g}_rad_per_s": self.viscosity_Pa_s,
        }
        published = {name: PublishedValue(**dict(value)) for name, value in values.items() if value.mean is not None}
        return {f"rheometer, {_span(omegas, 2)} rad/s, {deformation}": published}


def columns_of(document: Rheometry, kind: str) -> list[Column]:
    """What tables and pictures have of the sweeps of a kind."""
    (factor, unit), at = document.unit, f"{document.at_rad_per_s:g} rad/s"
    plateau = Column(f"plateau G'\n{unit}", f"plateau G′ = {{}} {unit}", "plateau_storage_Pa", factor)
    if kind == "strain":
        linear = Column(f"linear, ±{100 * document.tolerance:g} %\n%", "linear to {} %", "plateau_to", 100.0)
        return [linear, plateau, Column("G' = G''\nat %", "G′ = G″ at {} %", "crossover", 100.0)]
    return [
        plateau,
        Column("over\nrad/s", "", "plateau_to"),
        Column("µ = G''/ω\nPa s", f"µ = {{}} Pa s at {at}", "viscosity_Pa_s"),
        Column("tan δ\n", "tan δ = {}", "tan_delta"),
        Column("|η*|\nPa s", "", "complex_viscosity_Pa_s"),
        Column("G' = G''\nat rad/s", "G′ = G″ at {} rad/s", "crossover"),
    ]


def rheometry(
    sweeps: Sequence[Sweep], material: str, tolerance: float = 0.05, at: float = 1.0, **head: Any
) -> Rheometry:
    """The document of these sweeps as they were read; `head`: command, date, notes."""
    strain = [strain_sweep(sweep, tolerance) for sweep in sweeps if sweep.kind == "strain"]
    frequency = [frequency_sweep(sweep, at) for sweep in sweeps if sweep.kind == "frequency"]
    modulus, origin = spread_of([s.plateau_storage_Pa for s in frequency]), "plateau of the frequency sweep"
    if modulus.mean is None:
        solid = [s for s in strain if (s.plateau_storage_Pa or 0.0) > (s.plateau_loss_Pa or 0.0)]
        held = _present(s.held for s in solid)
        modulus = spread_of([s.plateau_storage_Pa for s in solid])
        origin = "plateau of the strain sweep" + (f" at {digits.significant(held[0])} rad/s" if held else "")
    document = Rheometry(
        material=material,
        tolerance=tolerance,
        at_rad_per_s=at,
        shear_modulus_Pa=modulus,
        shear_modulus_from="no plateau" if modulus.mean is None else origin,
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        sweeps=[*strain, *frequency],
        **head,
    )
    limit = min(_present(sweep.plateau_to for sweep in strain if sweep.departs), default=math.inf)
    document.notes += [
        f"{sweep.name} was run at a strain of {digits.percent(sweep.held)} %, beyond the linear range "
        f"(to {digits.percent(limit)} %): its moduli are not those of the linear range"
        for sweep in frequency
        if (sweep.held or 0.0) > limit
    ]
    return document


def write_csv(path: Path, document: Rheometry) -> None:
    """One line per sweep."""
    head = [name for name in Sweep.model_fields if name not in ("x", "storage", "loss", "notes")]
    write_rows(path, head, (sweep.model_dump() for sweep in document.sweeps))


def shared_name(files: Sequence[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def regimes(document: Rheometry, result: Result) -> str:
    """That rheometer and bubbles measure in different regimes, in their own numbers."""
    (method,) = document.published
    counted = [curve for curve in result.curves if curve.trusted]
    rates = _span((curve.strain_rate_per_s for curve in counted), 2)
    stretches = _span((curve.stretch.median for curve in counted), 2)
    return (
        f"The regimes differ: the rheometer measures at {method.removeprefix('rheometer, ')}, the bubble at {rates} "
        f"1/s and λ = {stretches}. G and µ depend on both: unequal values are not a contradiction."
    )


def print_rheometry(document: Rheometry) -> None:
    """The sweeps, the material, the remarks."""
    from rich.text import Text

    console, frequency = terminal.console(), bool(document.of("frequency"))
    for kind in ("strain", "frequency"):
        if not (sweeps := document.of(kind)):
            continue
        columns = columns_of(document, kind)
        table = terminal.table(f"{kind} sweep", [column.head for column in columns])
        for sweep in sweeps:
            table.add_row(sweep.name, *(_cell(sweep, column) for column in columns))
        table.add_section()
        if len(sweeps) > 1:
            means = [spread_of([getattr(sweep, column.field) for sweep in sweeps]) for column in columns]
            texts = [digits.spread(mean, column.factor) for mean, column in zip(means, columns, strict=True)]
            table.add_row("mean ± std", *texts, style="bold")
        console.print(table)
    at = f"{document.at_rad_per_s:g} rad/s"
    answer = f": G = {_with_unit(document.shear_modulus_Pa, *document.unit)} ({document.shear_modulus_from})"
    answer += f", µ = {_with_unit(document.viscosity_Pa_s, 1.0, 'Pa s')} at {at}" * frequency
    console.print(Text.assemble((digits.printable(document.material), "bold"), answer))
    remarks = [(sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes)]
    terminal.print_remarks(console, terminal.by_message(remarks), document.notes)


def _cell(sweep: Sweep, column: Column) -> str:
    """A number, or the ends of the plateau."""
    if column.field != "plateau_to":
        return digits.spread(Spread(mean=getattr(sweep, column.field)), column.factor)
    ends = [column.factor * end for end in _present([sweep.plateau_from, sweep.plateau_to])]
    return _span(ends, to=" to " if sweep.departs or sweep.kind == "frequency" else " to ≥ ")


def _present(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _span(values: Iterable[float | None], count: int = 3, to: str = " to ") -> str:
    """'0.10 to 100', '1.5e5 to 2.5e5', or one number where both ends read the same."""
    finite = _present(values)
    ends = [
        digits.significant(end, count) if end < 1e4 else f"{end:.{count - 1}e}".replace("e+0", "e")
        for end in ([min(finite), max(finite)] if finite else [])
    ]
    return to.join(dict.fromkeys(ends)) or digits.MISSING


def _with_unit(value: Spread, factor: float, unit: str) -> str:
    return digits.spread(value, factor) + ("" if value.mean is None else f" {unit}")


def figure(document: Rheometry, kind: str) -> Figure:
    """Moduli with the range of the plateau that all have; below, how far G' is from its plateau, or G''/omega with the
    viscosity marked. What was not found is not drawn."""
    sweeps, strain, band = document.of(kind), kind == "strain", 100 * document.tolerance
    (factor, unit), scale = document.unit, 100.0 if strain else 1.0

    def column(name: str) -> np.ndarray:
        return np.array([getattr(sweep, name) for sweep in sweeps], dtype=float)

    entries = [entry for entry in columns_of(document, kind) if entry.words]
    means = [(entry, spread_of([getattr(sweep, entry.field) for sweep in sweeps])) for entry in entries]
    answer = [entry.words.format(digits.spread(mean, entry.factor)) for entry, mean in means if mean.mean is not None]
    what = f"{kind} sweep" if len(sweeps) == 1 else f"{len(sweeps)} {kind} sweeps: mean ± std"
    drawing = headed(document.material, what, answer)
    labels = ("strain (%)", "G′ from plateau (%)") if strain else ("angular frequency ω (rad/s)", "G″/ω (Pa s)")
    upper, lower = two_panels(drawing, f"G′, G″ ({unit})", *labels)
    line: Any = {"ms": 4.0 if len(sweeps) == 1 else 3.0, "lw": 0.7}
    for k, (sweep, level) in enumerate(zip(sweeps, column("plateau_storage_Pa"), strict=True)):
        x, names = scale * sweep.x, [None, None] if k else ["G′", "G″"]
        upper.plot(x, factor * sweep.storage, "o-", color=BLUE, label=names[0], **line)
        upper.plot(x, factor * sweep.loss, "o-", color=VERMILLION, mfc="white", mew=0.9, label=names[1], **line)
        y, colour = (100 * (sweep.storage / level - 1), BLUE) if strain else (sweep.loss / sweep.x, VERMILLION)
        lower.plot(x, y, "o-", color=colour, **line | {"ms": 3.2})
    upper.plot(scale * column("crossover"), factor * column("crossover_modulus_Pa"), "D", **_MARK)
    named_curves(upper, 2, columnspacing=1.2, borderaxespad=0.1)
    first, last = scale * np.fmax.reduce(column("plateau_from")), scale * np.fmin.reduce(column("plateau_to"))
    if first < last:
        for axes in (upper, lower):
            axes.axvspan(first, last, color="#00694d", alpha=0.09, lw=0, zorder=0)
        words = ("linear range" if strain else "plateau") + " of all" * (len(sweeps) > 1)
        place: Any = {"transform": upper.get_xaxis_transform(), "ha": "center", "va": "bottom", "fontsize": 8}
        upper.text(np.sqrt(first * last), 1.02, words, color="#00694d", **place)
    upper.loglog()
    lower.semilogx()
    lower.set_xlim(upper.get_xlim())
    if strain:
        lower.axhspan(-band, band, color=BLUE, alpha=0.13, lw=0)
        lower.axhline(0.0, color=INK, lw=0.8)
        lower.set_ylim(-5 * band, 5 * band)
        write(lower, 1.0, 1.06, f"band: ± {band:g} %", size=8, color=INK, ha="right")
    else:
        lower.plot(column("at_rad_per_s"), column("viscosity_Pa_s"), "o", **_MARK)
        lower.set_yscale("log")
        low, high = lower.get_ylim()
        widen = max(np.sqrt(_NARROWEST * low / high), 1.0)  # or noise would fill the panel
        lower.set_ylim(low / widen, high * widen)
    for axis in (upper.xaxis, upper.yaxis, lower.xaxis, *([] if strain else [lower.yaxis])):
        low, high = axis.get_view_interval()
        plain_ticks(axis, (1, 2, 5) if 0 < high < 100 * low else (1,), 9)
    for axes in (upper, lower):
        axes.tick_params(which="minor", color="#bbbbbb", length=2)
    return drawing
