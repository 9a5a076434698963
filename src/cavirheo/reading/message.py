"""What a process that reads uploads answers with: one line of JSON, then its arrays; nothing in it is ever executed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from io import BytesIO
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading.shots import Recordings
from cavirheo.video.frames import Footage
from cavirheo.video.measurement import Measurement, Stated
from cavirheo.video.track import Track

_KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (RadiusCurve, Recordings, Footage, Measurement, Stated, Track, InputError)
}


def encode(value: Any) -> bytes:
    """Numbers, texts, arrays, lists, tuples, dicts by text, and the records that are named here.

    Raises TypeError: it holds something else.
    """
    arrays: list[np.ndarray] = []

    def plain(value: Any) -> Any:
        """As JSON holds it: [kind, content] of all but numbers and texts; arrays by their places."""
        kind = type(value).__name__
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, np.ndarray):
            arrays.append(value)
            return ["array", len(arrays) - 1]
        if isinstance(value, np.generic):
            return plain(value.item())
        if isinstance(value, InputError):
            return [kind, plain({"message": str(value), "code": value.code})]
        if kind in _KINDS:
            names = [one.name for one in fields(value)] if is_dataclass(value) else value._fields
            return [kind, plain({name: getattr(value, name) for name in names})]
        if isinstance(value, Mapping):
            return ["dict", {str(key): plain(item) for key, item in value.items()}]
        if isinstance(value, list | tuple):
            return ["list" if isinstance(value, list) else "tuple", *map(plain, value)]
        raise TypeError(f"{kind} cannot be sent")

    stream, text = BytesIO(), json.dumps(plain(value))
    stream.write(f"{len(arrays)} {text}\n".encode("ascii"))
    for array in arrays:
        np.lib.format.write_array(stream, array, allow_pickle=False)
    return stream.getvalue()


def decode(message: bytes) -> Any:
    """What was encoded. Raises ValueError, TypeError and the like: it is no message of ours."""
    stream = BytesIO(message)
    count, _, text = stream.readline().partition(b" ")
    arrays = [np.lib.format.read_array(stream, allow_pickle=False) for _ in range(int(count))]

    def built(value: Any) -> Any:
        if not isinstance(value, list):
            return value
        kind, *content = value
        if kind in ("list", "tuple"):
            return [*map(built, content)] if kind == "list" else tuple(map(built, content))
        if kind == "array":
            return arrays[content[0]]
        if kind == "dict":
            return {key: built(item) for key, item in content[0].items()}
        return _KINDS[kind](**built(content[0]))

    return built(json.loads(text))
