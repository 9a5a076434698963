"""Files in, curves out: every format on a file written here, bad files refused in words, and the published files."""

import io
import pickle
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from files import ods_row, save_v73, write_ods, write_xls, write_xlsx
from scipy.io import savemat

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import input_checks
from cavirheo.io import read_curves, write_csv
from cavirheo.io.files import expand, tidy
from cavirheo.io.formats import kind_of, read_sheets, text_sheet
from cavirheo.io.shots import Recordings, read_shots
from cavirheo.io.subprocess_reader import decode, encode
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.io.trace import read_trace
from cavirheo.physics.driving import Trace
from cavirheo.physics.media import WATER

R_MAX = 200e-6
T_C = R_MAX * np.sqrt(998.0 / 101325.0)


def history(n=180, start=-0.6, end=4.0):
    """(t*, R*): growth, a collapse at 0.93 and four smaller ones; enough like a bubble for a reader."""
    t = np.linspace(start, end, n)
    beat = np.sqrt(np.clip(1.0 - (((t + 0.93) % 1.86 - 0.93) / 0.93) ** 2, 0.0, 1.0)) ** 0.9
    return t, 0.12 + 0.88 * beat * np.exp(-0.8 * np.maximum(t - 0.93, 0.0))


T_STAR, R_STAR = history()
TIME, RADIUS = T_STAR * T_C, R_STAR * R_MAX


def cells(*arrays):
    row = np.empty((1, len(arrays)), dtype=object)
    for k, array in enumerate(arrays):
        row[0, k] = np.asarray(array, dtype=float).reshape(-1, 1)
    return row


def bdt_variables(radii=(R_STAR, R_STAR, R_STAR), times=(T_STAR, T_STAR, T_STAR), maxima=(1e-4, 2e-4, 3e-4)):
    return {
        "R_nondim_All": cells(*radii),
        "t_nondim_All": cells(*times),
        "RmaxList": np.array([maxima]),
        "lambda_max_mean": 6.5,
        "lambda_max_std": 0.4,
    }


def text_table(path, header, *columns, separator=","):
    rows = [separator.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*([header] if header else []), *rows]) + "\n")
    return path


@pytest.mark.parametrize("save", [savemat, save_v73], ids=["v5", "v7.3"])
def test_bdt_cells_become_seconds_and_metres_with_each_shots_own_maximum(tmp_path, save):
    save(tmp_path / "gel.mat", bdt_variables())
    curves = read_curves(tmp_path / "gel.mat", density=1025.0)
    assert [c.name for c in curves] == ["gel[1]", "gel[2]", "gel[3]"]
    for curve, maximum in zip(curves, (1e-4, 2e-4, 3e-4), strict=True):
        assert curve.max_radius == pytest.approx(maximum, rel=0.01)
        assert np.allclose(curve.time, T_STAR * maximum * np.sqrt(1025.0 / 101325.0))
        assert (curve.stretch, curve.stretch_std) == (6.5, 0.4)
        assert (curve.group, curve.group_source) == ("gel", str(tmp_path / "gel.mat"))
        assert len(curve.source_sha256) == 64
        assert any("density 1025 kg/m3" in note for note in curve.notes)
        assert any("before R_max (growth)" in note for note in curve.notes)


@pytest.mark.parametrize("save", [savemat, save_v73], ids=["v5", "v7.3"])
def test_unusable_cells_do_not_stop_the_others(tmp_path, save):
    radii = ([], R_STAR[:3], np.full(180, np.nan), R_STAR, R_STAR)
    times = ([], T_STAR[:3], T_STAR, T_STAR, T_STAR)
    save(tmp_path / "gel.mat", bdt_variables(radii, times, (0.0, 1e-4, 1e-4, 0.0, 2e-4)))
    curves = read_curves(tmp_path / "gel.mat")
    assert len(curves) == 5
    refused = (("unusable", "1 of 5"), ("few_frames", "3 of 3"), ("few_frames", "0 of 180"), ("unusable", "RmaxList"))
    for curve, (code, name) in zip(curves[:4], refused, strict=True):
        with pytest.raises(InputError, match=name) as error:
            _ = curve.max_radius
        assert error.value.code == f"curve.{code}"
    assert curves[4].max_radius == pytest.approx(2e-4, rel=0.01)


def test_bdt_without_maxima_waits_for_the_users(tmp_path):
    variables = bdt_variables()
    del variables["RmaxList"]
    savemat(tmp_path / "gel.mat", variables)
    curve = read_curves(tmp_path / "gel.mat")[0]
    with pytest.raises(InputError, match="--rmax-um") as error:
        _ = curve.max_radius
    assert error.value.code == "curve.unscaled"
    scaled = curve.with_max_radius(R_MAX)
    assert np.allclose(scaled.time, TIME)
    assert scaled.collapse_times()[0] == pytest.approx(0.93 * T_C, rel=0.02)


def test_density_of_the_file_is_told_from_a_round_frame_rate(tmp_path):
    per_radius = R_MAX * np.sqrt(1025.0 / 101325.0)
    t = np.arange(-10, 80) * 1e-6 / per_radius
    savemat(tmp_path / "gel.mat", bdt_variables([np.interp(t, T_STAR, R_STAR)], [t], [R_MAX]))
    assert "--density 1025" in read_curves(tmp_path / "gel.mat", density=998.0)[0].warnings[0].text
    assert read_curves(tmp_path / "gel.mat", density=1025.0)[0].warnings == ()


def test_pressure_stated_by_the_file_is_used(tmp_path):
    savemat(tmp_path / "gel.mat", {**bdt_variables(), "P_inf": 9e4})
    curve = read_curves(tmp_path / "gel.mat")[1]
    assert np.allclose(curve.time, T_STAR * 2e-4 * np.sqrt(998.0 / 9e4))
    assert any("P_inf = 90000 Pa" in note for note in curve.notes)


