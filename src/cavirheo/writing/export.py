"""Answers as objects of pandas and ArviZ; and records as bytes, whose decoding reads only data and executes no code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from io import BytesIO
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError


def import_optional(name: str, install: str = "") -> Any:
    """Import a library. install: what pip installs, if it has another name. Raises InputError: it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != name:  # it is installed, and lacks a library that it needs
            raise
        raise InputError(f'this needs {name}: pip install "{install or name}"', "posterior.missing_library") from None


def dataframe(columns: Mapping[str, Any], attributes: Mapping[str, Any]) -> Any:
    """A pandas.DataFrame of columns of one length, with `attributes` as its attrs. Raises InputError without pandas."""
    frame = import_optional("pandas").DataFrame(dict(columns))
    frame.attrs = dict(attributes)
    return frame


def inference_data(posterior: Mapping[str, Floats], units: Mapping[str, str], attributes: Mapping[str, str]) -> Any:
    """Draws (k,) by parameter as arviz.InferenceData (below 1) or xarray.DataTree, one chain. Raises InputError."""
    arviz, xarray = import_optional("arviz"), import_optional("xarray")
    columns = {name: (("chain", "draw"), draws[None, :], {"units": units[name]}) for name, draws in posterior.items()}
    places = {"chain": [0], "draw": np.arange(len(next(iter(posterior.values()))))}
    data = xarray.Dataset(columns, coords=places, attrs=dict(attributes))
    tree: Any = getattr(xarray, "DataTree", None)
    kind: Any = getattr(arviz, "InferenceData", tree)
    return tree.from_dict({"posterior": data}) if kind is tree else kind(posterior=data)


def encode(value: Any, default: Callable[[Any], str] | None = None) -> bytes:
    """Encode records, lists, tuples, dicts, numbers, texts and arrays as .npz, whose first array is their JSON. Decoded
    numbers are exact to the last bit.

    default: makes a text of any other object. Raises TypeError: there is another object, and no default.
    """
    arrays: list[np.ndarray] = []
    text, stream = json.dumps(_pack(value, arrays), default=default), BytesIO()
    np.savez(stream, np.frombuffer(text.encode(), np.uint8), *arrays)
    return stream.getvalue()


def decode(content: bytes, kinds: Mapping[str, Any]) -> Any:
    """Decode the bytes of `encode`. kinds: the allowed records, by name. Raises EOFError: the bytes are not valid."""
    try:
        with np.load(BytesIO(content)) as file:
            text, *arrays = (file[name] for name in file.files)
        return _unpack(json.loads(text.tobytes()), arrays, kinds)
    except Exception as error:  # damaged bytes may raise any exception
        raise EOFError(f"nothing that was encoded here ({type(error).__name__})") from error


def content_hash(content: Any) -> str:
    """SHA-256 of any content that `encode` accepts."""
    arrays: list[np.ndarray] = []
    digest = hashlib.sha256(json.dumps(_pack(content, arrays), default=str).encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


def _pack(value: Any, arrays: list[np.ndarray]) -> Any:
    """The value as JSON data, {kind: content} if it is no plain value; arrays are appended to `arrays`."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if (names := _fields_of(value)) is not None:
        return {type(value).__name__: {name: _pack(getattr(value, name), arrays) for name in names}}
    if isinstance(value, Mapping):
        return {"dict": [[_pack(key, arrays), _pack(item, arrays)] for key, item in value.items()]}
    if isinstance(value, tuple | list):
        return {"tuple" if isinstance(value, tuple) else "list": [_pack(item, arrays) for item in value]}
    return value.item() if isinstance(value, np.generic) else value


def _fields_of(value: Any) -> Sequence[str] | None:
    """The names of the fields of a record; None for any other value."""
    if isinstance(value, InputError):
        return "message", "code", "where"
    if is_dataclass(value) and not isinstance(value, type):
        return [field.name for field in fields(value)]
    return getattr(type(value), "model_fields", None) or getattr(type(value), "_fields", None)


def _unpack(value: Any, arrays: list[np.ndarray], kinds: Mapping[str, Any]) -> Any:
    if isinstance(value, list):
        raise ValueError("a list without its kind")
    if not isinstance(value, dict):
        return value
    ((kind, inside),) = value.items()
    if kind == "array":
        return arrays[inside]
    if kind in kinds:
        return kinds[kind](**{name: _unpack(item, arrays, kinds) for name, item in inside.items()})
    if kind == "dict":
        return {_unpack(key, arrays, kinds): _unpack(item, arrays, kinds) for key, item in inside}
    return {"list": list, "tuple": tuple}[kind](_unpack(item, arrays, kinds) for item in inside)
