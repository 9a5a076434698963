"""What a process that reads uploads answers with: one line of JSON, then its arrays; nothing in it is ever executed."""

from __future__ import annotations

import json
from io import BytesIO
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.messages import Message
from cavirheo.reading.shots import Recordings
from cavirheo.video.frames import Footage
from cavirheo.video.measurement import Measurement, Stated
from cavirheo.video.track import Track
from cavirheo.writing.packing import pack, unpack

_KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (RadiusCurve, Message, Recordings, Footage, Measurement, Stated, Track, InputError)
}


def encode(value: Any) -> bytes:
    """What writing/packing.py packs. Raises TypeError: it holds something else."""
    arrays: list[np.ndarray] = []
    text = json.dumps(pack(value, arrays))
    stream = BytesIO()
    stream.write(f"{len(arrays)} {text}\n".encode("ascii"))
    for array in arrays:
        np.lib.format.write_array(stream, array, allow_pickle=False)
    return stream.getvalue()


def decode(message: bytes) -> Any:
    """What was encoded. Raises ValueError, TypeError and the like: it is no message of ours."""
    stream = BytesIO(message)
    count, _, text = stream.readline().partition(b" ")
    arrays = [np.lib.format.read_array(stream, allow_pickle=False) for _ in range(int(count))]
    return unpack(json.loads(text), arrays, _KINDS)