def test_imr_files(tmp_path):
    savemat(tmp_path / "metres.mat", {"Rnew": RADIUS, "t": TIME})
    savemat(tmp_path / "micrometres.mat", {"Rnew": RADIUS * 1e6, "t": TIME})
    savemat(tmp_path / "pixels.mat", {"Rnew": RADIUS / 2.76e-6, "deltax": 2.76e-6, "deltat": TIME[1] - TIME[0]})
    savemat(tmp_path / "plain.mat", {"R": RADIUS * 1e6, "t": TIME})
    for name, note in (("metres", ""), ("micrometres", "taken as um"), ("pixels", "deltax"), ("plain", "taken as um")):
        (curve,) = read_curves(tmp_path / f"{name}.mat")
        assert curve.max_radius == pytest.approx(R_MAX, rel=0.01)
        assert np.diff(curve.time) == pytest.approx(np.diff(TIME))
        assert any(note in text for text in curve.notes)


def test_normalised_rows_over_common_times(tmp_path):
    rows = np.stack([R_STAR, R_STAR])
    savemat(tmp_path / "shots.mat", {"shift_normRnew": rows, "Rmax": [[150.0], [300.0]], "t": TIME - TIME[0]})
    assert [c.max_radius for c in read_curves(tmp_path / "shots.mat")] == pytest.approx([150e-6, 300e-6], rel=0.01)


@pytest.mark.parametrize(
    ("header", "time_factor", "radius_factor", "separator"),
    [
        ("time_us,radius_um", 1e6, 1e6, ","),
        ("time_s,radius_m", 1.0, 1.0, ","),
        ("t [us];R [um]", 1e6, 1e6, ";"),
        ("Time (ms)\tRadius (mm)", 1e3, 1e3, "\t"),
        (" TIME_US , Radius_µm ", 1e6, 1e6, ","),
        ("# t_us R_um", 1e6, 1e6, " "),
        ("t,R", 1.0, 1e6, ","),
    ],
)
def test_csv_headers(tmp_path, header, time_factor, radius_factor, separator):
    path = text_table(tmp_path / "a.csv", header, TIME * time_factor, RADIUS * radius_factor, separator=separator)
    (curve,) = read_curves(path)
    assert curve.name == "a"
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)


def test_csv_with_decimal_commas(tmp_path):
    path = text_table(tmp_path / "a.csv", "t_us;r_um", TIME * 1e6, RADIUS * 1e6, separator=";")
    path.write_text(path.read_text().replace(".", ","))
    assert np.allclose(read_curves(path)[0].radius, RADIUS, rtol=1e-6)


def test_csv_of_several_shots_with_deviations(tmp_path):
    shot = np.repeat([7, 9], len(TIME))
    both = np.tile(TIME * 1e6, 2), np.tile(RADIUS * 1e6, 2)
    path = text_table(
        tmp_path / "a.csv", "shot,time_us,radius_um,radius_std_um", shot, *both, np.full(2 * len(TIME), 0.5)
    )
    curves = read_curves(path)
    assert [c.name for c in curves] == ["a[7]", "a[9]"]
    assert np.allclose(curves[1].radius_std, 0.5e-6)


def test_what_is_cleaned_is_counted(tmp_path):
    t, r = TIME * 1e6, RADIUS * 1e6
    r = r.copy()
    r[:2] = [-3.0, 0.0]
    r[50] = np.nan
    t = np.concatenate([t, t[60:63], [np.nan]])
    r = np.concatenate([r, r[60:63] + 2.0, [100.0]])
    (curve,) = read_curves(text_table(tmp_path / "a.csv", "time_us,radius_um", t, r))
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert np.isnan(curve.radius[[0, 1, 50]]).all()
    assert np.isnan(curve.radius).sum() == 3
    assert curve.radius[60:63] == pytest.approx(RADIUS[60:63] + 1e-6, rel=1e-6)
    text = "\n".join(curve.notes)
    for said in (
        "2 frames with radius <= 0 marked",
        "1 of 183 frames without a radius",
        "1 of 184 frames without a time left out",
        "(1 steps back): frames sorted",
        "3 frames repeat a time",
    ):
        assert said in text


def test_a_number_that_no_recording_has_is_not_called_nan(tmp_path):
    t, r = TIME * 1e6, RADIUS * 1e6
    r[50], t[-1] = 1e300, -2e12
    (curve,) = read_curves(text_table(tmp_path / "a.csv", "time_us,radius_um", t, r))
    assert (len(curve.time), np.flatnonzero(np.isnan(curve.radius)).tolist()) == (len(t) - 1, [50])
    text = "\n".join(curve.notes)
    assert "1 of 179 radii are numbers that no recording has (the first: 1e+300)" in text
    assert "1 of 180 times are numbers that no recording has (the first: -2e+12)" in text
    assert "NaN" not in text


def test_swapped_columns_are_suspected(tmp_path):
    """Without titles the even steps and the collapse time tell which is which; titles that contradict them do not."""
    t, r = (TIME - TIME[0]) * 1e6, RADIUS * 1e6
    (bare,) = read_curves(text_table(tmp_path / "bare.csv", "", r, t))
    assert np.allclose(bare.radius, RADIUS, rtol=1e-6)
    assert any("taken as radius and time" in note for note in bare.notes)
    savemat(tmp_path / "a.mat", {"Rnew": TIME - TIME[0], "t": RADIUS})
    for path in (text_table(tmp_path / "a.csv", "time_us,radius_um", r, t), tmp_path / "a.mat"):
        (curve,) = read_curves(path)
        with pytest.raises(InputError, match="time and radius seem to be swapped"):
            _ = curve.max_radius
    (late,) = read_curves(text_table(tmp_path / "late.csv", "time_us,radius_um", t[::-1], r[::-1]))
    assert np.allclose(late.radius, RADIUS, rtol=1e-6)  # rows from the last frame to the first are sorted


@pytest.mark.parametrize(
    ("header", "factor", "says", "usable"),
    [
        ("time_us,radius_um", 1.0, "only makes sense in m", True),
        ("time_us,radius_um", 1e3, "only makes sense in mm", True),
        ("time_us,radius_m", 1e6, "only makes sense in um", True),
        ("time_us,radius_um", 1.0 / R_MAX, "looks like R/R_max", False),
        ("time_us,radius_px", 1.0 / 2.76e-6, "in pixels", False),
        ("time_us,radius_um", 1e9, "no bubble of", False),
        ("time_us,radius_um", 0.36e6, "check the scale", True),
    ],
)
def test_wrong_units_are_recognised(tmp_path, header, factor, says, usable):
    (curve,) = read_curves(text_table(tmp_path / "a.csv", header, TIME * 1e6, RADIUS * factor))
    told = [*curve.notes, *(one.text for one in input_checks.of_scale(curve, WATER))]
    assert any(says in note for note in told)
    if not usable:
        with pytest.raises(InputError) as error:
            _ = curve.max_radius
        assert error.value.code == "curve.unscaled"
        curve = curve.with_max_radius(R_MAX)
        assert np.allclose(curve.radius, RADIUS, rtol=0.01)


