"""Odd files of a laboratory: what is left out or repaired is said, and a refusal names the mistake."""

import gzip
import json

import numpy as np
import pytest
from conftest import error_of
from files import RADIUS, TIME, hdf5, lines, put, saved, write_xlsx

from cavirheo import read_curves

US, UM = TIME * 1e6, RADIUS * 1e6
HEAD, PLAIN = "time_us,radius_um\n", lines(",", US, UM)
ROWS, TWO = PLAIN.splitlines(keepends=True), lines(",", US, UM, 1.5 * UM)
PADDED_T, PADDED_R = (np.r_[values[:-9], np.zeros(9)] for values in (TIME, RADIUS))
HOLED_T, HOLED_R = (np.r_[values[:-9], np.full(9, np.nan)] for values in (TIME, RADIUS))
COUNT = np.arange(len(TIME))


def within(text, at=30):
    """The plain table with a line of its own in its middle."""
    return HEAD + "".join([*ROWS[:at], text + "\n", *ROWS[at:]])


def mixed(title):
    gels = {"soft": 1.0, "stiff": 1.5}
    rows = (f"{t},{gel},{gels[gel] * r}\n" for t, r in zip(US, UM, strict=True) for gel in gels)
    return f"time_us,{title},radius_um\n" + "".join(rows)


def labels(*names):
    """Two shots below each other, their labels by row."""
    both = lines(",", US, UM).splitlines() + lines(",", US, 1.5 * UM).splitlines()
    return "shot,time_us,radius_um\n" + "".join(f"{name},{row}\n" for name, row in zip(names, both, strict=True))


def since_1970(title, second, step):
    """A frame per microsecond; `second` and `step` in the unit of the title."""
    return f"{title},R_um\n" + "".join(f"{1710237600 * second + k * step:.7f},{r}\n" for k, r in enumerate(UM))


def array(values):
    return lambda path: np.save(path.open("wb"), values)


def book(hidden=(), **tabs):
    return lambda path: write_xlsx(path, tabs, hidden=hidden)


