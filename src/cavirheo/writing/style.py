"""How all pictures look: size, axes and type; the colours of Okabe and Ito, which colour-blind readers tell apart.

matplotlib is optional (`pip install "cavirheo[plot]"`) and imported when the first figure is made.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, VERMILLION, INK = "#0072b2", "#d55e00", "#444444"
NO_PICTURES = 'pictures are left out: matplotlib is not installed; pip install "cavirheo[plot]"'
_WIDTH = 7.2  # inches
_STEPS = [1, 2, 5, 10]  # of the ticks
_settings = Lock()  # matplotlib reads its settings from a global while it writes


def available() -> bool:
    """Whether pictures can be drawn here."""
    return find_spec("matplotlib") is not None


def need_matplotlib() -> None:
    """Raises InputError without it."""
    if not available():
        raise InputError('pictures need matplotlib: pip install "cavirheo[plot]"', "style.no_matplotlib")


def new_figure(height: float) -> Figure:
    """Raises InputError without matplotlib."""
    need_matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(_WIDTH, height), facecolor="white")


def new_axes(figure: Figure, place: tuple[float, float, float, float], x_label: str, y_label: str) -> Axes:
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_axes(place)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#888888")
    axes.tick_params(labelsize=8.5, labelcolor=INK, color="#888888", length=3)
    axes.set_xlabel(x_label, fontsize=9, color=INK)
    axes.set_ylabel(y_label, fontsize=9, color=INK)
    axes.margins(x=0.02)
    axes.xaxis.set_major_locator(MaxNLocator(8 if place[2] > 0.5 else 5, steps=_STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(6 if place[3] > 0.3 else 4, steps=_STEPS))
    return axes


def write(where: Any, x: float, y: float, text: str, *, size: float, color: str = "#111111", **how: Any) -> None:
    """Text in fractions of a figure or of axes; never read as mathematics, whatever a file calls its curves."""
    place = {"transform": where.transAxes} if hasattr(where, "transAxes") else {}
    where.text(x, y, text, fontsize=size, color=color, parse_math=False, **place, **how)


def save_png(path: str | Path, figure: Figure, dpi: int = 150) -> None:
    """Write the figure as PNG."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.dpi = dpi
    with _settings, matplotlib.rc_context({"text.hinting": "none"}):  # a fifth faster, and nothing shows it
        FigureCanvasAgg(figure).print_png(
            str(path), metadata={"Software": "cavirheo"}, pil_kwargs={"compress_level": 1}
        )


def shades(fractions: Floats | Sequence[float]) -> np.ndarray:
    """(n, 3) from dark blue over grey to yellow: ordered in lightness, so it survives grey printing."""
    stops = np.array([[0, 45, 110], [90, 100, 120], [215, 175, 40]]) / 255.0
    return np.stack([np.interp(fractions, [0.0, 0.5, 1.0], stops[:, k]) for k in range(3)], axis=-1)