def test_two_wild_frames_do_not_decide_the_unit(tmp_path):
    radius = RADIUS.copy() * 1e6
    radius[[10, 100]] = 4e5
    (curve,) = read_curves(text_table(tmp_path / "a.csv", "time_us,radius_um", TIME * 1e6, radius))
    assert curve.max_radius == pytest.approx(R_MAX, rel=0.01)
    assert any("2 single frames stand out" in note for note in curve.notes)


def test_tables_without_a_header(tmp_path):
    (two,) = read_curves(text_table(tmp_path / "two.csv", "", TIME * 1e6, RADIUS * 1e6))
    (three,) = read_curves(text_table(tmp_path / "three.txt", "", TIME, RADIUS * 1.01e6, RADIUS * 0.99e6))
    assert np.allclose(two.radius, RADIUS, rtol=1e-6)
    assert np.allclose(three.radius, RADIUS, rtol=1e-6)
    assert any("two radii" in note for note in three.notes)
    gap = [-1000.0]
    blocks = text_table(
        tmp_path / "blocks.csv",
        "",
        np.concatenate([[0.0], gap, TIME * 1e6, gap, TIME * 1e6]),
        np.concatenate([[7e-310], gap, RADIUS * 1e6, gap, RADIUS * 2e6]),
    )
    curves = read_curves(blocks)
    assert [c.max_radius for c in curves] == pytest.approx([R_MAX, 2 * R_MAX], rel=0.01)
    assert any("1 blocks of the file hold no radius" in note for note in curves[0].notes)
    for factor in (0.36e6, 2.1e6):  # a scale that the collapse time contradicts is not assumed
        with pytest.raises(InputError) as error:
            read_curves(text_table(tmp_path / "odd.csv", "", TIME * 1e6, RADIUS * factor))
        assert error.value.code == "table.header"


def test_hdf5_layout(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["first/time"], file["first/radius"] = TIME, RADIUS
        file["series/second/time_us"], file["series/second/radius_um"] = TIME * 1e6, RADIUS * 1e6
        file["first"].attrs["stretch"] = 7.0
        file["unrelated"] = np.zeros(3)
    curves = read_curves(tmp_path / "a.h5")
    assert [c.name for c in curves] == ["a[first]", "a[series/second]"]
    assert all(np.allclose(c.radius, RADIUS) and np.allclose(c.time, TIME) for c in curves)
    assert curves[0].stretch == 7.0


def rows_of(header, *columns):
    return [header, *zip(*columns, strict=True)]


def test_workbook_is_read_from_its_first_tab(tmp_path):
    """Whichever file of the archive holds it; a hidden tab is none. Empty cells and columns are left where they are."""
    other = rows_of(["time_us", "radius_um"], TIME * 1e6, RADIUS * 2e6)
    first = rows_of(["time_us", None, "radius_um"], TIME * 1e6, [None] * len(TIME), RADIUS * 1e6)
    write_xlsx(tmp_path / "a.xlsx", {"hidden": other, "first": first, "second": other}, hidden=["hidden"])
    (curve,) = read_curves(tmp_path / "a.xlsx")
    assert np.array_equal(curve.radius, (RADIUS * 1e6) * 1e-6)


def test_an_open_document_whatever_its_ending(tmp_path):
    rows = rows_of(["time_us", "radius_um"], TIME * 1e6, RADIUS * 1e6)
    (curve,) = read_curves(write_ods(tmp_path / "a.csv", "".join(map(ods_row, rows))))
    assert np.allclose(curve.radius, RADIUS)


def test_an_old_workbook(tmp_path):
    (sheet,) = read_sheets(write_xls(tmp_path / "a.csv"), is_header)
    assert sheet[:2] == ("one", [(1, ["a", "b"]), (2, ["1.5", "2"])])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings(tmp_path, encoding):
    path = text_table(tmp_path / "a.csv", "time_µs,radius_µm", TIME * 1e6, RADIUS * 1e6)
    path.write_bytes(path.read_text().encode(encoding))
    assert np.allclose(read_curves(path)[0].radius, RADIUS, rtol=1e-6)


def test_a_quoted_cell_may_hold_the_separator(tmp_path):
    path = text_table(tmp_path / "a.csv", "time_us,radius_um", TIME * 1e6, RADIUS * 1e6)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f'shot,{head},"note, if any"', *(f'"gel, 1",{row}, "a ""b"", c"' for row in rows)]))
    (curve,) = read_curves(path)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)
    assert curve.meta["label"] == "gel, 1"


def is_header(cells):
    return "a" in cells


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a,b\n1,2\n", {1: "a b", 2: "1 2"}),
        ("# made by x, y\n\na;b\n\n1,5;-2,5e3\n", {3: "a b", 5: "1.5 -2.5e3"}),
        ("x y\na\tb\n\t2\n", {1: "x|y", 2: "a b", 3: " 2"}),
        ("# note\n# a b\n# m s\n# more words than titles\n1 2\n% end\n3 4\n", {2: "a b", 3: "m s", 5: "1 2", 7: "3 4"}),
        ("# a b\na b\n1 2\n", {2: "a b", 3: "1 2"}),
        ("a, b\n1 2\n", {1: "a, b", 2: "1 2"}),
        ("1,2\n3,4\n", {1: "1 2", 2: "3 4"}),
        ("1;2,5\n3;4,5\n", {1: "1 2.5", 2: "3 4.5"}),
        ('a,b\n"1\n5",2\n', {1: "a b", 3: "15 2"}),
        ('"a" "b"\n 1   2 \n"3" 4\n', {1: "a b", 2: "1 2", 3: "3 4"}),
        ("", {}),
        ("# nothing\n", {}),
    ],
)
def test_dialects_of_text(text, found):
    """Rows by number of line; cells are separated by one space here, or none where the row has a single cell."""
    rows = text_sheet(text, is_header).rows
    assert {row.number: " ".join(row.cells) for row in rows} == {k: v.replace("|", " ") for k, v in found.items()}


