"""Encoding of records as JSON and arrays, and decoding, which reads only data and executes no code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from io import BytesIO
from typing import Any

import numpy as np

from cavirheo.errors import InputError


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


def _pack(value: Any, arrays: list[np.ndarray]) -> Any:
    """The value as JSON data, {kind: content} if it is no plain value; arrays are appended to `arrays`."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, InputError):
        return {"InputError": {"message": value.message, "code": value.code, "where": value.where}}
    names = [field.name for field in fields(value)] if is_dataclass(value) else getattr(value, "_fields", None)
    names = getattr(type(value), "model_fields", names)
    if names is not None and not isinstance(value, type):
        return {type(value).__name__: {name: _pack(getattr(value, name), arrays) for name in names}}
    if isinstance(value, Mapping):
        return {"dict": [[_pack(key, arrays), _pack(item, arrays)] for key, item in value.items()]}
    if isinstance(value, tuple | list):
        return {"tuple" if isinstance(value, tuple) else "list": [_pack(item, arrays) for item in value]}
    return value.item() if isinstance(value, np.generic) else value


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


def content_hash(content: Any) -> str:
    """SHA-256 of any content that `encode` accepts."""
    arrays: list[np.ndarray] = []
    digest = hashlib.sha256(json.dumps(_pack(content, arrays), default=str).encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
