"""Files in, curves out: every format on a file written here, bad files refused in words, and the published files."""

import io
import pickle
import zipfile
from contextlib import suppress
from pathlib import Path

import files
import h5py
import numpy as np
import pytest
from conftest import code_of, refused
from files import R_MAX, R_STAR, RADIUS, T_C, T_STAR, TIME, bdt_variables, lines, save_v73, text_table
from scipy.io import loadmat, savemat

from cavirheo import InputError, RadiusCurve, read_curves
from cavirheo.inference import input_checks
from cavirheo.io import write_csv
from cavirheo.io.files import expand
from cavirheo.io.option_tables import read_trace
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.io.subprocess_reader import KINDS
from cavirheo.physics.driving import Trace
from cavirheo.physics.media import WATER
from cavirheo.writing.packing import decode, encode


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
    codes = ["curve.unusable", "curve.few_frames", "curve.few_frames", "curve.unusable"]
    assert [code_of(lambda curve=curve: curve.max_radius) for curve in curves[:4]] == codes
    assert curves[4].max_radius == pytest.approx(2e-4, rel=0.01)


@pytest.mark.parametrize("kind", [h5py.ref_dtype, np.dtype([("a", "f8")]), "c16", "S3"], ids=str)
def test_a_cell_without_real_numbers_is_an_empty_one(tmp_path, recwarn, kind):
    save_v73(tmp_path / "gel.mat", bdt_variables())
    with h5py.File(tmp_path / "gel.mat", "r+") as file:
        file["R_nondim_All"][1, 0] = file.create_dataset("other", (180, 1), kind).ref
        file["RmaxList"].attrs["MATLAB_empty"] = np.zeros(2, [("a", "f8")])
    curves = read_curves(tmp_path / "gel.mat")
    assert curves[2].max_radius == pytest.approx(3e-4, rel=0.01)
    with pytest.raises(InputError, match="cell 2 of 3 is empty"):
        _ = curves[1].max_radius
    assert not recwarn.list


def test_bdt_without_maxima_waits_for_the_users(tmp_path):
    variables = bdt_variables()
    del variables["RmaxList"]
    savemat(tmp_path / "gel.mat", variables)
    curve = read_curves(tmp_path / "gel.mat")[0]
    assert code_of(lambda: curve.max_radius) == "curve.unscaled"
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


@pytest.mark.parametrize(
    ("variables", "note"),
    [
        ({"Rnew": RADIUS, "t": TIME}, ""),
        ({"Rnew": RADIUS * 1e6, "t": TIME}, "taken as um"),
        ({"Rnew": RADIUS / 2.76e-6, "deltax": 2.76e-6, "deltat": TIME[1] - TIME[0]}, "deltax"),
        ({"R": RADIUS * 1e6, "t": TIME}, "taken as um"),
        ({"shift_normRnew": np.stack([R_STAR, R_STAR]), "Rmax": [[200.0], [300.0]], "t": TIME - TIME[0]}, ""),
    ],
    ids=["metres", "micrometres", "pixels", "plain", "normalised"],
)
def test_imr_files(tmp_path, variables, note):
    savemat(tmp_path / "a.mat", variables)
    curve, *others = read_curves(tmp_path / "a.mat")
    assert curve.max_radius == pytest.approx(R_MAX, rel=0.01)
    assert np.diff(curve.time) == pytest.approx(np.diff(TIME))
    assert any(note in text for text in curve.notes)
    assert [other.max_radius for other in others] == pytest.approx([300e-6] * len(others), rel=0.01)


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
    r[50], r[51] = np.nan, 1e300  # a number that no recording has
    t = np.concatenate([t, t[60:63], [np.nan, -2e12]])
    r = np.concatenate([r, r[60:63] + 2.0, [100.0, 100.0]])
    (curve,) = read_curves(text_table(tmp_path / "a.csv", "time_us,radius_um", t, r))
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert np.flatnonzero(np.isnan(curve.radius)).tolist() == [0, 1, 50, 51]
    assert curve.radius[60:63] == pytest.approx(RADIUS[60:63] + 1e-6, rel=1e-6)
    counts = ("2 frames with", "2 of 183 frames", "2 of 185 frames", "3 frames")
    assert [said for said in counts if said not in "\n".join(curve.notes)] == []