WORDS = Vocabulary(
    {
        "G": Term("g'", {"Pa": 1.0, "mPa": 1e-3, "MPa": 1e6}, unit="Pa"),
        "speed": Term("elan", {"rads": 1.0, "s-1": np.nan}),
        "name": Term("name"),
    },
    "expected G' (Pa) and elan (rad/s)",
)


def test_decimal_commas_and_points_in_one_row_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text("G';name\n1.5;a\n2,000;b\n")
    with pytest.raises(InputError) as error:
        _ = read_columns(tmp_path / "a.csv", WORDS, ("G",))[0].column("G").numbers
    assert error.value.code == "tabular.comma"


@pytest.mark.parametrize(
    ("title", "kind", "unit"),
    [
        ("G' (Pa)", "G", "Pa"),
        ("G’ [mPa]", "G", "mPa"),
        ("G' [mpa]", "G", "mpa"),
        ("Élan in rad/s", "speed", "rads"),
        ("elan_rad_s^-1", "", None),
        ("elan [s^−1]", "speed", "s-1"),
        ("ELAN, RAD/S", "speed", "rads"),
        ("elan*", "", None),
        ("elan/limit", "", None),
        ("elan", "speed", None),
        ("12.5", "", None),
    ],
)
def test_what_a_title_says(title, kind, unit):
    assert WORDS.name(title) == (kind, unit, "")


def test_columns_in_si_with_texts_and_notes(tmp_path):
    text = "by hand\nname,G',elan,other\n,kPa,rad/s,\na,1,-,x\n-b,2,3,y\nmean,1.5,3,\n"
    (tmp_path / "a.csv").write_text(text.replace("kPa", "MPa"))
    (table,) = read_columns(tmp_path / "a.csv", WORDS, ("G", "speed"))
    assert [column.name.kind for column in table.columns] == ["name", "G", "speed"]
    assert table.column("name").text == ["a", "-b"]
    assert table.column("G").si.tolist() == [1e6, 2e6]
    assert np.array_equal(table.column("speed").si, [np.nan, 3], equal_nan=True)
    said = (
        "1 line above the titles left out",
        "units from the row below the titles: MPa, rad/s",
        "1 line of mean at the",
    )
    assert all(any(note.startswith(one) for note in table.notes) for one in said)


@pytest.mark.parametrize(
    ("text", "need", "code"),
    [
        ("G',elan\n1,2\n", "speed", "tabular.no_unit"),
        ("G',elan (s^-1)\n1,2\n", "speed", "tabular.no_unit"),
        ("G' (psi),elan\n1,2\n", "G", "tabular.unit"),
        ("G',elan\npsi,rad/s\n1,2\n", "G", "tabular.unit"),
        ("G',G' (MPa)\n1,2\n", "G", "tabular.twice"),
        ("G'\n1\n", "speed", "tabular.columns"),
        ("", "speed", "tabular.empty"),
        ("G'\n1\nten\n", "G", "tabular.number"),
    ],
)
def test_columns_that_cannot_be_read(tmp_path, text, need, code):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as error:
        _ = read_columns(tmp_path / "a.csv", WORDS, (need,))[0].column(need).si
    assert error.value.code == code


def test_neither_text_nor_workbook(tmp_path):
    assert [kind_of(head) for head in (b"1,2", b"PK\x03\x04", b"\x00\x01\x02\x00", "1,2".encode("utf-16-le"))] == [
        "text", "workbook", "binary", "text",
    ]  # fmt: skip
    (tmp_path / "a.csv").write_bytes(bytes(range(256)))
    with pytest.raises(InputError) as error:
        read_sheets(tmp_path / "a.csv", is_header)
    assert error.value.code == "tabular.binary"


def test_a_pressure_trace(tmp_path):
    for text in ("time_us, pressure_kPa\n0,0\n1,-250.5\n\n2,0\n", "p [Pa];t (ms)\n0;0\n-250500;0,001\n0;0,002\n"):
        (tmp_path / "p.csv").write_text(text)
        trace = Trace(*read_trace(tmp_path / "p.csv")[:2])
        assert trace.time == pytest.approx([0, 1e-6, 2e-6])
        assert trace.pressure == pytest.approx([0, -250500, 0])


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (b"t,p\n0,1\n", "trace.header"),
        (b"", "trace.header"),
        (b"time_us,pressure_kPa\n0,1,2\n1,1,2\n", "tabular.width"),
        (b"time_us,pressure_kPa\n0,x\n", "tabular.number"),
        (b"\xff\xfe\x00", "tabular.encoding"),
        (None, "reading.missing"),
    ],
)
def test_bad_traces(tmp_path, text, code):
    if text is not None:
        (tmp_path / "p.csv").write_bytes(text)
    with pytest.raises(InputError, match=r"p\.csv") as error:
        read_trace(tmp_path / "p.csv")
    assert error.value.code == code


@pytest.mark.parametrize("rows", ["", "1,0\n0,0\n", "1,0\n2\n"])
def test_traces_that_are_no_function_of_time(tmp_path, rows):
    (tmp_path / "p.csv").write_text("time_us,pressure_kPa\n" + rows)
    with pytest.raises(InputError):
        Trace(*read_trace(tmp_path / "p.csv")[:2])


def test_csv_round_trip(tmp_path):
    radius = RADIUS.copy()
    radius[3] = np.nan
    curve = RadiusCurve(TIME, radius, np.full(len(TIME), 1e-6))
    write_csv(tmp_path / "a.csv", curve)
    (back,) = read_curves(tmp_path / "a.csv")
    assert np.allclose(back.time, curve.time, rtol=1e-9)
    assert np.allclose(back.radius, curve.radius, rtol=1e-9, equal_nan=True)
    assert np.allclose(back.radius_std, 1e-6)


def test_no_remark_above_a_curve_is_a_formula(tmp_path):
    write_csv(tmp_path / "a.csv", RadiusCurve(TIME, RADIUS), "simulation of a,=1+1;@b\n, +c")
    first, *_ = (tmp_path / "a.csv").read_text().splitlines()
    assert first == "# simulation of a,'=1+1;'@b\\x0a, +c"
    assert np.allclose(read_curves(tmp_path / "a.csv")[0].radius, RADIUS, rtol=1e-9)


