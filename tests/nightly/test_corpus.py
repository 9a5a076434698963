"""Hostile and odd files through every room: answered, or refused in one line that names the file, and nothing else."""

from pathlib import Path

import pytest

# pytest has put this folder on the path
from corpus import make_all
from planted_errors import PLANTED
from rooms import FINE, ROOMS, prepared, table, through

import cavirheo

SOURCE = Path(cavirheo.__file__).parent

_SAMPLE = """
name_not_utf8 name_newline_bad name_escape name_of_255_bytes fifo_csv fifo_json socket device_zero_csv folder_csv
link_to_itself unreadable missing empty_mat sparse_csv csv_all_nan csv_huge h5_denormal mat_four_rows csv_nul
csv_escape_labels csv_long_line csv_of_html sweep_markup times_too_fast mat_cells_as_a_number mat_number_as_cells
mat_empty_cells mat_nested_deep mat_negative_shape h5_no_space h5_loops h5_labels cut_bdt.mat_middle cut_groups.h5_late
json_deep json_no_curves toml_deep sweep_huge references_huge pressure_backwards pressure_jumps mat_long_name
csv_open_quote
"""  # one of each kind, of those that took down a room


_QUICK = ["collapse-time", "rheometer", "simulate --driving", "show"]


def test_a_sample_through_rooms_without_a_solver(tmp_path):
    files = make_all(tmp_path / "corpus", _SAMPLE.split())
    found = through(files, prepared(tmp_path), _QUICK)
    assert {outcome for outcome, _ in found.values()} <= {*FINE}, table(found)


@pytest.mark.hostile
def test_every_file_through_every_room(tmp_path, capsys):
    files = make_all(tmp_path / "corpus")
    assert len(files) > 240
    found = through(files, prepared(tmp_path), ROOMS)
    with capsys.disabled():
        print("", table(found), sep="\n")
    assert {outcome for outcome, _ in found.values()} <= {*FINE}


def test_planted_errors_are_still_in_the_source():
    counts = {(one.name, (SOURCE / one.file).read_text("utf-8").count(one.old)) for one in PLANTED}
    assert {(name, count) for name, count in counts if count != 1} == set()
