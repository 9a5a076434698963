"""Files in, curves out: every format on a file written here, bad files refused in words, and the published files."""

import zipfile
from pathlib import Path

import files
import numpy as np
import pytest
from bombs import element, mat, zeros
from conftest import code_of, error_of, refused
from files import R_MAX, R_STAR, RADIUS, T_STAR, TIME, Make, bdt_variables, hdf5, lines, put, saved, text_table
from scipy.io import loadmat, savemat

from cavirheo import RadiusCurve, read_curves
from cavirheo.io import write_csv
from cavirheo.io.files import expand
from cavirheo.io.shots import read_shots

US, UM = TIME * 1e6, RADIUS * 1e6
FRAMES, RATE = np.arange(1.0, 1.0 + len(TIME)), 1.0 / (TIME[1] - TIME[0])
PLAIN, GERMAN = lines(",", US, UM), lines(";", US, UM, comma=True)


@pytest.mark.parametrize("save", [savemat, files.save_v73], ids=["v5", "v7.3"])
def test_bdt_cells_become_seconds_and_metres_with_each_shots_own_maximum(tmp_path, save):
    radii = (R_STAR, R_STAR, R_STAR, [], R_STAR[:3], np.full(180, np.nan), R_STAR)
    times = (T_STAR, T_STAR, T_STAR, [], T_STAR[:3], T_STAR, T_STAR)
    maxima = (1e-4, 2e-4, 3e-4, 0.0, 1e-4, 1e-4, 0.0)
    other = {"Rnew": files.cells(*[RADIUS] * 7), "err": files.cells(*[RADIUS] * 7)}
    save(tmp_path / "gel.mat", bdt_variables(radii, times, maxima) | other)
    curves = read_curves(tmp_path / "gel.mat", density=1025.0)
    assert [c.name for c in curves] == [f"gel[{k}]" for k in range(1, 8)]
    for curve, maximum in zip(curves[:3], maxima, strict=False):
        assert curve.max_radius == pytest.approx(maximum, rel=0.01)
        assert np.allclose(curve.time, T_STAR * maximum * np.sqrt(1025.0 / 101325.0))
        assert (curve.stretch, curve.stretch_std) == (6.5, 0.4)
        assert (curve.group, curve.group_source) == ("gel", str(tmp_path / "gel.mat"))
        assert len(curve.source_sha256) == 64
        assert any("density 1025 kg/m3" in note for note in curve.notes)
        assert any("before R_max (growth)" in note for note in curve.notes)
        assert any("not used: Rnew" in note for note in curve.notes)
    codes = ["curve.unusable", "curve.few_frames", "curve.few_frames", "curve.unusable"]
    assert [code_of(lambda curve=curve: curve.max_radius) for curve in curves[3:]] == codes


