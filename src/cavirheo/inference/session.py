"""Evaluation of a network: onnxruntime on the content of an .onnx file.

A file that is not shipped may take any time or memory, so its first run is in a process of its own, with limits. This
file is also the program of that process, and then imports no other module of the package.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from cavirheo.arrays import Floats

BATCH = 512  # curves at a time
DRAWS = 1000  # draws of a posterior network in its trial
MEMORY, SECONDS = 2 << 30, 20.0  # bytes and time of the first run


def session(content: bytes) -> Callable[[ArrayLike], Floats]:
    """(curves, frames) -> (curves, outputs) of the content of an .onnx file."""
    model = onnx_session(content)

    def run(features: ArrayLike) -> Floats:
        curves = np.asarray(features, dtype=np.float32)
        blocks = [curves[i : i + BATCH] for i in range(0, len(curves), BATCH)]
        theta = [model.run(["theta"], {"radius": block})[0] for block in blocks]
        return np.concatenate(theta, dtype=float, casting="same_kind")  # fails for text

    return run


def onnx_session(content: bytes) -> Any:
    """onnxruntime's session of the content of an .onnx file."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read at import: its wheels come with telemetry
    import onnxruntime  # half a second, which listing models or reading curves does not need

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # one small curve at a time: more threads are slower
    options.log_severity_level = 4  # errors are raised, not logged
    options.enable_cpu_mem_arena = False  # it would keep the memory of a run
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def has_finite_draws(content: bytes) -> bool:
    """Whether a posterior network gives finite draws for inputs of zeros: the trial of a file not shipped."""
    model = onnx_session(content)
    shapes = {tensor.name: [n if isinstance(n, int) else DRAWS for n in tensor.shape] for tensor in model.get_inputs()}
    outputs = model.run(None, {name: np.zeros(shape, np.float32) for name, shape in shapes.items()})
    return all(bool(np.isfinite(values).all()) for values in outputs)


def try_out(content: bytes, frames: int, outputs: int, seconds: float = SECONDS) -> None:
    """Raises InputError: on a simple curve it takes too long or too much memory, fails, or gives no finite numbers.

    frames: 0 for a posterior network."""
    from cavirheo.errors import InputError, require

    command = [sys.executable, "-P", __file__, str(MEMORY), str(frames), str(outputs)]
    try:
        child = subprocess.run(command, input=content, capture_output=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"it takes more than {seconds:.0f} s", "model.time") from None
    error = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    full = child.returncode < 0 or "alloc" in error or "MemoryError" in error  # killed, or out of memory
    require(not full, f"it takes more than {MEMORY / 1e9:.1f} GB of memory", "model.memory")
    end = error if len(error) < 200 else f"...{error[-200:]}"  # with the reason
    require(child.returncode == 0, end, "model.fails")


if __name__ == "__main__":  # session.py MEMORY FRAMES OUTPUTS < model.onnx
    limit, frames, outputs = map(int, sys.argv[1:])
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: the time limit remains
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    curve = 0.2 + 0.8 * np.abs(np.cos(np.linspace(0.0, 6.0, frames)))
    try:
        content = sys.stdin.buffer.read()
        if not frames:
            sys.exit(None if has_finite_draws(content) else "its draws are not finite; its weights may be damaged")
        answers = session(content)
        for count in (BATCH, 5, 1):  # a full block, and fewer
            theta = answers(np.tile(curve, (count, 1)))
            if theta.shape != (count, outputs):
                raise ValueError(f"it gives {theta.shape} numbers for {count} curves; its card says {outputs} for each")
            if not np.isfinite(theta).all():
                raise ValueError("its answers are not finite; its weights may be damaged")
    except Exception as error:  # errors of onnxruntime have no common class
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
