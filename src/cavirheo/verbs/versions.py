"""What a bug report needs to say: `cavirheo --version --verbose`."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

_TELLING = ("NUMBA_", "CAVIRHEO_", "OMP_", "OPENBLAS_")  # beginnings of variables that change speed or answers


def report() -> str:
    """Versions, extras, the compiled solver and the shipped models of this installation, a line for each."""
    return "\n".join(f"{name:<10}{said}" for name, said in _lines())


def _lines() -> Iterator[tuple[str, str]]:
    import cavirheo
    from cavirheo.inference.model import shipped
    from cavirheo.parallel import cores

    yield "cavirheo", f"{cavirheo.__version__} in {Path(cavirheo.__file__).parent}"
    yield "python", f"{platform.python_version()} ({platform.python_implementation()}), {sys.executable}"
    yield "machine", f"{platform.platform()}, {cores()} cores"
    parts = wanted()
    yield "needs", _installed(parts.pop(""))
    for extra, names in parts.items():
        yield f"[{extra}]", _installed(names)
    yield "solver", _solver()
    for name, path in shipped().items():
        yield "model", f"{name}, sha256 {checksum(path)}"
    found = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(_TELLING)]
    yield "variables", ", ".join(found) or "none that matter"


def wanted() -> dict[str, list[str]]:
    """Names of the libraries that the package needs (under "") and that each extra brings, of users' extras alone."""
    found: dict[str, list[str]] = {"": []}
    for line in requires("cavirheo") or ():
        extra = re.search(r"""extra == ["'](\w+)["']""", line)
        name = re.match(r"[\w.-]+", line)
        if name and not (extra and extra[1] in ("dev", "docs")):
            found.setdefault(extra[1] if extra else "", []).append(name[0])
    return found


def _installed(names: list[str]) -> str:
    said = []
    for name in names:
        try:
            said.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            said.append(f"no {name}")
    return ", ".join(said)


def checksum(path: Path) -> str:
    """Of a model, and a word if it is not the file that its card describes. Raises InputError: it is too large."""
    import hashlib

    from cavirheo.files import read_bytes
    from cavirheo.inference.model import LARGEST, card

    found: str = hashlib.sha256(read_bytes(path, LARGEST)).hexdigest()
    return found + ("" if card(path)["onnx"]["sha256"] == found else ", which is NOT the file that its card describes")


def _solver() -> str:
    """Whether the compiled solver is kept on this machine, and where. It is not compiled for that."""
    from cavirheo.physics import cache, solver

    folders = {file.parent for file in cache.kept(solver.integrate)}
    if folders:
        return f"compiled, kept in {', '.join(map(str, sorted(folders)))}"
    return "not compiled yet: the first simulation takes 10 to 30 s longer"