@pytest.mark.parametrize(
    ("header", "factor", "says", "usable"),
    [
        ("time_us,radius_um", 1.0, "only makes sense in m", False),
        ("time_us,radius_um", 1e3, "only makes sense in mm", False),
        ("time_us,radius_m", 1e6, "only makes sense in um", False),
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
        assert code_of(lambda: curve.max_radius) == "curve.unscaled"
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
    assert np.allclose(two.radius, RADIUS, rtol=1e-6)
    gap = [-1000.0]
    blocks = text_table(
        tmp_path / "blocks.csv",
        "",
        np.concatenate([[0.0], gap, TIME * 1e6, gap, TIME * 1e6]),
        np.concatenate([[7e-310], gap, RADIUS * 1e6, gap, RADIUS * 2e6]),
    )
    curves = read_curves(blocks)
    assert [c.max_radius for c in curves] == pytest.approx([R_MAX, 2 * R_MAX], rel=0.01)
    assert [(len(c.time), c.radius.min() > 0) for c in curves] == [(len(TIME), True)] * 2
    assert any("1 blocks of the file hold no radius" in note for note in curves[0].notes)
    for factor in (0.36e6, 2.1e6):  # a scale that the collapse time contradicts is not assumed
        odd = text_table(tmp_path / "odd.csv", "", TIME * 1e6, RADIUS * factor)
        assert code_of(lambda odd=odd: read_curves(odd)) == "table.header"


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


@pytest.mark.parametrize(
    "names", [("time_um", "radius_um"), ("time", "radius_us"), ("time", "radius", "radius_std_um")]
)
def test_hdf5_units_of_another_quantity_or_of_two_kinds_are_refused(tmp_path, names):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.update(dict.fromkeys(names, RADIUS))
    assert code_of(lambda: read_curves(tmp_path / "a.h5")) == "table.units"


@pytest.mark.parametrize(("group", "name"), [(b"", b"t_\xb5s"), (b"gel \xb5/", b"time_us")])
def test_hdf5_names_in_latin_1(tmp_path, group, name):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file[group + name] = TIME * 1e6
        file[group + b"radius_um"] = RADIUS * 1e6
        file[b"notes \xb5"] = np.zeros(3)
    (curve,) = read_curves(tmp_path / "a.h5")
    assert np.allclose(curve.time, TIME)
    assert curve.meta.get("label", "") == group.decode("latin-1").strip("/")


def test_a_quoted_cell_may_hold_the_separator(tmp_path):
    path = text_table(tmp_path / "a.csv", "time_us,radius_um", TIME * 1e6, RADIUS * 1e6)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f'shot,{head},"note, if any"', *(f'"gel, 1",{row}, "a ""b"", c"' for row in rows)]))
    (curve,) = read_curves(path)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)
    assert curve.meta["label"] == "gel, 1"


@pytest.mark.parametrize(
    "text",
    [
        "time_us, pressure_kPa\n0,0\n1,-250.5\n\n2,0\n",
        "p [Pa];t (ms)\n0;0\n-250500;0,001\n0;0,002\n",
        "Ultrasound\nZeit;Druck\nµs;kPa\n0,0;0,0\n1,0;-250,5\n2,0;0,0\n",
    ],
)
def test_a_pressure_trace(tmp_path, text):
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
        (b"time_us,pressure_kPa\n", "physics.trace_shape"),
        (b"time_us,pressure_kPa\n1,0\n0,0\n", "physics.trace_values"),
        (None, "reading.missing"),
    ],
)
def test_bad_traces(tmp_path, text, code):
    if text is not None:
        (tmp_path / "p.csv").write_bytes(text)
    assert code_of(lambda: Trace(*read_trace(tmp_path / "p.csv")[:2])) == code


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


def archive(path, *names):
    with zipfile.ZipFile(path, "w") as made:
        for name in names:
            made.writestr(name, "time_us,radius_um\n1,2\n")


