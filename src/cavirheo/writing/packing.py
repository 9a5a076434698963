"""Records as JSON and arrays, and back: what is read is data alone, and nothing of it is executed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from cavirheo.errors import InputError


def pack(value: Any, arrays: list[np.ndarray]) -> Any:
    """As JSON can hold it: records, lists, tuples and dicts as {kind: content}; arrays are appended to `arrays`."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, InputError):
        return {"InputError": {"message": value.message, "code": value.code, "where": value.where}}
    names = [field.name for field in fields(value)] if is_dataclass(value) else getattr(value, "_fields", None)
    names = getattr(type(value), "model_fields", names)
    if names is not None and not isinstance(value, type):
        return {type(value).__name__: {name: pack(getattr(value, name), arrays) for name in names}}
    if isinstance(value, Mapping):
        return {"dict": [[pack(key, arrays), pack(item, arrays)] for key, item in value.items()]}
    if isinstance(value, tuple | list):
        return {"tuple" if isinstance(value, tuple) else "list": [pack(item, arrays) for item in value]}
    return value.item() if isinstance(value, np.generic) else value


def unpack(value: Any, arrays: list[np.ndarray], kinds: Mapping[str, Any]) -> Any:
    """What was packed; kinds: the records that it may hold, by name. Raises KeyError, IndexError, TypeError or
    ValueError: it holds something else."""
    if isinstance(value, list):
        raise ValueError("a list without its kind")
    if not isinstance(value, dict):
        return value
    ((kind, inside),) = value.items()
    if kind == "array":
        return arrays[inside]
    if kind in kinds:
        return kinds[kind](**{name: unpack(item, arrays, kinds) for name, item in inside.items()})
    if kind == "dict":
        return {unpack(key, arrays, kinds): unpack(item, arrays, kinds) for key, item in inside}
    return {"list": list, "tuple": tuple}[kind](unpack(item, arrays, kinds) for item in inside)


def key_of(content: Any) -> str:
    """SHA-256 of whatever `pack` can pack."""
    arrays: list[np.ndarray] = []
    digest = hashlib.sha256(json.dumps(pack(content, arrays), default=str).encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