SHOT = {"a/time": TIME, "a/radius": RADIUS, "b/time": TIME, "b/radius": RADIUS}
BROKEN = {  # a file whose second shot is none, and why
    "empty cell": (saved(R=files.cells(RADIUS, []), t=TIME), "R{2} is empty"),
    "short cell": (saved(R=files.cells(RADIUS, RADIUS[:90]), t=TIME), "different lengths: 90 of R{2} and 180 of t"),
    "two radii": (hdf5(SHOT | {"b/R": RADIUS}), "'b/R' and 'b/radius'"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_part_that_is_no_shot_costs_the_others_nothing(tmp_path, name):
    content, why = BROKEN[name]
    sound, broken = read_curves(put(tmp_path / "a.mat", content))
    assert sound.max_radius == pytest.approx(R_MAX, rel=0.01)
    assert why in str(error_of(lambda: broken.max_radius))


def test_constants_that_a_file_states_or_shows(tmp_path):
    """Its pressure and density make seconds and are those of the shot; a density may also be told by the rate."""
    savemat(tmp_path / "gel.mat", bdt_variables() | {"rho": 1060.0, "P_inf": 9e4})
    curve = read_curves(tmp_path / "gel.mat", density=998.0)[1]
    assert np.allclose(curve.time, T_STAR * 2e-4 * np.sqrt(1060.0 / 9e4))
    assert curve.medium == {"density": 1060.0, "pressure": 9e4}
    t = np.arange(-10, 80) * 1e-6 / (R_MAX * np.sqrt(1025.0 / 101325.0))
    savemat(tmp_path / "round.mat", bdt_variables([np.interp(t, T_STAR, R_STAR)], [t], [R_MAX]))
    assert "--density 1025" in read_curves(tmp_path / "round.mat", density=998.0)[0].warnings[0].text
    assert read_curves(tmp_path / "round.mat", density=1025.0)[0].warnings == ()


def book(hidden=(), **tabs):
    return lambda path: files.write_xlsx(path, tabs, hidden=hidden)


HEAD, META = "time_us,radius_um\n", "Camera: Phantom v2512\nOperator: A, B\n\n"
SHEET, OTHER = ([["time_us", "radius_um"], *zip(US, radius, strict=True)] for radius in (UM, 2 * UM))
RECORDS = np.rec.fromarrays([US, UM, FRAMES], names="time_us,radius_um,flag")
TRACK = "LABEL,POSITION_T,FRAME,RADIUS\nLabel,T,Frame,Radius\n,(sec),,(micron)\n"


def array(values: object) -> Make:
    return lambda path: np.save(path.open("wb"), values)


def packed(path):
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in {"t_us": US, "R_um": UM, "about": np.array({"gel": 1})}.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.save(file, values)
        archive.writestr("read.me", "no array")


ROWS_OF_TEXT, TWO = PLAIN.splitlines(keepends=True), lines(",", US, UM, 1.5 * UM)


def within(text, at=30):
    """The plain table with a line of its own in its middle."""
    return HEAD + "".join([*ROWS_OF_TEXT[:at], text + "\n", *ROWS_OF_TEXT[at:]])


def mixed(title):
    gels = {"soft": 1.0, "stiff": 1.5}
    rows = (f"{t},{gel},{gels[gel] * r}\n" for t, r in zip(US, UM, strict=True) for gel in gels)
    return f"time_us,{title},radius_um\n" + "".join(rows)


def labels(*names):
    """Two shots below each other, their labels by row."""
    both = lines(",", US, UM).splitlines() + lines(",", US, 1.5 * UM).splitlines()
    return "shot,time_us,radius_um\n" + "".join(f"{name},{row}\n" for name, row in zip(names, both, strict=True))


N = len(US)
WITHOUT_TIMES = [["time_us", "radius_um"], *([None, radius] for radius in UM)]
GAP = [["time_us", None, "radius_um"], *zip(US, [None] * len(US), UM, strict=True)]
ONE_SHOT = {  # one curve, and what its notes must say (nothing: it is ordinary)
    "metres": ("t (s);R (mm)\n" + "".join(map("{:.9g};{:.9g}\n".format, TIME, 1e3 * RADIUS)), ""),
    "neither titles nor units": (lines("\t", US, UM), "no header"),
    "no units": ("t,R\n" + PLAIN, "taken as um"),
    "minus signs": (HEAD + PLAIN.replace("-", "−"), ""),
    "German": ("Zeit (µs);Blasenradius (µm)\n" + GERMAN, "decimal commas"),
    "lines above": (META + HEAD + PLAIN, "2 lines above the titles"),
    "comments of MATLAB": ("% " + META.replace("\n", "\n% ") + "\n% time_us,radius_um\n" + PLAIN, "only constants"),
    "unit row": ("Time,Radius\nus,um\n" + PLAIN, "below the titles: us, um"),
    "quoted": ('"time_us","radius_um"\n' + lines('","', US, UM).replace("\n", '"\n"').join('""')[:-1], ""),
    "diameter": ("time_us,diameter_um\n" + lines(",", US, 2 * UM), "diameters halved"),
    **{f"{name} text": (f"time_µs,radius_µm\n{PLAIN}".encode(name), "") for name in ("utf-8-sig", "utf-16", "latin-1")},
    "first visible tab": (book(no=OTHER, a=GAP, b=OTHER, hidden=["no"]), "'no (hidden)', 'b'"),
    "tabs of other titles": (book(a=GAP, b=OTHER), "with other titles than 'a': 'b'"),
    "open document": (lambda path: files.write_ods(path, "".join(map(files.ods_row, SHEET))), "workbook: 'a'"),
    "HDF5 title in Latin 1": (hdf5({b"t_\xb5s": US, b"R_\xb5m": UM, b"notes \xb5": UM[:3]}), "not used: notes µ"),
    "TrackMate": (TRACK + lines(",", FRAMES, TIME, FRAMES, UM), "not used: LABEL"),
    "array of records": (array(RECORDS), "not used: flag"),
    "MATLAB micrometres": (saved(Rnew=UM, t=TIME), "taken as um"),
    "MATLAB pixels": (saved(Rnew=UM / 2.76, deltax=2.76e-6, deltat=TIME[1] - TIME[0]), "deltax"),
    "HDF5 deviation": (hdf5({"time": TIME, "radius": RADIUS, "radius_std_um": UM}), "'radius_std_um'"),
    "attributes": (hdf5({"t": US, "R_um": UM, "t@unit": "us", "@time": "noon", "@_v": 1, "@fit": 1}), "@fit, @time"),
    "times and radii in a matrix": (saved(Rt=np.c_[TIME, RADIUS]), "Rt is taken as times and radii"),
    "a simulation alone": (hdf5({"sim/t_us": US, "sim/R_um": UM, "G": 1e3}), "not used: G"),
    "stated": (f"# fps: {RATE}\nframe,R_px,um_per_px\n" + lines(",", FRAMES, UM / 3.2, 0 * UM + 3.2), "um per pixel"),
    "arrays of numpy": (packed, "not used: about, read.me"),
    "lost frame": (within("0,0"), "1 rows with time 0 and no radius"),
    "no time": (within("inf,100"), "1 of 181 frames without a time"),
    "comments in the data": (within("#7,100\n# focus"), "'#7,100': only constants are used"),
}  # fmt: skip


@pytest.mark.parametrize("name", ONE_SHOT)
def test_one_shot_as_laboratories_write_it(tmp_path, name):
    content, said = ONE_SHOT[name]
    (curve,) = read_curves(put(tmp_path / "a.csv", content))
    assert np.allclose(np.diff(curve.time), np.diff(TIME), atol=1e-12)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-6)
    assert said in "\n".join([*curve.notes, *curve.hints])
    assert said or len(curve.notes) == 1
    assert curve.warnings == ()


CAMERA = {"frame_rate_hz": 1e6, "um_per_px": 3.2}
MEASURED = {  # of frames or pixels: what is asked for, and what the notes say when it is given
    "diameters in pixels": ("time_us,D (px)\n" + lines(",", FRAMES, UM / 1.6), ["um-per-px"], "halved"),
    "time in frames": ("time (frames),R_um\n" + lines(",", FRAMES, UM), ["fps"], "1e+06 frames per second"),
    "numbers without a unit": ("t,R_um\n" + lines(",", FRAMES, UM), ["fps", "time_us"], "numbers in 't'"),
    "rounded a little": ("time_us,R_um\n" + lines(",", np.round(1.7 * FRAMES), UM), [], "few digits"),
    "radii alone": ("R_px\n" + lines(",", UM / 3.2), ["fps"], "of the rows"),
}


@pytest.mark.parametrize("name", MEASURED)
def test_frames_and_pixels_ask_for_the_camera(tmp_path, name):
    content, asked, said = MEASURED[name]
    path = put(tmp_path / "a.csv", content)
    if asked:
        assert all(word in str(error_of(lambda: read_curves(path)[0].max_radius)) for word in asked)
    else:
        assert [warning.code for warning in read_curves(path)[0].warnings] == ["check_input.time_digits"]
    (curve,) = read_curves(path, **CAMERA)
    assert np.allclose(np.diff(curve.time), 1e-6)
    assert np.allclose(curve.radius, RADIUS, rtol=1e-4)
    assert said in "\n".join(curve.notes)


DOUBTFUL = {  # a file, options, and codes of its warnings
    "a second shot after a pause": (HEAD + lines(",", np.r_[US, US + 500], np.r_[UM, 1.5 * UM]), {}, "time_gap"),
    "an ellipse": ("t_us,a_um,b_um\n" + lines(",", US, 1.06 * UM, UM), {}, "aspherical"),
    "nearly a sphere": ("t_us,a_um,b_um\n" + lines(",", US, 1.02 * UM, UM), {}, ""),
    "its own rate": (HEAD + PLAIN, {"frame_rate_hz": 1.005 * RATE}, ""),
    "radii alone": (lines(",", UM), {"frame_rate_hz": RATE}, ""),
    "another rate": (HEAD + PLAIN, {"frame_rate_hz": 1.05 * RATE}, "rate_unused"),
    "another rate of MATLAB": (saved(R=RADIUS, t=TIME, fps=2 * RATE), {}, "rate_unused"),
    "a scale of no pixels": (HEAD + PLAIN, {"um_per_px": 3.2}, "scale_unused"),
    "its own scale": (saved(R_um=UM, t=TIME, deltax=3.2e-6), {"um_per_px": 3.2}, ""),
    "one stretch twice": (saved(R=RADIUS, t=TIME, R_eq=25e-6, lambda_max=8.1), {}, ""),
    "a radius at rest above R_max": (saved(R=RADIUS, t=TIME, R_eq=3e-4), {}, "at_rest"),
    "two stretches": (saved(R=RADIUS, t=TIME, R_eq=25e-6, lambda_max=6.0), {}, "stretches"),
    "another scale": (saved(R_px=UM / 3.0, t=TIME, deltax=3.2e-6), {"um_per_px": 3.0}, "camera_differs"),
    "one of a comment": ("# um_per_px: 3.2\nt_us,R_px\n" + PLAIN, {"um_per_px": 3.0}, "camera_differs"),
    "one above the titles": ("Scale,3.2 µm/pixel\nt_us,R_px\n" + PLAIN, {"um_per_px": 3.0}, "camera_differs"),
}


@pytest.mark.parametrize("name", DOUBTFUL)
def test_what_contradicts_is_a_doubt_and_changes_no_times(tmp_path, name):
    content, options, code = DOUBTFUL[name]
    (curve,) = read_curves(put(tmp_path / "a.csv", content), **options)
    assert [warning.code for warning in curve.warnings] == [f"check_input.{code}"] * bool(code)
    assert np.allclose(np.diff(curve.time[: len(TIME)]), np.diff(TIME), atol=1e-12)
    beside = read_shots([tmp_path / "a.csv", "film.mp4"], **options).curves[0]  # of which the options are then
    assert beside.warnings == (() if options and "unused" in code else curve.warnings)


def test_deviations_follow_the_unit_and_the_kind_of_the_radius(tmp_path):
    given = {"R_um,err_um": (1.0, 1.2), "R_px,sd": (1 / 3.2, 1.2 / 3.2), "D_um,dD_um": (2.0, 2.4)}
    given |= {"R_um,err_nm": (1.0, 1.2e3), "R_um,sd (%)": (1.0, np.nan), "Area (um^2),StdDev": (1.0, np.nan)}
    for titles, (factor, deviation) in given.items():
        path = text_table(tmp_path / "a.csv", f"t_us,{titles}", US, factor * UM, 0 * UM + deviation)
        (curve,) = read_curves(path, um_per_px=3.2)
        expected = np.nan if "%" in titles or "Area" in titles else 1.2e-6
        assert np.allclose(curve.radius_std, expected, equal_nan=True), titles


GROUPS = {"first/time": TIME, "first/radius": RADIUS, "unrelated": UM[:3]}
GROUPS |= {"series/second/time_us": US, "series/second/radius_um": 1.5 * UM}
RADII = lines(",", US, UM, 1.5 * UM)
BLOCKS = lines(",", [0.0, -1000.0, *US, -1000.0, *US], [7e-310, -1000.0, *UM, -1000.0, *1.5 * UM])
SIMULATED = hdf5(GROUPS | {"sim/time": TIME, "sim/radius": 1.1 * RADIUS, "sim/rho": 1060.0})
STRUCTS = saved(data=np.array([[(RADIUS, TIME), (1.5 * RADIUS, TIME)]], [("R", "O"), ("t", "O")]), G=1.0)
TABS = book(one=SHEET, notes=[["gel"]], two=[SHEET[0], *zip(US, 1.5 * UM, strict=True)])
SEVERAL = {  # two curves, their names, and what each says
    "German": (f"Zeit_us,Schuss 0 [µm],Schuss 1 [µm]\n{RADII}", "Schuss 0", "Schuss 1", "2 columns of radii"),
    "a simulation": (SIMULATED, "first", "series/second", "not used: sim/radius, sim/rho, sim/time, unrelated"),
    "rows above the labels": (labels(*[""] * N, *["B"] * N), "unlabelled", "B", "blank cells of 'shot' filled"),
    "unit row": (f"Time,shot 1,shot 2\nus,um,um\n{RADII}", "shot 1", "shot 2", "2 columns of radii"),
    "blocks": (BLOCKS, "1", "2", "rows with radius <= 0 left out"),
    "HDF5 groups": (hdf5(GROUPS | {"first/stretch": 7.0}), "first", "series/second", ""),
    "sheets": (TABS, "one", "two", "'notes'"),
    "MATLAB array of structs": (STRUCTS, "data(1)", "data(2)", "not used: G"),
    "MATLAB numbers": (saved(R1=RADIUS, t1=TIME, R2=1.5 * RADIUS, t2=TIME, R0=1.0), "R1", "R2", "not used: R0"),
    "blank labels": (labels("A", *[""] * (N - 1), "B", *[""] * (N - 1)), "A", "B", "blank cells of 'shot' filled"),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_several_curves_of_one_file(tmp_path, name):
    content, one, other, said = SEVERAL[name]
    curves = read_curves(put(tmp_path / "a.csv", content))
    assert [curve.name for curve in curves] == [f"a[{one}]", f"a[{other}]"]
    assert np.allclose([curve.time for curve in curves], TIME, atol=1e-12)
    assert np.allclose([curve.radius for curve in curves], [RADIUS, 1.5 * RADIUS], rtol=1e-6)
    assert all(any(said in note for note in curve.notes) for curve in curves)
    assert curves[0].stretch == (7.0 if name == "HDF5 groups" else None)


def test_what_is_cleaned_is_counted(tmp_path):
    """Two wild frames do not decide the unit; what is doubtful is a warning, whatever R_max is."""
    r = UM.copy()
    r[:2] = [-3.0, 0.0]
    r[50], r[51] = np.nan, 1e300  # a number that no recording has
    r[[10, 100]] = 4e5
    t = np.concatenate([US, US[60:63], [np.nan, -2e12]])
    r = np.concatenate([r, r[60:63] + 2.0, [100.0, 100.0]])
    (curve,) = read_curves(text_table(tmp_path / "a.csv", "time_us,radius_um", t, r))
    assert np.allclose(curve.time, TIME, atol=1e-12)
    assert np.flatnonzero(np.isnan(curve.radius)).tolist() == [0, 1, 50, 51]
    assert curve.radius[60:63] == pytest.approx(RADIUS[60:63], rel=1e-6)
    assert curve.max_radius == pytest.approx(R_MAX, rel=0.01)
    counts = ("not measured: 2", "2 of 183 frames", "2 of 185 frames", "3 frames", "2 single frames stand out")
    assert [said for said in counts if said not in "\n".join(curve.notes)] == []
    (late,) = read_curves(text_table(tmp_path / "b.csv", "time_us,radius_um", US[::-1], UM[::-1]))
    for one in (late, late.with_max_radius(R_MAX)):
        assert [warning.code for warning in one.warnings] == ["check_input.time_order"]


UNITS = {  # what is said of a radius of this unit and factor
    "write m into": ("um", 1.0),
    "write mm into": ("um", 1e3),
    "looks like R/R_max": ("um", 1.0 / R_MAX),
    "in pixels": ("px", 1.0 / 2.76e-6),
}


@pytest.mark.parametrize("said", UNITS)
def test_wrong_units_are_recognised(tmp_path, said):
    unit, factor = UNITS[said]
    (curve,) = read_curves(text_table(tmp_path / "a.csv", f"time_us,radius_{unit}", US, RADIUS * factor))
    assert any(said in text for text in (*curve.notes, curve.unscaled))
    assert code_of(lambda: curve.max_radius) == "curve.unscaled"
    assert np.allclose(curve.with_max_radius(R_MAX).radius, RADIUS, rtol=0.01)


def test_csv_round_trip(tmp_path):
    curve = RadiusCurve(TIME, np.ma.masked_array(RADIUS, FRAMES == 4), np.linspace(1e-6, 2e-6, len(TIME)))
    write_csv(tmp_path / "a.csv", curve, "simulation of a,=1+1;@b\n, +c")
    (back,) = read_curves(tmp_path / "a.csv")
    for name in ("time", "radius", "radius_std"):
        assert np.allclose(getattr(back, name), getattr(curve, name), rtol=1e-9, equal_nan=True)
    assert np.flatnonzero(np.isnan(back.radius)).tolist() == [3]
    assert (tmp_path / "a.csv").read_text().startswith("# simulation of a =1+1 @b\\x0a  +c\n")


OBJECT = element(14, element(6, b"\x11" + bytes(7)) + 3 * element(1, b"T") + zeros("", 6))


def archive(*names):
    def write(path):
        with zipfile.ZipFile(path, "w") as made:
            for name in names:
                made.writestr(name, "time_us,radius_um\n1,2\n")

    return write


BAD = {  # content, or what writes it; code; what is named
    "empty.mat": (b"", "reading.empty", "time_us,radius_um"),
    "prose.mat": (b"Dear reader,\nthis is a letter.\n", "table.columns", "'letter.'"),
    "words.csv": (b"time_us,radius_um\n1,2\n2,three\n", "tabular.number", "row 3, column 'radius_um': 'three'"),
    "commas.csv": (b"time_us,radius_um\n1,5,200,3\n", "tabular.width", "row 2 has 4 cells"),
    "camera.csv": (f"Camera\nFrame,118\nt (s),L (mm),N\n{TWO}", "table.columns", "among 't (s)', 'L (mm)', 'N'"),
    "chinese.csv": (f"时间(us),半径(um)\n{PLAIN}".encode("gbk"), "table.columns", "save it as CSV UTF-8"),
    "rows.json": ('[{"time_us": 0.0, "radius_um": 195.9},\n', "table.columns", "JSON is not read: save a CSV"),
    "twice.csv": (b"time_us,radius_um,radius_um\n1,2,3\n", "table.twice", "two readings of one bubble"),
    "packed.csv.gz": (b"\x1f\x8b\x08" + bytes(600), "reading.binary", "unpack what is packed"),
    "swapped.csv": (b"time_um,radius_us\n1,2\n", "table.units", "time in um and radius in us"),
    "means.csv": (b"time_us,radius_um\n1,100\nMean,3\nStd.,4\n", "tabular.number", "'Mean' is not a number"),
    "objects.npy": (array(np.array([{"a": 1}], object)), "tabular.array", "numbers"),
    "other.mat": (saved(G=1.0, speed=np.arange(3.0)), "matlab.variables", "G, speed"),
    "units.h5": (hdf5({"t_us": US, "R_um": UM, "R_um@units": "mm"}), "tabular.units", "'mm' as its attribute"),
    "contradict.csv": ("t_us,R_um,D_um\n" + lines(",", US, UM, UM), "table.twice", "'D_um' is 1 times 'R_um'"),
    "matrix.mat": (saved(Rt=np.c_[TIME, RADIUS, RADIUS]), "matlab.cells", "a column that always rises"),
    "lost frames.csv": ("t,R_um\n" + lines(",", np.r_[0:9, 11:20], UM[:18]), "table.frame_rate", "time_us"),
    "BDT.mat": (saved(**{**bdt_variables(), "RmaxList": []}), "matlab.variables", "no RmaxList"),
    "old.mat": (lambda path: savemat(path, {"R": RADIUS, "t": TIME}, format="4"), "reading.binary", "'-v7'"),
    "object.mat": (mat(OBJECT), "matlab.variables", "table2struct"),
    "old.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "reading.damaged", ""),
    "shots.zip": (archive("gel_1.csv", "gel_2.csv"), "tabular.archive", "gel_1.csv, gel_2.csv"),
    "labels of another name.csv": (mixed("variable"), "curve.unusable", 'name the column of their labels "shot"'),
    "A and B.csv": (f"t_us,A (um),B (um)\n{TWO}", "table.twice", "'A (um)', 'B (um)': shots, or the half-axes"),
    "A to D.csv": (f"t,A,B,C,D\nus,um,um,um,um\n{lines(',', US, *[UM] * 4)}", "table.twice", "no name says which"),
    "formulas.xlsx": (book(a=WITHOUT_TIMES), "table.empty", "formulas"),
    "radii.xlsx": (book(a=[SHEET[0], *zip(US, [None] * N, strict=True)]), "table.empty", "is empty; formulas"),
    "hidden.xlsx": (book(("raw",), notes=[["see raw"]], raw=[["time_us", "R_um"]]), "table.columns", "raw (hidden)"),
    "missing.mat": (lambda path: path.symlink_to("gone"), "reading.missing", "is a link to gone, which does not exist"),
    "folder": (Path.mkdir, "reading.folder", ""),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_words(tmp_path, name):
    content, code, named = BAD[name]
    path = put(tmp_path / name, content)
    for options in ({}, {"frame_rate_hz": RATE}) if name.startswith("labels") else ({},):
        with refused(code, path.stem, named):
            [curve.max_radius for curve in read_curves(path, **options)]


CASES = Path(__file__).parents[1] / "cases" / "read"
STATED = {"density": 1060.0, "pressure": 83000.0}
OF_LABORATORIES = {  # what is asked for if no camera is given; what the notes say; medium and stretch; other curves
    "01_gui_rho.mat": ("", "Pinf = 83000 Pa", STATED, 7.0),
    "07_px.csv": ("--um-per-px", "in pixels"),
    "08_imagej.csv": ("--fps --um-per-px", "sqrt(A/pi)"),
    "09_axes.csv": ("", "half-axes"),
    "10_pairs.csv": ("", "2 columns of radii"),
    "11_err.csv": ("", "'err_um'"),
    "12_fortran.dat": ("", ""),
    "13_div0.csv": ("", "1 of 118 frames"),
    "16_ms_rounded2.csv": ("--fps", "too few digits"),
    "18_concat.csv": ("", "shot 1 of 2"),
    "23_thousands.csv": ("", "marks between thousands"),
    "24.npy": ("", "numpy"),
    "28_struct.mat": ("", "not used: expts/R0", {}, 7.0),
    "30_time_radius.mat": ("", "taken as m"),
    "30_texp_Rexp.mat": ("", "not used: t_sim, R_sim", {"density": 998.0, "pressure": 101325.0}, None),
    "32_Radius_px.mat": ("--fps --um-per-px", "in pixels"),
    "70_second_sheet.xlsx": ("", "not read: 'Info'"),
}


@pytest.mark.parametrize("name", OF_LABORATORIES)
def test_files_of_laboratories(name):
    asked, said, medium, stretch = (*OF_LABORATORIES[name], {}, None)[:4]
    if asked:
        refusal = error_of(lambda: read_curves(CASES / name)[0].max_radius)
        assert [option for option in asked.split() if option not in str(refusal)] == []
    given = CAMERA if "um-per-px" in asked else {"frame_rate_hz": 1e6}
    for camera in (given,) if asked else ({}, given):
        curve, *others = read_curves(CASES / name, **camera)
        assert curve.max_radius == pytest.approx(245e-6, rel=0.03)
        assert curve.frame_rate == pytest.approx(1e6)
        assert dict(curve.medium) == medium
        assert curve.stretch == (stretch and pytest.approx(stretch, rel=0.02))
        assert np.isfinite(curve.radius_std).any() == (name == "11_err.csv")
        assert said in "\n".join(curve.notes)
        assert curve.warnings == ()
        assert len(others) == (name in ("10_pairs.csv", "18_concat.csv"))


def test_a_group_states_the_constants_of_its_shots(tmp_path):
    """Those of the group, in any unit, before those around it; what is no constant of a medium is named."""
    about = {"a/density": 1060.0, "a/c": 2.0, "medium/pressure_kPa": 83.0, "medium/rho": 1010.0, "gamma": 1.4}
    both = {f"{group}/{name}": data for group in "ab" for name, data in (("time", TIME), ("radius", RADIUS))}
    one, other = read_curves(put(tmp_path / "a.h5", hdf5(both | about | {"a/R_eq": 25e-6})))
    assert dict(one.medium) == {"density": 1060.0, "pressure": 83000.0}
    assert dict(other.medium) == {"density": 1010.0, "pressure": 83000.0}
    assert (one.stretch, other.stretch) == (pytest.approx(8.0, rel=0.01), None)
    (note,) = (note for note in one.notes if note.startswith("not used"))
    assert {"a/c", "gamma", "medium/rho"} == {*note.removeprefix("not used: ").split(", ")}


BOTH, DENSE = np.stack([RADIUS, 1.5 * RADIUS]), "time_us,radius_um,density (g/cm3)\n"
OF_EACH = {  # what a file states of each of its shots; 0: what it gives is not used
    "column of R_eq": ("t_us,R_um,R_eq_um\n" + lines(",", US, UM, 0.0 * UM + 25), "stretch", [8.0]),
    "R1_eq of R": (saved(t=TIME, R=RADIUS, R1_eq=25e-6), "stretch", [8.0]),
    "numbered R_eq": (saved(t=TIME, R1=RADIUS, R2=RADIUS, R1_eq=25e-6, R2_eq=50e-6), "stretch", [8.0, 4.0]),
    "array": (saved(t=TIME, R=BOTH, rmax_um=[210.0, 290.0]), "max_radius", [210e-6, 290e-6]),
    "array for numbers": (saved(t=TIME, R1=RADIUS, R2=RADIUS, rho=[1e3, 1060.0]), "density", [1e3, 1060.0]),
    "array of another length": (saved(t=TIME, R=BOTH, rho=[1e3, 1020.0, 1060.0]), "density", [0, 0]),
    "column": (DENSE + lines(",", US, UM, 0.0 * UM + 1.06), "density", [1060.0]),
    "column that changes": (DENSE + lines(",", US, UM, UM), "density", [0]),
    "comment": ("# density 1.06 g/cm3\n" + HEAD + PLAIN, "density", [1060.0]),
    "comment in unknown units": ("# density 62 lb/ft3\n" + HEAD + PLAIN, "density", [0]),
    "attribute": (hdf5({"t_us": US, "R_um": UM, "@rho": 1060.0}), "density", [1060.0]),
}


@pytest.mark.parametrize("name", OF_EACH)
def test_what_a_file_states_is_of_the_shot_that_it_is_said_of(tmp_path, name):
    content, what, values = OF_EACH[name]
    curves = read_curves(put(tmp_path / "a.mat", content))
    found = [curve.medium.get(what, 0) if what == "density" else getattr(curve, what) for curve in curves]
    assert found == pytest.approx(values, rel=0.01)
    assert [curve.meta["ignored"] for curve in curves] == [[] if value else [what] for value in values]


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


def test_what_the_words_of_a_command_stand_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = "b.csv a.mat .hidden.csv n.md result.csv result.json shots.csv sub/c.h5 x/1.png x/2.png x/.3.png y/x/1.png"
    for name in names.split():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).touch()
    said = []
    assert [str(path) for path in expand(Path("."), said.append)] == ["a.mat", "b.csv", "shots.csv"]
    assert "2 images: at least 3 are needed" in str(error_of(expand, Path("x")))
    (tmp_path / "x" / "3.png").touch()
    for content, taken in (("{}", "x"), (HEAD + PLAIN, "x/a.csv"), ("1,2\n2,three", "x/a.csv")):
        (tmp_path / "x" / "a.csv").write_text(content)
        assert expand(Path("x"), said.append) == [Path(taken)]
    expand(Path("."), said.append)
    both = "x: 1 file; 3 others left out; it holds images, too: move a.csv away to measure the images"
    first, images = ".: 3 files; 3 others left out", "x: its images are one recording; left out: a.csv"
    assert said == [first, images, both, both, f"{first}; folders of images (x) left out: give each by name"]
    (tmp_path / "x").rename(tmp_path / "y" / "z")
    assert "it holds folders of images (z): give each" in str(error_of(expand, Path("y")))
    (tmp_path / "x[1].txt").touch()
    (tmp_path / "empty").mkdir()
    words = {"*.csv": ["b.csv", "result.csv", "shots.csv"], "**/*.h5": ["sub/c.h5"]}
    words |= {name: [name] for name in ("missing.csv", "b.csv", "x[1].txt", "n" * 300)}
    assert {word: [str(path) for path in expand(Path(word))] for word in words} == words
    assert code_of(lambda: expand(Path("*.xlsx"))) == "files.no_match"
    assert code_of(lambda: expand(Path("empty"))) == "files.none_in_folder"
