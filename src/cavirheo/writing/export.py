"""Export of columns and draws as objects of pandas and ArviZ."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require


def import_optional(name: str, install: str = "") -> Any:
    """Import the library of this name. install: what pip installs, if not the library. Raises InputError: it is not
    installed."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0] == name  # the library itself, and not one that it needs
        require(not missing, f'this needs {name}: pip install "{install or name}"', "posterior.missing_library")
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