def bad_files(folder):
    (folder / "empty.mat").write_bytes(b"")
    (folder / "prose.txt").write_text("Dear reader,\nthis is a letter.\n")
    (folder / "prose.mat").write_text("Dear reader,\nthis is a letter.\n")
    (folder / "blank.csv").write_text("\n\n# nothing\n")
    (folder / "header.csv").write_text("time_us,radius_um\n")
    (folder / "words.csv").write_text("time_us,radius_um\n1,2\n2,three\n")
    (folder / "commas.csv").write_text("time_us,radius_um\n1,5,200,3\n")
    (folder / "twice.csv").write_text("time_us,radius_um,radius_um\n1,2,3\n")
    (folder / "swapped.csv").write_text("time_um,radius_us\n1,2\n")
    (folder / "numbers.csv").write_text("1,2\n2,3\n")
    (folder / "hollow.txt").write_text("-1000,-1000\n1,0\n-1000,-1000\n")
    (folder / "noise.bin").write_bytes(bytes(range(256)) * 20)
    (folder / "clip.mp4").write_bytes(b"\x00" * 64)
    savemat(folder / "other.mat", {"G": 1.0, "speed": np.arange(3.0)})
    savemat(folder / "times.mat", {"pIMR_array": np.ones((4, 3))})
    savemat(folder / "half.mat", {"R_nondim_All": cells(R_STAR)})
    savemat(folder / "cut.mat", bdt_variables())
    (folder / "cut.mat").write_bytes((folder / "cut.mat").read_bytes()[:1500])
    with h5py.File(folder / "huge.h5", "w") as file:
        file.create_dataset("time", shape=(10**13,), dtype="f8", chunks=(1000,))
        file.create_dataset("radius", shape=(10**13,), dtype="f8", chunks=(1000,))
    with h5py.File(folder / "other.h5", "w") as file:
        file["speed"] = np.arange(3.0)
    with zipfile.ZipFile(folder / "other.xlsx", "w") as archive:
        archive.writestr("[Content_Types].xml", "<a/>")
        archive.writestr("word/document.xml", "<a/>")
    with zipfile.ZipFile(folder / "shots.zip", "w") as archive:
        archive.writestr("gel_1.csv", "time_us,radius_um\n1,2\n")
        archive.writestr("gel_2.csv", "time_us,radius_um\n1,2\n")


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    bad_files(folder)
    return folder


@pytest.mark.parametrize(
    ("name", "code", "names"),
    [
        ("", "reading.folder", ""),
        ("missing.mat", "reading.missing", ""),
        ("empty.mat", "reading.empty", "time_us,radius_um"),
        ("prose.txt", "table.columns", "'Dear'"),
        ("prose.mat", "table.columns", "'Dear'"),
        ("blank.csv", "table.empty", "time_us,radius_um"),
        ("header.csv", "table.empty", ""),
        ("words.csv", "tabular.number", "row 3, column 'radius_um': 'three'"),
        ("commas.csv", "tabular.width", "row 2 has 4 cells"),
        ("twice.csv", "table.twice", "radius"),
        ("swapped.csv", "table.units", "time in um and radius in us"),
        ("numbers.csv", "table.header", "time_us,radius_um"),
        ("hollow.txt", "table.empty", "-1000"),
        ("noise.bin", "reading.binary", ""),
        pytest.param("clip.mp4", "video.undecodable", "", marks=pytest.mark.needs("av")),
        ("other.mat", "matlab.variables", "G, speed; expected R_nondim_All"),
        ("times.mat", "matlab.collapse_times", "cavirheo collapse-time"),
        ("half.mat", "matlab.variables", ""),
        ("cut.mat", "matfile.cut", ""),
        ("huge.h5", "limits.shape", "10000000000000"),
        ("other.h5", "hdf5.datasets", "speed"),
        ("other.xlsx", "tabular.workbook", ""),
        ("shots.zip", "tabular.archive", "a zip archive of 2 files (gel_1.csv, gel_2.csv), and no workbook: unpack it"),
    ],
)
def test_bad_files_are_refused_in_words(bad, name, code, names):
    path = bad / name if name else bad
    with pytest.raises(InputError) as error:
        read_curves(path)
    assert error.value.code == code
    assert str(path) in str(error.value)
    assert names in str(error.value)
    assert "cavirheo measure" not in str(error.value)  # there is no such command


def test_damaged_files_never_raise_anything_but_input_errors(tmp_path):
    savemat(tmp_path / "v5.mat", bdt_variables(), do_compression=True)
    save_v73(tmp_path / "v73.mat", bdt_variables())
    text_table(tmp_path / "table.csv", "time_us,radius_um", TIME * 1e6, RADIUS * 1e6)
    random = np.random.default_rng(1)
    for trial in range(150):
        name = ("v5.mat", "v73.mat", "table.csv")[trial % 3]
        content = bytearray((tmp_path / name).read_bytes())
        if trial % 2:
            content = content[: random.integers(1, len(content))]
        for place in random.integers(0, len(content), 8):
            content[place] = random.integers(256)
        damaged = tmp_path / ("damaged" + name[-4:])
        damaged.write_bytes(content)
        try:
            for curve in read_curves(damaged):
                curve.resampled(1e-6, allow_short=True)
                curve.stretch_from_tail()
        except InputError:
            pass


