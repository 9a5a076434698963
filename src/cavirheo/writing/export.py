"""Export of columns and draws as objects of pandas and ArviZ; pictures of draws and of intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.writing import digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cavirheo.writing.document import Quantity


def import_optional(name: str) -> Any:
    """Import the library of this name. Raises InputError: it is not installed."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0] == name  # the library itself, and not one that it needs
        require(not missing, f"this needs {name}: pip install {name}", "posterior.missing_library")
        raise


def dataframe(columns: Mapping[str, Any], attributes: Mapping[str, Any]) -> Any:
    """A pandas.DataFrame of columns of one length, with `attributes` as its attrs. Raises InputError without pandas."""
    frame = import_optional("pandas").DataFrame(dict(columns))
    frame.attrs = dict(attributes)
    return frame


def inference_data(
    groups: Mapping[str, Mapping[str, Floats]], units: Mapping[str, str], attributes: Mapping[str, str]
) -> Any:
    """Arrays (draws,) of each group as arviz.InferenceData (ArviZ below 1) or xarray.DataTree (from 1 on), one chain.

    Raises InputError without arviz."""
    arviz, xarray = import_optional("arviz"), import_optional("xarray")
    sets = {}
    for group, values in groups.items():
        places = {"chain": [0], "draw": np.arange(len(next(iter(values.values()))))}
        sets[group] = xarray.Dataset(coords=places, attrs=dict(attributes))
        for name, draws in values.items():
            sets[group][name] = (tuple(places), draws[None, :], {"units": units.get(name, "1")})
    tree: Any = getattr(xarray, "DataTree", None)
    kind: Any = getattr(arviz, "InferenceData", tree)
    return tree.from_dict(sets) if kind is tree else kind(**sets)  # from ArviZ 1 on, InferenceData is DataTree


def corner_plot(draws: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the draws (k,) of each parameter, by natural name in SI, with median and central 90 %, and of each pair
    of parameters, where a larger point has more weight (k,). Raises InputError without matplotlib."""
    from cavirheo.writing import style

    count = len(draws)
    size = 2.1 * count + 0.8
    figure = style.new_figure(size, size)
    areas = 12.0 * min(1.0, 500.0 / len(weights)) * weights / np.mean(weights)
    shown = [_shown(name, values, weights) for name, values in draws.items()]
    for row, (label, values, ends, words) in enumerate(shown):
        for column, (across, others, other_ends, _) in enumerate(shown[: row + 1]):
            corner = (0.7 + 2.1 * column) / size, (0.5 + 2.1 * (count - 1 - row)) / size
            place = (*corner, 1.8 / size, 1.75 / size)
            labels = across if row == count - 1 else "", label if column == 0 < row else ""
            axes = style.new_axes(figure, place, *labels)
            axes.tick_params(labelbottom=row == count - 1, labelleft=column == 0 < row)
            axes.locator_params(axis="x", nbins=3)
            axes.set_xlim(*other_ends)
            if column < row:
                axes.scatter(others, values, areas, color=style.BLUE, alpha=0.4, lw=0)
                axes.set_ylim(*ends)
                continue
            axes.hist(values, bins=24, range=ends, weights=weights, color=style.BLUE, alpha=0.4)
            axes.set_yticks([])
            axes.set_title(words, fontsize=9, color=style.INK)
            for quantile in np.quantile(values, [0.05, 0.5, 0.95], weights=weights, method="inverted_cdf"):
                axes.axvline(quantile, color=style.INK, lw=0.8, ls="--")
    return figure


def _shown(name: str, draws: Floats, weights: Floats) -> tuple[str, Floats, tuple[float, float], str]:
    """(label of the axis, draws in the unit of the axis, ends of the axis, median and 90 % interval in words)."""
    from cavirheo.writing.document import Quantity

    levels = [0.002, 0.05, 0.5, 0.95, 0.998]
    low, q05, middle, q95, high = np.quantile(draws, levels, weights=weights, method="inverted_cdf").tolist()
    factor, label = _axis(name, middle)
    margin = max(0.04 * (high - low), 1e-9 * abs(high), 1e-300)  # above 0, even if all draws are equal
    words = digits.quantity(Quantity(median=middle, q05=q05, q95=q95), factor)
    return label, factor * draws, (factor * (low - margin), factor * (high + margin)), f"{label.split()[0]} {words}"


def _axis(name: str, value: float | None) -> tuple[float, str]:
    """(factor from SI to the unit of an axis, its label 'G (kPa)') for values of a parameter of this size, SI."""
    own, unit = digits.symbol_and_unit(name)
    factor, unit = digits.unit_for(unit or "1", value)
    return factor, f"{own} ({unit})" if unit else own


def interval_plot(
    shots: Sequence[str], values: Mapping[str, Sequence[Quantity]], material: Mapping[str, Quantity]
) -> Figure:
    """Figure of the 90 % interval of each shot, an arrow for a bound, over that of the material, a panel for each
    parameter, by natural name in SI. Raises InputError without matplotlib."""
    from cavirheo.writing import style

    names = [digits.elide(name, 24) for name in shots]
    left, height = 0.25 + 0.075 * max(map(len, names)), 0.22 * len(shots) + 0.9
    width = 2.6 * len(values)
    figure = style.new_figure(height, left + width)
    for k, (parameter, each) in enumerate(values.items()):
        whole = material[parameter]
        low, high = _limits(whole)
        factor, label = _axis(parameter, whole.largest)
        place = (left + 2.6 * k) / (left + width), 0.5 / height, 2.4 / (left + width), 1.0 - 0.6 / height
        axes = style.new_axes(figure, place, label, "")
        axes.locator_params(axis="x", nbins=4)
        axes.margins(x=0.1)
        axes.set_yticks(range(len(names)), names if k == 0 else [""] * len(names))
        axes.set_ylim(len(names) - 0.5, -0.5)
        if low is not None and high is not None:
            axes.axvspan(factor * low, factor * high, color=style.BLUE, alpha=0.2, lw=0)
        for limit in (low, whole.median, high):
            if limit is not None:
                axes.axvline(factor * limit, color=style.BLUE, lw=0.8, ls="-" if limit == whole.median else "--")
        for row, value in enumerate(each):
            _draw_interval(axes, row, value, factor, style.INK)
    return figure


def _limits(value: Quantity) -> tuple[float | None, float | None]:
    """(low, high) ends of an interval that the recording gives; None for one that the range gives."""
    low = value.q05 if value.bound in (None, "lower", "wide") else None
    high = value.q95 if value.bound in (None, "upper", "wide") else None
    return low, high


def _draw_interval(axes: Axes, row: int, value: Quantity, factor: float, colour: str) -> None:
    """Draw a value with its interval at a height `row`; of a bound the limit, with an arrow to where the value is."""
    low, high = (None if end is None else factor * end for end in _limits(value))
    if low is not None and high is not None:
        axes.plot([low, high], [row, row], color=colour, lw=1.2)
    if value.median is not None:
        axes.plot(factor * value.median, row, "o", color=colour, ms=4)
    limit, points = (high, -18) if value.bound == "upper" else (low, 18)
    if value.bound in ("upper", "lower") and limit is not None:
        axes.plot(limit, row, "|", color=colour, ms=7)
        arrow = {"arrowstyle": "<-", "color": colour, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (limit, row), (points, 0), textcoords="offset points", arrowprops=arrow)