BAD = {  # content, or what writes it; code; what is named
    "empty.mat": (b"", "reading.empty", "time_us,radius_um"),
    "prose.mat": (b"Dear reader,\nthis is a letter.\n", "table.columns", "'Dear'"),
    "blank.csv": (b"\n\n# nothing\n", "table.empty", "time_us,radius_um"),
    "words.csv": (b"time_us,radius_um\n1,2\n2,three\n", "tabular.number", "row 3, column 'radius_um': 'three'"),
    "commas.csv": (b"time_us,radius_um\n1,5,200,3\n", "tabular.width", "row 2 has 4 cells"),
    "twice.csv": (b"time_us,radius_um,radius_um\n1,2,3\n", "table.twice", "radius"),
    "swapped.csv": (b"time_um,radius_us\n1,2\n", "table.units", "time in um and radius in us"),
    "numbers.csv": (b"1,2\n2,3\n", "table.header", "time_us,radius_um"),
    "one comma.csv": (b"t_us;R_um\n1,234;100\n2,345;120\n", "tabular.comma", "1.234"),
    "point and comma.csv": (b"t_us;R_um\n1.5;100\n2,25;120\n", "tabular.comma", "2.25"),
    "frames.csv": (b"frame,R_um\n1,100\n2,110\n", "table.frame_rate", "'frame'"),
    "two times.csv": (b"time_s,time_us,R_um\n1,1,1\n", "table.twice", "time_us"),
    "two radii.csv": (b"t_us,R_um,R2_um\n1,1,1\n", "table.twice", "R2_um"),
    "shot and radii.csv": (b"shot,t_us,R1_um,R2_um\n1,1,1,1\n", "table.twice", "shot"),
    "two units.csv": (b"t_us,R_um\ns,um\n1,1\n", "tabular.units", "'us'"),
    "sentence.csv": (b"t_us,R\n," + b"word " * 40 + b"\n1,1\n", "tabular.units", "below the title 'R'"),
    "velocity.csv": (b"t_us,velocity\n1,1\n", "table.columns", "R1_um"),
    "means.csv": (b"time_us,radius_um\n1,100\nMean,3\nStd.,4\n", "tabular.summary", "row 4 is a Std."),
    "thousands.csv": (b"t_ns;R_um\n1,234.5;100\n2,345.5;120\n", "tabular.number", "between thousands"),
    "numbered.txt": (b"t_us R_um\n1 0 100\n2 1 110\n", "tabular.width", "row 2 has 3 cells"),
    "underscore.csv": (b"time_us,radius_um\n1_0,100\n", "tabular.number", "1_0"),
    "hollow.txt": (b"-1000,-1000\n1,0\n-1000,-1000\n", "table.empty", "-1000"),
    "noise.bin": (bytes(range(256)) * 20, "reading.binary", ""),
    "other.mat": (lambda path: savemat(path, {"G": 1.0, "speed": np.arange(3.0)}), "matlab.variables", "G, speed"),
    "times.mat": (
        lambda path: savemat(path, {"pIMR_array": np.ones((4, 3))}),
        "matlab.collapse_times",
        "collapse-time",
    ),
    "other.xlsx": (lambda path: archive(path, "[Content_Types].xml", "word/document.xml"), "tabular.workbook", ""),
    "shots.zip": (lambda path: archive(path, "gel_1.csv", "gel_2.csv"), "tabular.archive", "gel_1.csv, gel_2.csv"),
    "missing.mat": (lambda path: None, "reading.missing", ""),
    "folder": (Path.mkdir, "reading.folder", ""),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_words(tmp_path, name):
    path, (content, code, named) = tmp_path / name, BAD[name]
    _ = path.write_bytes(content) if isinstance(content, bytes) else content(path)
    with refused(code, str(path), named):
        read_curves(path)


def test_damaged_files_never_raise_anything_but_input_errors(tmp_path):
    savemat(tmp_path / "v5.mat", bdt_variables(), do_compression=True)
    save_v73(tmp_path / "v73.mat", bdt_variables())
    text_table(tmp_path / "table.csv", "time_us,radius_um", TIME * 1e6, RADIUS * 1e6)
    random = np.random.default_rng(1)
    for trial in range(60):
        name = ("v5.mat", "v73.mat", "table.csv")[trial % 3]
        content = bytearray((tmp_path / name).read_bytes())
        if trial % 2:
            content = content[: random.integers(1, len(content))]
        for place in random.integers(0, len(content), 8):
            content[place] = random.integers(256)
        damaged = tmp_path / ("damaged" + name[-4:])
        damaged.write_bytes(content)
        with suppress(InputError):
            for curve in read_curves(damaged):
                curve.resampled(1e-6, allow_short=True)
                curve.stretch_from_tail()


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
    "simulated/numsim4_NHKV_RofTdata.mat": (1, 408, 409, ()),
    "video/PAstiff_xy002_RofT.mat": (1, 384, 387, ()),
    "water_laser/laser0_timeShifted.csv": (45, 170, 315, ()),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_file(real_data, name):
    count, low, high, unusable = PUBLISHED[name]
    curves = read_curves(real_data / name)
    assert len(curves) == count
    listed = loadmat(real_data / name)["RmaxList"].ravel() if "nondim" in name else [None] * count
    for k, (curve, published) in enumerate(zip(curves, listed, strict=True)):
        if k in unusable:
            assert code_of(lambda curve=curve: curve.max_radius) == "curve.unusable"
            continue
        assert low <= curve.max_radius * 1e6 <= high
        if not name.startswith("water"):  # its recordings end in the first collapse
            rayleigh = 0.9147 * curve.max_radius * np.sqrt(998.0 / 101325.0)
            assert 0.5 < (curve.collapse_times()[0] - curve.time_of_max) / rayleigh < 1.35
        if published:
            assert curve.max_radius == pytest.approx(published, rel=0.02)
            assert abs(curve.time_of_max) < 0.2e-6  # t* = 0 is the publishers' own fit


US, UM = TIME * 1e6, RADIUS * 1e6
FRAMES = np.arange(1.0, 1.0 + len(TIME))
PLAIN, GERMAN, TABS = lines(",", US, UM), lines(";", US, UM, comma=True), lines("\t", US, UM)
META = "Camera: Phantom v2512\nOperator: A, B\n\n"
ONE_SHOT = {  # the text, what its notes must say (nothing: it is ordinary)
    "metres": ("t (s);R (mm)\n" + "".join(map("{:.9g};{:.9g}\n".format, TIME, 1e3 * RADIUS)), ""),
    "minus signs": ("time_us,radius_um\n" + PLAIN.replace("-", "−"), ""),
    "capitals": (" TIME_US , Radius_µm \n" + PLAIN, ""),
    "German": ("Zeit (µs);Blasenradius (µm)\n" + GERMAN, "360 decimal commas"),
    "French": ("temps (µs);rayon de la bulle (µm)\n" + GERMAN, "decimal commas"),
    "points above commas": ("Software;1.2.3\nUhrzeit;14.30\nZeit_us;R_um\n" + GERMAN, "360 decimal commas"),
    "Japanese": ("時間 (マイクロ秒),気泡半径 (µm)\n" + PLAIN, ""),
    "lines above": (META + "time_us,radius_um\n" + PLAIN, "2 lines above the titles"),
    "comments above": ("# " + META.replace("\n", "\n# ") + "\ntime_us,radius_um\n" + PLAIN, ""),
    "comments of MATLAB": ("% " + META.replace("\n", "\n% ") + "\n% time_us,radius_um\n" + PLAIN, "left out"),
    "unit row": ("Time,Radius\nus,um\n" + PLAIN, "units from the row below the titles: us, um"),
    "capital unit row": ("Time_us,Radius\nUS,UM\n" + PLAIN, "below the titles: US, UM"),
    "empty last column": ("time_us,radius_um,\n" + PLAIN.replace("\n", ",\n"), ""),
    "quoted": ('"time_us","radius_um"\n' + lines('","', US, UM).replace("\n", '"\n"').join('""')[:-1], ""),
    "an empty first frame": ("time_us,R_um,shot\n,,A\n" + PLAIN.replace("\n", ",A\n"), "1 of 181 frames without"),
    "numbered without a title": (",time_us,radius_um\n" + lines(",", FRAMES, US, UM), ""),
    "diameter": ("time_us,diameter_um\n" + lines(",", US, 2 * UM), "diameters halved"),
    "Durchmesser": ("Zeit_us;Durchmesser (µm)\n" + lines(";", US, 2 * UM, comma=True), "diameters halved"),
    "radius in pixels too": ("time_us,R_px,R_um\n" + lines(",", US, UM / 2.8, UM), "in pixels is not used"),
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
        ("Time,shot 1,shot 2\nus,um,um", ["shot 1", "shot 2"]),
    ],
)
def test_a_column_for_each_shot(tmp_path, titles, labels):
    (tmp_path / "a.csv").write_text(titles + "\n" + lines(",", US, UM, 1.5 * UM), encoding="utf-8")
    curves = read_curves(tmp_path / "a.csv")
    assert [curve.name for curve in curves] == [f"a[{label}]" for label in labels]
    assert np.allclose(curves[1].radius, 1.5 * RADIUS, rtol=1e-6)
    assert all(any("2 columns of radii" in note for note in curve.notes) for curve in curves)