PUBLISHED = {  # curves in the file, smallest and largest R_max in um, unusable ones
    "paam_alginate_0p3/Rt_nondim_exp_PAAm_Alginite_0p3perc_v2.mat": (5, 166, 338, ()),
    "peg8000_10wv/Rt_nondim_exp_PEG8K_20.mat": (20, 111, 327, ()),
    "peg8000_40wv/Rt_nondim_exp_PEG8K_80.mat": (20, 103, 344, ()),
    "agarose_0p5/Rt_nondim_exp.mat": (11, 200, 285, (0,)),
    "agarose_2p5/Rt_nondim_exp.mat": (11, 150, 225, (6,)),
    "pa_stiff/RofT_shifted_20_shots.mat": (20, 268, 452, ()),
    "pa_stiff/PA1_exp3_RofTdata.mat": (1, 400, 410, ()),
    "pa_stiff/PA1_exp2_RofTdata_WRONG_SCALE.mat": (1, 510, 520, ()),
    "pa_soft/A_E2_002.mat": (1, 194, 196, ()),
    "pa_soft/PolyAcry_12_48_08_InCA_export.txt": (1, 172, 174, ()),
    "simulated/numsim4_NHKV_RofTdata.mat": (1, 408, 409, ()),
    "video/PAstiff_xy002_RofT.mat": (1, 384, 387, ()),
    "water_laser/laser0_timeShifted.csv": (45, 170, 315, ()),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_file(real_data, name):
    count, low, high, unusable = PUBLISHED[name]
    curves = read_curves(real_data / name)
    assert len(curves) == count
    for k, curve in enumerate(curves):
        if k in unusable:
            with pytest.raises(InputError) as error:
                _ = curve.max_radius
            assert error.value.code == "curve.unusable"
            continue
        assert low <= curve.max_radius * 1e6 <= high
        if not name.startswith("water"):  # its recordings end in the first collapse
            rayleigh = 0.9147 * curve.max_radius * np.sqrt(998.0 / 101325.0)
            assert 0.5 < (curve.collapse_times()[0] - curve.time_of_max) / rayleigh < 1.35


@pytest.mark.parametrize("name", [n for n in PUBLISHED if "nondim" in n])
def test_fitted_maximum_agrees_with_the_published_one(real_data, name):
    from scipy.io import loadmat

    listed = loadmat(real_data / name)["RmaxList"].ravel()
    for k, (curve, published) in enumerate(zip(read_curves(real_data / name), listed, strict=True)):
        if k not in PUBLISHED[name][3]:
            assert curve.max_radius == pytest.approx(published, rel=0.02)
            assert abs(curve.time_of_max) < 0.2e-6  # t* = 0 is the publishers' own fit


def test_single_shots_of_agarose_agree_with_the_cells_made_from_them(real_data):
    cells_of = read_curves(real_data / "agarose_2p5" / "Rt_nondim_exp.mat", density=1025.0)
    files = sorted((real_data / "agarose_2p5").glob("2E6*.mat"))
    for k, (path, cell) in enumerate(zip(files, cells_of, strict=True)):
        (single,) = read_curves(path)
        if k != 6:
            assert single.max_radius == pytest.approx(cell.max_radius, rel=0.01)
            assert single.collapse_times()[0] == pytest.approx(cell.collapse_times()[0], abs=0.1e-6)


def test_collapse_time_tables_are_refused_by_name(real_data):
    for path in (real_data / "collapse_times").glob("*.mat"):
        with pytest.raises(InputError) as error:
            read_curves(path)
        assert error.value.code == "matlab.collapse_times"


def test_plateau_is_read_where_there_is_one(real_data):
    alginate = read_curves(real_data / "paam_alginate_0p3" / "Rt_nondim_exp_PAAm_Alginite_0p3perc_v2.mat")
    for k in (0, 2, 4):
        value, deviation = alginate[k].stretch_from_tail()
        assert abs(value - 9.80) < 2.0 * np.hypot(deviation, 0.91)
    drifting = read_curves(real_data / "peg8000_10wv" / "Rt_nondim_exp_PEG8K_20.mat")
    for k in (1, 4, 5, 7, 13, 14, 19):
        assert drifting[k].stretch_from_tail() is None
    assert sum(c.stretch_from_tail() is not None for c in drifting) >= 4


def lines(separator, *columns, comma=False):
    text = "\n".join(separator.join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)) + "\n"
    return text.replace(".", ",") if comma else text


US, UM = TIME * 1e6, RADIUS * 1e6
FRAMES = np.arange(1.0, 1.0 + len(TIME))
PLAIN, GERMAN, TABS = lines(",", US, UM), lines(";", US, UM, comma=True), lines("\t", US, UM)
META = "Camera: Phantom v2512\nOperator: A, B\n\n"
ONE_SHOT = {  # the text, what its notes must say (nothing: it is ordinary)
    "microns": ("Time (microseconds),Bubble radius (microns)\n" + PLAIN, ""),
    "short titles": ("t_us,R_um\n" + PLAIN, ""),
    "quotients": ("Zeit / µs;Radius / µm\n" + GERMAN, "360 decimal commas"),
    "German": ("Zeit (µs);Blasenradius (µm)\n" + GERMAN, "360 decimal commas"),
    "French": ("temps (µs);rayon de la bulle (µm)\n" + GERMAN, "decimal commas"),
    "points above commas": ("Software;1.2.3\nUhrzeit;14.30\nZeit_us;R_um\n" + GERMAN, "360 decimal commas"),
    "Spanish": ("Tiempo en µs;Radio en µm\n" + GERMAN, "decimal commas"),
    "Japanese": ("時間 (マイクロ秒),気泡半径 (µm)\n" + PLAIN, ""),
    "Chinese": ("时间(微秒),气泡半径(微米)\n" + PLAIN, ""),
    "lines above": (META + "time_us,radius_um\n" + PLAIN, "2 lines above the titles"),
    "comments above": ("# " + META.replace("\n", "\n# ") + "\ntime_us,radius_um\n" + PLAIN, ""),
    "pairs above": ("Sample\tgel 5 %\nDate\t2024-01-05\nTime (us)\tRadius (um)\n" + TABS, "2 lines above"),
    "unit row": ("Time,Radius\nus,um\n" + PLAIN, "units from the row below the titles: us, um"),
    "unit row in brackets": ("Zeit;Radius\n(µs);(µm)\n" + GERMAN, "units from the row below"),
    "empty last column": ("time_us,radius_um,\n" + PLAIN.replace("\n", ",\n"), ""),
    "quoted": ('"time_us","radius_um"\n' + lines('","', US, UM).replace("\n", '"\n"').join('""')[:-1], ""),
    "titles with spaces": ("Time (us)   Bubble radius (um)\n" + lines("   ", US, UM), ""),
    "an empty first frame": ("time_us,R_um,shot\n,,A\n" + PLAIN.replace("\n", ",A\n"), "1 of 181 frames without"),
    "numbered without a title": (",time_us,radius_um\n" + lines(",", FRAMES, US, UM), ""),
    "numbered beside the titles": ("".join(["time_us radius_um\n", *(f"{k} {row}\n" for k, row in enumerate(
        lines(" ", US, UM).splitlines(), 1))]), "a first column without a title"),
    "mean and deviation": ("n,time_us,radius_um\n" + lines(",", FRAMES, US, UM) + "Mean,9,9\nStd.,1,1\n", "Mean, Std."),
    "Mittelwert": ("Zeit_us;Radius_um\n" + GERMAN + "Mittelwert;9,9\n", "1 line of Mittelwert"),
    "thousands": ("time_ns;radius_um\n" + "".join(
        f"{1e3 * t:,.3f};{r:,.6f}\n" for t, r in zip(US, UM, strict=True)), "marks between the thousands"),
    "Swiss thousands": ("time_ns;radius_um\n" + "".join(
        f"{1e3 * t:,.3f};{r:,.6f}\n".replace(",", "’") for t, r in zip(US, UM, strict=True)), "thousands"),
    "frames": ("frame rate: 1,000,000 fps\nBild;Radius (µm)\n" + lines(";", US, UM), "as the file states"),
    "frames in kHz": ("# Frame rate (kHz): 1000\nframe no.,R_um\n" + PLAIN, "1e+06 frames per second"),
    "diameter": ("time_us,diameter_um\n" + lines(",", US, 2 * UM), "diameters halved"),
    "Durchmesser": ("Zeit_us;Durchmesser (µm)\n" + lines(";", US, 2 * UM, comma=True), "diameters halved"),
    "radius in pixels too": ("time_us,R_px,R_um\n" + lines(",", US, UM / 2.8, UM), "in pixels is not used"),
    "another radius": ("time_us,R_um,R0_um\n" + lines(",", US, UM, UM / 9), ""),
    "control characters": ("time_us,radius_um\n" + PLAIN.replace(",", "\x07,") + "\x1a", "181 control characters"),
}  # fmt: skip


