"""Which files are read: those that the command line names, and only regular ones that can be opened."""

from __future__ import annotations

import atexit
import glob
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from os.path import exists, isdir  # of names that no file can have, too
from pathlib import Path

import numpy as np

from cavirheo.errors import InputError, printable, require
from cavirheo.io import limits
from cavirheo.video.frames import ENDINGS, HEADER, PIXELS, STACKS, is_video

MEASUREMENTS = {".mat", ".csv", ".txt", ".tsv", ".dat", ".h5", ".hdf5", ".xlsx", ".xls", ".xlsb", ".ods", *ENDINGS}
_OURS = {  # tables and films that cavirheo writes: the document that then stands beside them
    "result.csv": "result.json",
    "comparison.csv": "result.json",
    "shots.csv": "collapse-time.json",
    "rheometer.csv": "rheometer.json",
    "table.csv": "rheometer.json",
    "overlay.mp4": "measure.json",
    "fields.h5": "simulation.csv",
}
_temporary: set[Path] = set()


def file_label(path: Path) -> str:
    """The name of a file as people see it."""
    return path.name if path in _temporary else printable(str(path))


@contextmanager
def guarded(path: Path, expected: str = "", *, folder: bool = False) -> Iterator[None]:
    """Around the reading of a file, or a folder if it may be one: what goes wrong becomes an InputError that names it.

    Raises:
        InputError: no regular file, found before it is opened ("reading.missing", "reading.folder", "reading.special");
            one that may not be read ("reading.unreadable"), is damaged ("reading.damaged"), or as the reader says.
    """
    name = file_label(path)
    _check(path, name, folder=folder)
    try:
        with np.errstate(all="ignore"):  # a damaged file may hold any number; what comes of it is checked
            yield
    except InputError as error:
        raise error.within(name) from None
    except Exception as error:  # damaged files make the libraries below raise nearly anything
        if isinstance(error, PermissionError):
            raise InputError(f"{name} cannot be read ({error.strerror})", "reading.unreadable") from None
        message = f"{name} cannot be read, it may be damaged ({type(error).__name__}: {str(error)[:300]})"
        raise InputError(message + (f"; {expected}" if expected else ""), "reading.damaged") from error


def _check(path: Path, name: str, *, folder: bool) -> None:
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):  # ValueError: a name with a zero byte
        raise InputError(f"{name} does not exist", "reading.missing") from None
    except OSError as error:
        raise InputError(f"{name} cannot be read ({error.strerror})", "reading.unreadable") from None
    mode = status.st_mode
    if folder and stat.S_ISDIR(mode):
        return
    directory = f"{name} is a directory; give the files in it, e.g. {name}/*.mat"
    require(not stat.S_ISDIR(mode), directory, "reading.folder")
    kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
    special = f"{name} is {kind}; give a file, or send its content to standard input and give - as the file"
    require(stat.S_ISREG(mode), special, "reading.special")
    limits.few(status.st_size, limits.FILE, f"bytes in {name}")


def expand(arguments: Iterable[str | Path], say: Callable[[str], None] = lambda _: None) -> list[Path]:
    """The files that the arguments of a command name, in their order, each once: a file as it is; `-`: standard input;
    a folder: the measurement files in it, sorted, without hidden ones and what cavirheo wrote; a pattern (`gel_*.mat`)
    that the shell left as it is. A film whose header is named, too, is one file. `say` is told in one line what was
    taken of each folder.

    A file that is missing or cannot be read is named too: its reader refuses it, and the others are answered.

    Raises InputError: an empty folder ("files.none_in_folder"), or a pattern that nothing matches ("files.no_match").
    """
    paths: list[Path] = []
    for argument in arguments:
        path = Path(argument)
        if str(argument) == "-":
            paths.append(_standard_input())
        elif isdir(path):
            paths += _of_folder(path, say)
        elif not exists(path) and glob.has_magic(str(path)):
            matches = [Path(name) for name in sorted(glob.glob(str(path), recursive=True)) if not isdir(name)]
            message = f"{path}: no file matches; give the names of files, or of the folder that holds them"
            require(bool(matches), message, "files.no_match")
            paths += matches
        else:
            paths.append(path)
    return without_headers(paths)


def measurements(folder: Path) -> tuple[list[Path], int]:
    """The measurement files in a folder, sorted, without hidden ones, what cavirheo wrote and the headers of films that
    are there; how many others are there. Raises OSError: the folder may not be listed."""
    names = sorted(path for path in folder.iterdir() if path.name[0] != "." and not isdir(path))
    names_here = {path.name for path in names}
    foreign = [path for path in names if _OURS.get(path.name) not in names_here]
    taken = [path for path in foreign if path.suffix.lower() in MEASUREMENTS]
    return without_headers(taken), len(names) - len(taken)


def without_headers(paths: Iterable[Path]) -> list[Path]:
    """A film of two files is one, named by its pixels; a header alone stays, for its reader to say what is missing."""
    unique = dict.fromkeys(paths)
    return [path for path in unique if pixels_of(path) not in unique]


def pixels_of(path: Path) -> Path | None:
    """Of a header: where its film's pixels are, or should be."""
    return path.with_suffix(PIXELS) if path.suffix == HEADER else None


def header_of(path: Path) -> Path | None:
    """Of the pixels of a film: where its header is, or should be."""
    return path.with_suffix(HEADER) if path.suffix == PIXELS else None


def _of_folder(folder: Path, say: Callable[[str], None]) -> list[Path]:
    try:
        taken, left = measurements(folder)
    except OSError:
        return [folder]  # may not be listed: the reader says so
    if is_video(folder) and {path.suffix.lower() for path in taken} <= {*STACKS}:
        return [folder]  # its images are the frames of one
    kinds = ", ".join(sorted(MEASUREMENTS))
    require(bool(taken), f"{folder}: no measurement in this folder; expected files {kinds}", "files.none_in_folder")
    say(f"{folder}: {len(taken)} files" + (f"; {left} others left out" if left else ""))
    return taken


@cache
def _standard_input() -> Path:
    """A file with all that comes from standard input; its name is what people see."""
    path, size = Path(tempfile.mkdtemp(prefix="cavirheo-")) / "standard input", 0
    _temporary.add(path)
    atexit.register(tidy)
    with path.open("wb") as file:
        while block := sys.stdin.buffer.read(1 << 20):
            size += len(block)
            limits.few(size, limits.INFLATED, "bytes from standard input")
            file.write(block)
    return path


def tidy() -> None:
    """Remove what standard input was kept in; called when the program ends."""
    while _temporary:
        shutil.rmtree(_temporary.pop().parent, ignore_errors=True)
    _standard_input.cache_clear()