def sheet(*columns):
    return [["time_us", *["radius_um"] * (len(columns) - 1)], *zip(*columns, strict=True)]


OTHER, GAP = sheet(US, 2 * UM), [["time_us", None, "radius_um"], *zip(US, [None] * len(US), UM, strict=True)]
COMMAS = [[f"{t:.6f}".replace(".", ","), f"{r:.6f}".replace(".", ",")] for t, r in zip(US, UM, strict=True)]
BOOKS = {
    "first visible tab": lambda path: files.write_xlsx(path, {"no": OTHER, "a": GAP, "b": OTHER}, hidden=["no"]),
    "heading and commas": lambda path: files.write_xlsx(
        path, {"a": [["Bubble data"], [None], ["Zeit", "Radius"], ["µs", "µm"], *COMMAS]}
    ),
    "tab without a name": lambda path: files.write_xlsx(path, {"": sheet(US, UM)}),
    "open document": lambda path: files.write_ods(path, "".join(map(files.ods_row, sheet(US, UM)))),
    **{
        f"{name} text": lambda path, name=name: path.write_bytes(("time_µs,radius_µm\n" + PLAIN).encode(name))
        for name in ("utf-8-sig", "utf-16", "latin-1")
    },
}


@pytest.mark.parametrize("name", BOOKS)
def test_a_workbook_and_a_text_in_any_encoding(tmp_path, name):
    """Whatever the ending of the file."""
    BOOKS[name](tmp_path / "a.csv")
    (curve,) = read_curves(tmp_path / "a.csv")
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("time_us,radius_um\n" + PLAIN, []),
        ("t,R\n" + PLAIN, []),  # no unit is no contradiction
        ("time_us,radius_um\n" + lines(",", US[::-1], UM[::-1]), ["check_input.time_order"]),
    ],
)
def test_what_is_doubtful_is_a_warning(tmp_path, text, codes):
    (tmp_path / "a.csv").write_text(text)
    (curve,) = read_curves(tmp_path / "a.csv")
    assert [one.code for one in curve.warnings] == codes
    assert [one.code for one in curve.with_max_radius(R_MAX).warnings] == codes