@pytest.mark.parametrize("name", ONE_SHOT)
def test_a_table_as_laboratories_write_it(tmp_path, name):
    text, said = ONE_SHOT[name]
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    (curve,) = read_curves(tmp_path / "a.csv")
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)
    assert said in "\n".join(curve.notes)
    assert said or len(curve.notes) == 1
    assert curve.warnings == ()


@pytest.mark.parametrize(
    ("titles", "labels"),
    [
        ("t_us,R1_um,R2_um", ["R1_um", "R2_um"]),
        ("Time (us),Radius 1 (um),Radius 2 (um)", ["Radius 1", "Radius 2"]),
        ("Zeit_us,Schuss 1 [µm],Schuss 2 [µm]", ["Schuss 1", "Schuss 2"]),
        ("time_us,gel_a_01 (um),gel_a_02 (um)", ["gel_a_01", "gel_a_02"]),
        ("Time,shot 1,shot 2\nus,um,um", ["shot 1", "shot 2"]),
    ],
)
def test_a_column_for_each_shot(tmp_path, titles, labels):
    (tmp_path / "a.csv").write_text(titles + "\n" + lines(",", US, UM, 1.5 * UM), encoding="utf-8")
    curves = read_curves(tmp_path / "a.csv")
    assert [curve.name for curve in curves] == [f"a[{label}]" for label in labels]
    assert np.allclose(curves[1].radius, 1.5 * RADIUS, rtol=1e-6)
    assert all(any("2 columns of radii" in note for note in curve.notes) for curve in curves)


@pytest.mark.parametrize(
    ("text", "code", "names"),
    [
        ("t_us;R_um\n1,234;100\n2,345;120\n", "tabular.comma", ("1.234", "1234")),
        ("t_us;R_um\n1.5;100\n2,25;120\n", "tabular.comma", ("2.25", "225")),
        ("frame,R_um\n1,100\n2,110\n", "table.frame_rate", ("'frame'",)),
        ("fps: 270000\nframe rate 500 kHz\nframe,R_um\n1,100\n", "table.frame_rate", ("270000", "500000")),
        ("time_s,time_us,R_um\n1,1,1\n", "table.twice", ("time_s", "time_us")),
        ("t1_us,R1_um,t2_us,R2_um\n1,1,1,1\n", "table.twice", ("t1_us", "t2_us")),
        ("t_us,R_um,R2_um\n1,1,1\n", "table.twice", ("R_um", "R2_um")),
        ("shot,t_us,R1_um,R2_um\n1,1,1,1\n", "table.twice", ("shot",)),
        ("t_us,area_um2\n1,1\n", "table.area", ("area_um2",)),
        ("t_us,R_um\ns,um\n1,1\n", "tabular.units", ("'us'", "'s'")),
        ("Time (us) Bubble radius (um)\n1 2\n", "tabular.width", ()),
        ("t_us,velocity\n1,1\n", "table.columns", ("R1_um",)),
        ("time_us,radius_um\n1,100\nmean,3\nmean,4\n", "tabular.number", ("'mean'",)),
        ("time_us,radius_um\n1_0,100\n", "tabular.number", ("1_0",)),
        ("index,of,titles\ntime,radius\n0,0,200\n1,0,201\n", "tabular.width", ()),  # a decimal comma or a number?
    ],
)
def test_two_readings_are_refused(tmp_path, text, code, names):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as error:
        read_curves(tmp_path / "a.csv")
    assert error.value.code == code
    assert all(name in str(error.value) for name in names)


def test_frame_rates_that_are_given(tmp_path):
    (tmp_path / "a.csv").write_text("fps: 500000\nframe,R_um\n" + PLAIN)
    (curve,) = read_curves(tmp_path / "a.csv", frame_rate_hz=1e6)
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert len(curve.warnings) == 1  # the file states another
    with pytest.raises(InputError) as error:
        read_curves(tmp_path / "a.csv", frame_rate_hz=-1.0)
    assert error.value.code == "table.frame_rate"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("time_us,radius_um\n" + PLAIN, 0),
        ("t,R\n" + PLAIN, 0),  # no unit is no contradiction
        ("time_us,radius_m\n" + PLAIN, 1),
        ("time_us,radius_um\n" + lines(",", US[::-1], UM[::-1]), 1),
    ],
)
def test_what_is_doubtful_stands_apart_from_the_notes(tmp_path, text, count):
    (tmp_path / "a.csv").write_text(text)
    (curve,) = read_curves(tmp_path / "a.csv")
    assert len(curve.warnings) == count
    assert {one.text for one in curve.warnings} <= set(curve.notes)
    about_scale = [one for one in curve.warnings if one.code == "check_input.radius_unit"]
    assert len(curve.with_max_radius(R_MAX).warnings) == count - len(about_scale)


