"""Recordings for tests: a bubble with known R(t), filmed and written as cameras do."""

import struct
from functools import cache
from pathlib import Path

import numpy as np

from validation.rendering import Film, Scene, render

RATE, SCALE = 5e5, 5.5  # 1/s, um per px
FRAMES = 34


def history(top: float = 24.0, fall: float = 8.3) -> tuple[np.ndarray, np.ndarray]:
    """(time in frames, radius in px): growth, a collapse at `fall`, two rebounds, all of Rayleigh collapses."""
    time = np.linspace(0.0, 60.0, 6000)
    radius, begin = np.full(time.shape, 0.2 * top), 0.0
    for share in (1.0, 0.55, 0.35):
        half = share * fall
        s = (time - begin - half) / half
        lobe = share * top * np.clip(1.0 - s * s, 0.0, 1.0) ** 0.4
        radius = np.where(np.abs(s) <= 1.0, np.maximum(lobe, 0.09 * top), radius)
        begin += 2.0 * half
    return time[10:] - time[10], radius[10:]


@cache
def film(seed: int = 1, frames: int = FRAMES, top: float = 24.0, **scene: object) -> Film:
    """Of 88 x 72 pixels unless the scene says otherwise."""
    time, radius = history(top)
    return render(time, radius, frames=frames, scene=Scene(**{"width": 88, "height": 72, **scene}), seed=seed)


def write_mraw(path: Path, frames: np.ndarray, bits: int, rate: int = 500_000) -> Path:
    """Photron: raw pixels, those of 12 bits packed, and their header."""
    count, height, width = frames.shape
    if bits == 12:
        a, b = frames.astype(np.uint16).reshape(-1, 2).T
        content = np.stack([a >> 4, (a & 15) << 4 | b >> 8, b & 255], axis=1).astype(np.uint8).tobytes()
    else:
        content = frames.astype("<u2" if bits == 16 else np.uint8).tobytes()
    path.write_bytes(content)
    path.with_suffix(".cihx").write_text(
        "CIHX\n<cih><imageDataInfo><resolution>"
        f"<width>{width}</width><height>{height}</height></resolution><colorInfo><type>Mono</type><bit>{bits}</bit>"
        f"</colorInfo></imageDataInfo><frameInfo><totalFrame>{count}</totalFrame></frameInfo><recordInfo>"
        f"<recordRate>{rate}</recordRate><shutterSpeedNsec>400</shutterSpeedNsec></recordInfo></cih>\n"
    )
    return path


def write_cine(path: Path, frames: np.ndarray, stamps: np.ndarray, header_rate: int) -> Path:
    """Phantom: 16 bits, rows from the bottom up, with a time stamp (s) and an exposure of 1 us for every frame."""
    count, height, width = frames.shape
    size = 2 * height * width
    setup = bytearray(5700)
    setup[140:144] = b"ST" + struct.pack("<H", len(setup))
    setup[768:772] = struct.pack("<I", header_rate)
    pairs = [(round((t % 1) * 2**32), 1_600_000_000 + int(t)) for t in stamps]
    blocks = struct.pack("<IHH", 8 + 8 * count, 1002, 0) + b"".join(struct.pack("<II", *pair) for pair in pairs)
    blocks += struct.pack("<IHH", 8 + 4 * count, 1003, 0) + struct.pack(f"<{count}I", *[4295] * count)
    images = 84 + len(setup) + len(blocks)
    head = struct.pack("<2sHHHiIiIIII", b"CI", 44, 0, 1, 0, count, 0, count, 44, 84, images) + bytes(8)
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 16, 0, size, 0, 0, 0, 65536)
    first = images + 8 * count
    offsets = struct.pack(f"<{count}q", *[first + k * (size + 8) for k in range(count)])
    body = b"".join(struct.pack("<II", 8, size) + frame[::-1].astype("<u2").tobytes() for frame in frames)
    path.write_bytes(head + bitmap + bytes(setup) + blocks + offsets + body)
    return path
