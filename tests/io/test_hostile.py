"""Files made to exhaust or to deceive a reader: each is refused with the reason before it takes time or memory."""

import sys
import traceback
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from bombs import BOMBS
from conftest import code_of, error_of
from files import put
from scipy.io import savemat

from cavirheo import InputError, SolverError, read_curves

sys.path.insert(0, str(Path(__file__).parents[1] / "nightly"))
from apart import each_apart
from mutate import READERS, mutated
from valid import BINARIES, TEXTS, content, documents


@pytest.mark.parametrize("name", BOMBS)
def test_refused_with_the_reason(tmp_path, name):
    code, file = BOMBS[name]
    assert code_of(read_curves, put(tmp_path / f"file.{name.partition('_')[0]}", file)) == code


@pytest.mark.parametrize(
    "name", ["curve.csv", "separated.txt", "bdt-packed.mat", "bdt-73.mat", "groups.h5", "curve.xlsx"]
)
def test_damaged_files_never_raise_anything_but_input_errors(tmp_path, name):
    valid, path = content(name, tmp_path), tmp_path / f"damaged{Path(name).suffix}"
    for number in range(12):
        path.write_bytes(mutated(name, valid, 1, number))
        for read in READERS[path.suffix[1:]]:
            with suppress(InputError):
                read(path)


@pytest.mark.hostile
def test_thousands_of_damaged_files_end_no_process_either(tmp_path):
    valid = {name: content(name, tmp_path) for name in (*TEXTS, *BINARIES)}
    valid |= {name: text.encode() for name, text in documents().items()}
    names = list(valid)

    def said(number: int) -> str:
        name = names[number % len(names)]
        path = tmp_path / str(number) / f"damaged{Path(name).suffix}"
        path.parent.mkdir()
        path.write_bytes(mutated(name, valid[name], 1, number))
        for read in READERS.get(name) or READERS[path.suffix[1:]]:
            try:
                read(path)
            except (InputError, SolverError) as error:
                if str(path.parent) not in str(error) or not str(error).isprintable():
                    return f"{path}: {error}"
            except Exception:
                return f"{path}: {traceback.format_exc()}"
        return ""

    found = dict(each_apart(said, range(2000), 120.0))
    assert {number: one for number, one in found.items() if one} == {}


def test_a_large_recording_is_read_and_numbers_beyond_all_bounds_print_nothing(tmp_path, recwarn):
    """The limits are far above what cameras record, 100 000 frames; a warning of numpy is a line nobody asked for."""
    path, t = tmp_path / "long.h5", np.arange(100_000) * 1e-9
    with h5py.File(path, "w") as file:
        file["time"], file["radius"] = t, 1e-4 * (0.2 + np.abs(np.cos(t / 9e-6)))
    assert len(read_curves(path)[0].time) == 100_000
    for radius in (1e308, np.nan):
        np.savetxt(tmp_path / "a.txt", np.c_[np.arange(50.0), np.full(50, radius), np.full(50, -radius)])
        error_of(read_curves, tmp_path / "a.txt")
    huge = {"shift_normRnew": np.full((2, 50), 1e308), "Rmax": [1e308] * 2, "t": np.arange(50) * 1e-6}
    savemat(tmp_path / "a.mat", huge)
    read_curves(tmp_path / "a.mat")
    assert not recwarn.list
