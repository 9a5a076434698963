"""The files that the command line names; what a file is, opened once (`Source`); and how much of it is read."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from io import BufferedReader
from os.path import exists, isdir  # these two also work for names that no file can have
from pathlib import Path
from typing import Literal

import numpy as np

from cavirheo.errors import InputError, check_file, listed, printable
from cavirheo.video.formats import ENDINGS, IMAGE_ENDINGS, STACK_ENDINGS, is_video, pixels_of
from cavirheo.writing import digits

# Limits on what is read: above any real recording, and low enough for some seconds and a gigabyte. A damaged or hostile
# file may declare any shape, or unpack to any size; each limit is checked before the memory is allocated.
MOST_NUMBERS = 5_000_000  # in all arrays of one file, or cells of a text
MOST_CURVES = 5_000
MOST_ROWS = 1_000_000
MOST_COLUMNS = 1_000
MOST_CELLS = 1_000_000  # of the sheets that are read of a workbook, empty cells included
LONGEST_LINE = 100_000  # characters
LARGEST_FILE = 4_000_000_000  # bytes of any file
LARGEST_TEXT = 100_000_000  # bytes of a text file
_OF_TABLES = ".csv .txt .tsv .dat .asc .lvm .xlsx .xlsm .xls .xlsb .ods .mat .npy .npz .h5 .hdf5"
FILE_ENDINGS = {*_OF_TABLES.split(), *ENDINGS}
Kind = Literal["empty", "text", "workbook", "numpy", "matlab", "matlab73", "hdf5", "binary"]
_KINDS: dict[bytes, Kind] = {  # by the first bytes
    b"PK\x03\x04": "workbook",
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": "workbook",
    b"\x93NUMPY": "numpy",
    b"MATLAB 7.3": "matlab73",
    b"MATLAB 5.0": "matlab",
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"\xff\xfe": "text",  # the byte order marks of UTF-16
    b"\xfe\xff": "text",
}
# a table that cavirheo writes: the file that is then in the same folder
_OUTPUT_COMPANIONS = {"result.csv": "result.json", "shots.csv": "collapse-time.json"}
_NO_TABLE = {"reading.empty", "reading.binary", "table.columns", "table.header", "table.empty", "matlab.variables"}
_NO_TABLE |= {"tabular.archive", "tabular.array", "tabular.binary", "tabular.workbook"}  # such files hold no curves


@dataclass(frozen=True)
class Source:
    """A file that is read: what it is, its content, and its digest. It is opened once, when the first of them is asked
    for, and `guarded` closes it."""

    path: Path

    @cached_property
    def file(self) -> BufferedReader:
        return self.path.open("rb")

    @property
    def size(self) -> int:
        return self.file.seek(0, 2)

    @cached_property
    def head(self) -> bytes:
        self.file.seek(0)
        return self.file.read(1024)

    @cached_property
    def kind(self) -> Kind:
        """What its first bytes show; HDF5 in a file that is called .mat is of MATLAB 7.3."""
        by_start = next((kind for start, kind in _KINDS.items() if self.head.startswith(start)), None)
        name_within = self.head[30 : 30 + int.from_bytes(self.head[26:28], "little")]  # of the first file of an archive
        if by_start == "workbook" and name_within.endswith(b".npy"):
            return "numpy"
        if by_start == "hdf5" and self.path.suffix.lower() == ".mat":
            return "matlab73"
        if by_start is None and self.head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
            return "matlab"
        return by_start or ("empty" if not self.head else "binary" if b"\x00" in self.head else "text")

    @cached_property
    def content(self) -> bytes:
        """All of its bytes, for files whose size is limited."""
        self.file.seek(0)
        return self.file.read()

    @property
    def sha256(self) -> str:
        """SHA-256 of the content, in hexadecimal digits: of what was read, if the file has changed since."""
        if "content" in vars(self):
            return hashlib.sha256(self.content).hexdigest()
        self.file.seek(0)
        return hashlib.file_digest(self.file, "sha256").hexdigest()


def check_limit(count: int, limit: int, items: str) -> None:
    """Raise InputError if count > limit. Its code has the first word of `items`: "limits.lines" for lines."""
    if count > limit:
        message = f"{count} {items}: more than {limit} are not read; split the file"
        raise InputError(message, f"limits.{items.split()[0]}")


@contextmanager
def guarded(path: Path, expected: str = "", *, folder: bool = False) -> Iterator[Source]:
    """Guard the reading of a file (or a folder, if allowed): turn every error into an InputError that names the file:
    one of `errors.check_file`, before it is opened; no permission ("reading.unreadable"); damaged ("reading.damaged");
    or an error of the reader."""
    name = printable(str(path))
    check_file(path, LARGEST_FILE, folder=folder)
    source = Source(path)
    try:
        with np.errstate(all="ignore"):  # a damaged file may hold any number; the results are checked
            yield source
    except InputError as error:
        raise error.within(name) from None
    except PermissionError as error:
        raise InputError(f"{name} cannot be read ({error.strerror})", "reading.unreadable") from None
    except Exception as error:  # the libraries raise nearly any exception for damaged files
        message = f"{name} cannot be read, it may be damaged ({type(error).__name__}: {str(error)[:300]})"
        raise InputError(message + (f"; {expected}" if expected else ""), "reading.damaged") from None
    finally:
        if "file" in vars(source):
            source.file.close()


def expand(argument: Path, notify: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Return the files that an argument of a command names: a file; of a folder, its measurement files, sorted, without
    hidden files and files written by cavirheo (a folder of images is one recording); or the matches of a pattern
    (`gel_*.mat`) that the shell did not expand. `notify` is called for a folder with one line on how many of its files
    are read.

    A missing or unreadable file is returned too: its reader raises the error, and the other files are still read.

    Raises InputError: no measurement in a folder ("files.none_in_folder"), or no match of a pattern ("files.no_match").
    """
    if isdir(argument):
        return _files_of_folder(argument, notify)
    if exists(argument) or not glob.has_magic(str(argument)):
        return [argument]
    if matches := [Path(name) for name in sorted(glob.glob(str(argument), recursive=True)) if not isdir(name)]:
        return without_headers(matches)
    message = f"{argument}: no file matches; give the names of files, or of the folder that holds them"
    raise InputError(message, "files.no_match")


