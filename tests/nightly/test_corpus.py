"""Hostile and odd files through every room: answered, or refused in one line that names the file, and nothing else."""

from pathlib import Path

import pytest
from corpus import FILES, make_all  # of this folder, which pytest has put on the path
from planted_errors import PLANTED
from rooms import ROOMS, prepared, through, wrong

import cavirheo

SOURCE = Path(cavirheo.__file__).parent

_SAMPLE = """
name_not_utf8 name_newline_bad name_escape name_of_255_bytes fifo_csv fifo_json socket device_zero_csv folder_csv
link_to_itself unreadable missing empty_mat sparse_csv csv_all_nan csv_huge csv_denormal
csv_escape_labels csv_html_labels csv_of_html bomb_mat_of_cells_where_an_array_belongs bomb_h5_without_a_shape
json_deep toml_deep references_huge damaged_bdt.mat_1 damaged_groups.h5_2 damaged_frequency.csv_3
damaged_result.json_4 damaged_curve.xlsx_5
"""  # one of each kind

_QUICK = "collapse-time", "rheometer", "show"  # rooms without a solver
_ALL = pytest.param(FILES, ROOMS, marks=pytest.mark.hostile, id="all")


@pytest.mark.parametrize(("keys", "rooms"), [pytest.param(_SAMPLE.split(), _QUICK, id="sample"), _ALL])
def test_every_file_is_answered_or_refused(tmp_path, keys, rooms):
    found = through(make_all(tmp_path / "corpus", keys), prepared(tmp_path), rooms)
    assert wrong(found) == []


def test_planted_errors_are_still_in_the_source():
    counts = {(one.name, (SOURCE / one.file).read_text("utf-8").count(one.old)) for one in PLANTED}
    assert {(name, count) for name, count in counts if count != 1} == set()
