"""Export of columns and draws as objects of pandas and ArviZ, or as a picture of all pairs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def pair_plot(columns: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the marginals of draws (draws,) by label and of their pairs; lines mark median and central 90 %.

    Raises InputError without matplotlib or corner."""
    from cavirheo.writing.style import BLUE, new_figure

    figure = new_figure(max(2.1 * len(columns), 4.2))
    draws = np.column_stack([*columns.values()])
    low, high = np.quantile(draws, [0.001, 0.999], axis=0, weights=weights, method="inverted_cdf")
    margin = np.maximum(0.02 * (high - low), 1e-9 * np.abs(high))  # above 0, even if all draws are equal
    import_optional("corner").corner(
        draws,
        40,
        range=[*zip(low - margin, high + margin, strict=True)],
        weights=weights,
        labels=[*columns],
        quantiles=(0.05, 0.5, 0.95),
        color=BLUE,
        fig=figure,
        plot_datapoints=False,
        plot_contours=False,
    )
    return figure