def test_a_message_of_a_reader_is_arrays_and_json(tmp_path):
    """What was read comes back whole; what would be executed does not come through."""
    (tmp_path / "a.csv").write_text("time_us,radius_um\n" + PLAIN)
    sent = read_shots([tmp_path / "a.csv", tmp_path / "none.csv"])
    message = encode(sent)
    assert b"pickle" not in message
    back = decode(message, KINDS)
    assert isinstance(back, CurveSet)
    assert back.problems == sent.problems
    (one,), (other,) = back.curves, sent.curves
    assert np.array_equal(one.radius, other.radius)
    assert (one.meta, one.warnings, one.maximum) == (other.meta, other.warnings, other.maximum)
    error = decode(encode(InputError("no", "a.b")), KINDS)
    assert (str(error), error.code) == ("no", "a.b")
    assert decode(encode({"a": (1, [2.5, None], "x")}), KINDS) == {"a": (1, [2.5, None], "x")}
    with pytest.raises(TypeError):
        encode(Path("x"))
    forged = io.BytesIO()
    np.savez(forged, np.frombuffer(b'{"Path": {}}', np.uint8))
    for content in (pickle.dumps(one), forged.getvalue(), message[:-30], b"1 0\n", b""):
        with pytest.raises(EOFError):
            decode(content, KINDS)


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
    (tmp_path / "empty").mkdir()
    assert code_of(lambda: expand(["*.xlsx"])) == "files.no_match"
    assert code_of(lambda: expand(["empty"])) == "files.none_in_folder"