N, TOP = len(US), np.full(len(US), UM.max())
SHEET = [["time_us", "radius_um"], *([None, radius] for radius in UM)]
TEXTS = np.rec.fromarrays([US, UM, ["ok"] * N], names="t_us,R_um,flag")
PAIRS = np.zeros(9, [("time_us", "f8"), ("radius_um", "f8", 2)])
WHOLE, CAMERA = np.c_[COUNT, np.round(100 * UM)].astype("i4"), {"frame_rate_hz": 1e6, "um_per_px": 0.01}
CONSTANTS = "fps,1e6\nRmax_um,240\n\n"
READ = {  # content, options, R_max of each shot over that of the first, what each says
    "lost frame": (within("0,0"), {}, [1], "1 rows with time 0 and no radius"),
    "lost frames of two shots": (f"t_us,R1_um,R2_um\n{TWO}" + "0,0,0\n" * 9, {}, [1, 1.5], "9 rows with time 0"),
    "no time": (within("inf,100"), {}, [1], "1 of 181 frames without a time"),
    "absurd time": (within("1e30,100"), {}, [1], "1 of 181 frames without a time"),
    "padded with zeros": (saved(R=np.c_[PADDED_R, PADDED_R], t=np.c_[PADDED_T, PADDED_T]), {}, [1, 1], "9 rows"),
    "padded with NaN": (saved(R=np.stack([HOLED_R] * 2), t=np.stack([HOLED_T] * 2)), {}, [1, 1], "9 of 180 frames"),
    "times transposed": (saved(R_um=np.c_[UM, 1.5 * UM], t_us=np.stack([US, US])), {}, [1, 1.5], ""),
    "blank labels": (labels("A", *[""] * (N - 1), "B", *[""] * (N - 1)), {}, [1, 1.5], "blank cells of 'shot' filled"),
    "labels 1 and 1.0": (labels(*["1", "1.0"] * (N // 2), *["2.0", "2"] * (N // 2)), {}, [1, 1.5], ""),
    "titles with commas above spaces": ("# time_us, radius_um\n" + lines(" ", US, UM), {}, [1], ""),
    "separators at the ends of lines": (f"t_us,R_um,\n{PLAIN}".replace("\n", ",\n")[:-2], {}, [1], ""),
    "German comments": (f"t_us;R_um\n{lines(';', US, UM, comma=True)}# end\n", {}, [1], "1 lines that begin with #"),
    "last row cut": (HEAD + PLAIN + "250", {}, [1], "has 1 of 2 cells and is left out: was the file cut off?"),
    "R_max of pixels": (f"t_us,R_px,rmax_um\n{lines(',', US, UM / 3.2, TOP)}", {}, [1], "R_max set to"),
    "R_max of R/R_max": (f"t_us,R,rmax_um\n{lines(',', US, UM / TOP, TOP)}", {}, [1], "R_max set to"),
    "times around the groups": (hdf5({"t": TIME, "a/R": RADIUS, "b/R": 1.5 * RADIUS}), {}, [1, 1.5], ""),
    "comments in the data": (within("#7,100\n# focus"), {}, [1], "2 lines that begin with # left out"),
    "constants above": (CONSTANTS + HEAD + PLAIN, {}, [1], "2 lines above the titles left out: fps, Rmax_um"),
    "rate in kHz": (saved(R_um=UM, FrameRate_kHz=1e3), {}, [1], "the frame rate: FrameRate_kHz = 1e+06"),
    "units behind exp": (saved(R_exp_um=UM, t_exp_us=US, R_sim=RADIUS), {}, [1], "not used: R_sim"),
    "since 1970": (since_1970("timestamp_us", 10**6, 1), {}, [1], "counted from the first one"),
    "field of text": (array(TEXTS), {}, [1], "not used: flag"),
    "whole numbers that count": (array(WHOLE), CAMERA, [1], "'frame'"),
}


@pytest.mark.parametrize("name", READ)
def test_what_is_left_out_or_repaired_is_said(tmp_path, name):
    content, options, factors, said = READ[name]
    curves = read_curves(put(tmp_path / "a.csv", content), **options)
    assert [len(curve.time) >= N - 9 for curve in curves] == [True] * len(factors)
    largest = [curve.max_radius for curve in curves]
    assert np.allclose(largest, np.array(factors) * RADIUS.max(), rtol=0.01)
    assert all(any(said in note for note in (*curve.notes, *curve.hints, "")) for curve in curves)


SQUARE = np.tile(RADIUS[:40], (40, 1))
REFUSED = {  # content, what the message says
    "a.csv": (mixed("variable"), 'name the column of their labels "shot"'),
    "b.csv": (f"t_us,A (um),B (um)\n{TWO}", "'A (um)' and 'B (um)': two shots, or the half-axes"),
    "c.csv": (f"Time (us),Gel A (um),Gel B (um)\n{TWO}", "no column for radius among 'Time (us)', 'Gel A (um)'"),
    "d.mat": (saved(R=SQUARE, t=TIME[:40]), "R has the shape (40, 40), and 40 times: are the shots in rows"),
    "e.mat": (saved(R=np.c_[RADIUS, RADIUS], t=np.r_[TIME, TIME, TIME]), "the shape (180, 2), and 540 times: expected"),
    "f.npy": (array(np.c_[UM + 5 * np.sin(COUNT), US]), "the radius always grows: are the columns exchanged?"),
    "g.npy": (array(np.c_[COUNT, COUNT[::-1]]), "give the frame rate"),
    "h.h5": (hdf5({"common/t": TIME, "a/R": RADIUS}), "not used: common/t"),
    "i.mat": (saved(R_um=UM, fps="1000000"), "give the frame rate (--fps 1e6); not used: fps"),
    "j.csv": ("time,radius\n0.0 us,240 um\n1.0 us,239 um\n", "row 2 is '0.0 us, 240 um': expected numbers, and units"),
    "k.json": (json.dumps([{"time_us": 0.0, "radius_um": 240.0}]), "JSON is not read: save it as CSV"),
    "l.npz": (lambda path: np.savez(path, t=TIME, R=RADIUS), "save one array: numpy.save("),
    "m.csv.gz": (gzip.compress((HEAD + PLAIN).encode()), "compressed by gzip: unpack it"),
    "n.xlsx": (book(a=SHEET), "'time_us' holds no number: are its cells formulas"),
    "o.csv": (since_1970("timestamp_s", 1, 1e-6), "too few digits"),
    "p.npy": (array(PAIRS), "radius_um is no field of single numbers"),
    "s.npy": (array(np.rec.fromarrays([["0"] * N, UM], names="time_us,radius_um")), "time_us is no field of single"),
    "q.csv": (f"時間,半径\n{PLAIN}".encode("shift_jis"), "the text is not UTF-8: save it as CSV UTF-8"),
    "r.xlsx": (book(("raw",), notes=[["see raw"]], raw=[["time_us", "radius_um"]]), "not read: raw (hidden)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_names_the_mistake(tmp_path, name):
    content, said = REFUSED[name]

    def largest(path):
        return [curve.max_radius for curve in read_curves(path)]

    assert said in str(error_of(largest, put(tmp_path / name, content)))
