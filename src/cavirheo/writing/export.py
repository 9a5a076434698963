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


def inference_data(posterior: Mapping[str, Floats], units: Mapping[str, str], attributes: Mapping[str, str]) -> Any:
    """Draws (k,) by parameter as arviz.InferenceData (ArviZ below 1) or xarray.DataTree (from 1 on), one chain. Raises
    InputError without arviz."""
    arviz, xarray = import_optional("arviz"), import_optional("xarray")
    columns = {name: (("chain", "draw"), draws[None, :], {"units": units[name]}) for name, draws in posterior.items()}
    places = {"chain": [0], "draw": np.arange(len(next(iter(posterior.values()))))}
    data = xarray.Dataset(columns, coords=places, attrs=dict(attributes))
    tree: Any = getattr(xarray, "DataTree", None)
    kind: Any = getattr(arviz, "InferenceData", tree)
    if kind is tree:  # from ArviZ 1 on
        return tree.from_dict({"posterior": data})
    return kind(posterior=data)
