"""Style of all pictures: size, axes and type; the colours of Okabe and Ito, distinct also for colour-blind readers.

matplotlib is optional (`pip install "cavirheo[plot]"`) and imported when the first figure is made.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, VERMILLION, INK, BLACK, PALE = "#0072b2", "#d55e00", "#444444", "#222222", "#888888"
DPI = 150  # of PNG files
_settings = Lock()  # matplotlib reads its settings from a global while it draws
# If matplotlib cannot write its folder, it takes a temporary one; its log messages on this are not shown.
_HIDDEN_LOG_MESSAGES = ("mkdir -p failed for path", "%s is not a writable directory", "Matplotlib created a temporary")
logging.getLogger("matplotlib").addFilter(lambda record: not str(record.msg).startswith(_HIDDEN_LOG_MESSAGES))


def available() -> bool:
    """Whether matplotlib is installed, so that pictures can be drawn."""
    return find_spec("matplotlib") is not None


def new_figure(height: float, width: float = 7.2) -> Figure:
    """A new figure of this height and width in inches. Raises InputError without matplotlib."""
    require(available(), 'pictures need matplotlib: pip install "cavirheo[plot]"', "style.no_matplotlib")
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), facecolor="white")


def new_axes(figure: Figure, place: tuple[float, float, float, float], x_label: str, y_label: str) -> Axes:
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_axes(place)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(PALE)
    axes.tick_params(labelsize=8.5, labelcolor=INK, color=PALE, length=3)
    axes.set_xlabel(x_label, fontsize=9, color=INK)
    axes.set_ylabel(y_label, fontsize=9, color=INK)
    axes.margins(x=0.02)
    for axis, most in ((axes.xaxis, 8 if place[2] > 0.5 else 5), (axes.yaxis, 6 if place[3] > 0.3 else 4)):
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
    return axes


def save(path: str | Path, figure: Figure, kind: str = "png", dpi: int = DPI) -> None:
    """Save a figure as "png", "svg" or "pdf", with text kept as text, and the same bytes each time."""
    import matplotlib

    settings: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "cavirheo"}
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}
    with _settings, matplotlib.rc_context(settings), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # letters that the font lacks: they are drawn as boxes
        figure.savefig(path, format=kind, dpi=dpi, metadata=undated[kind])


def tone_colours(fractions: Floats | Sequence[float]) -> np.ndarray:
    """Colours (n, 3) from dark blue over grey to yellow, ordered in lightness, so that grey prints keep the order."""
    stops = np.array([[0, 45, 110], [90, 100, 120], [215, 175, 40]]) / 255.0
    return np.stack([np.interp(fractions, [0.0, 0.5, 1.0], stops[:, k]) for k in range(3)], axis=-1)