def measurement_files(folder: Path) -> tuple[list[Path], int]:
    """Return (the measurement files in a folder, sorted; the number of its other files). Hidden files and headers
    of films are neither, files that cavirheo wrote are other files. Raises OSError: the folder cannot be listed."""
    paths = sorted(path for path in folder.iterdir() if path.name[0] != "." and not isdir(path))
    names = {path.name for path in paths}
    foreign = [path for path in paths if _OUTPUT_COMPANIONS.get(path.name) not in names]
    taken = [path for path in foreign if path.suffix.lower() in FILE_ENDINGS]
    return without_headers(taken), len(paths) - len(taken)


def without_headers(paths: Iterable[Path]) -> list[Path]:
    """Remove repetitions, and headers whose film is listed too. A header alone stays, so that its reader reports it."""
    unique = dict.fromkeys(paths)
    return [path for path in unique if pixels_of(path) not in unique]


def _files_of_folder(folder: Path, notify: Callable[[str], None]) -> list[Path]:
    try:
        taken, left = measurement_files(folder)
    except OSError:
        return [folder]  # it cannot be listed: the reader reports the error
    others = [path.name for path in taken if path.suffix.lower() not in STACK_ENDINGS]
    images = is_video(folder)
    if images and not any(_may_hold_curves(folder / name) for name in others):
        if others:
            notify(f"{folder}: its images are one recording; left out: {listed(others)}")
        return [folder]
    inner = sorted(path.name for path in folder.iterdir() if path.name[0] != "." and isdir(path) and is_video(path))
    if not taken:
        if inner:
            why = f"it holds folders of images ({listed(inner)}): give each by name"
        elif count := sum(path.suffix.lower() in IMAGE_ENDINGS and path.name[0] != "." for path in folder.iterdir()):
            why = f"{digits.counted(count, 'image')}: at least 3 are needed"
        else:
            why = f"expected files {', '.join(sorted(FILE_ENDINGS))}"
        raise InputError(f"{folder}: no measurement in this folder; {why}", "files.none_in_folder")
    parts = [f"{folder}: {digits.counted(len(taken), 'file')}"]
    parts += [f"{digits.counted(left, 'other')} left out"] if left else []
    parts += [f"it holds images, too: move {listed(others)} away to measure the images"] if images else []
    parts += [f"folders of images ({listed(inner)}) left out: give each by name"] if inner else []
    notify("; ".join(parts))
    return taken


def _may_hold_curves(path: Path) -> bool:
    """Whether a file is a recording (no header alone) or a table, perhaps with a mistake that its reader reports."""
    from cavirheo.io.shots import read_curves  # which imports this module

    try:
        return not pixels_of(path) if is_video(path) else bool(read_curves(path))
    except InputError as error:
        return error.code not in _NO_TABLE