def test_a_sheet_with_a_heading_and_decimal_commas(tmp_path):
    rows = [["Bubble data"], [None], ["Zeit", "Radius"], ["µs", "µm"], *(
        (f"{t:.6f}".replace(".", ","), f"{r:.6f}".replace(".", ",")) for t, r in zip(US, UM, strict=True)
    )]  # fmt: skip
    (curve,) = read_curves(write_xlsx(tmp_path / "a.xlsx", {"Data": rows}))
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)


def test_other_tables_are_read_alike(tmp_path):
    """A pressure trace, a table of collapse times and a sweep with heading, unit row, decimal commas and a mean."""
    from cavirheo.companions.collapse_times import read_table
    from cavirheo.companions.rheometer.read import read_sweeps

    (tmp_path / "p.csv").write_text("Ultrasound\nZeit;Druck\nµs;kPa\n0,0;0,5\n1,5;-2,5\nMittelwert;-1,0\n")
    time, pressure, notes = read_trace(tmp_path / "p.csv")
    assert np.allclose((time, pressure), ([0, 1.5e-6], [500, -2500]))
    assert len(notes) == 4
    (tmp_path / "t.csv").write_text("My gel\n\nRmax;lambda;t1\nµm;;µs\n200,5;7,1;18,5\n210,5;7,2;19,5\nMean;7;19\n")
    group = read_table(tmp_path / "t.csv")
    assert [shot.max_radius_m for shot in group.shots] == pytest.approx([200.5e-6, 210.5e-6])
    rows = "".join(f"{k},{w},{10 + w},{1 + w}\n" for k, w in enumerate((0.1, 1, 10, 100)))
    (tmp_path / "s.csv").write_text("n,omega (rad/s),G' (Pa),G'' (Pa)\n" + rows + "Mean,27.8,37.8,28.8\n")
    (sweep,) = read_sweeps(tmp_path / "s.csv")
    assert sweep.points == 4
    assert any("Mean" in note for note in sweep.notes)


def test_a_message_of_a_reader_is_arrays_and_json(tmp_path):
    """What was read comes back whole; what would be executed does not come through."""
    (tmp_path / "a.csv").write_text("time_us,radius_um\n" + PLAIN)
    sent = read_shots([tmp_path / "a.csv", tmp_path / "none.csv"])
    message = encode(sent)
    assert b"pickle" not in message
    back = decode(message)
    assert isinstance(back, Recordings)
    assert back.problems == sent.problems
    (one,), (other,) = back.curves, sent.curves
    assert np.array_equal(one.radius, other.radius)
    assert (one.meta, one.warnings, one.maximum) == (other.meta, other.warnings, other.maximum)
    error = decode(encode(InputError("no", "a.b")))
    assert (str(error), error.code) == ("no", "a.b")
    assert decode(encode({"a": (1, [2.5, None], "x")})) == {"a": (1, [2.5, None], "x")}
    with pytest.raises(TypeError):
        encode(Path("x"))
    for forged in (pickle.dumps(one), b'0 ["Path", ["dict", {}]]\n', b'0 {"Path": {}}\n', b"1 0\n", b""):
        with pytest.raises((ValueError, KeyError)):
            decode(forged)


def test_a_curve_is_built_once(tmp_path, monkeypatch):
    """What a reader adds to a curve is a label; the samples are checked once and what is read off them stays known."""
    built = []
    check = RadiusCurve.__post_init__
    monkeypatch.setattr(RadiusCurve, "__post_init__", lambda curve: built.append(1) or check(curve))
    (tmp_path / "a.csv").write_text("time_us,R1_um,R2_um\n" + lines(",", US, UM, 1.5 * UM))
    savemat(tmp_path / "b.mat", bdt_variables())
    text_table(tmp_path / "c.csv", "", US, UM)
    found = read_shots(sorted(tmp_path.iterdir())).curves
    assert len(found) == len(built) == 6


def test_names_that_a_terminal_would_obey(tmp_path):
    shot = "time_us,radius_um\n" + PLAIN
    path = tmp_path / "gel\udce9\x1b[31m.csv"
    path.write_text(shot)
    (curve,) = read_curves(path)
    assert curve.name == "gel\\xe9\\x1b[31m"
    assert (curve.name + curve.group + curve.source).isprintable()
    with pytest.raises(InputError) as error:
        read_curves(path.with_name("no\udcff\n.csv"))
    assert str(error.value).isprintable()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["\x1b[31m/time"], file["\x1b[31m/radius"] = TIME, RADIUS
    assert read_curves(tmp_path / "a.h5")[0].name.isprintable()


def test_what_the_words_of_a_command_stand_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.csv", "a.mat", ".hidden.csv", "notes.md", "result.csv", "result.json", "shots.csv", "sub/c.h5"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    said = []
    assert [str(path) for path in expand(["."], said.append)] == ["a.mat", "b.csv", "shots.csv"]
    assert said == [".: 3 files; 3 others left out"]
    assert [str(path) for path in expand(["missing.csv", "*.csv", "b.csv", "**/*.h5"])] == [
        "missing.csv", "b.csv", "result.csv", "shots.csv", "sub/c.h5",
    ]  # fmt: skip
    (tmp_path / "x[1].csv").touch()
    assert [str(path) for path in expand(["x[1].csv", "n" * 300])] == ["x[1].csv", "n" * 300]
    for word, code in (("*.xlsx", "files.no_match"), ("empty", "files.none_in_folder")):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(InputError) as error:
            expand([word])
        assert error.value.code == code


def test_standard_input_is_a_file_for_as_long_as_the_program_runs(monkeypatch):
    content = ("time_us,radius_um\n" + PLAIN).encode("utf-16")
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content)))
    tidy()  # of what another test may have sent
    first, second = expand(["-"]), expand(["-"])
    (curve,) = read_curves(*first)
    assert first == second
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)
    assert (curve.name, curve.source) == ("standard input", "standard input")
    tidy()
    assert not first[0].parent.exists()
