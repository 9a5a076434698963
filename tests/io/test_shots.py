"""--shots: some of the shots of a file, by every verb that reads curves."""

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import BDT, ROOT, code_of, refusal, refused
from files import RADIUS, TIME, text_table

from cavirheo import load, read_curves

FILE = ROOT / "examples" / "stiff_gel.mat"


def test_numbers_and_ranges_are_read():
    texts = {"1,3-5": [1, 3, 4, 5], " 3 ": [3], "5,2-2,5": [2, 5]}
    names = [curve.name for curve in read_curves(FILE)]
    for shots, numbers in (*texts.items(), ([2, 1], [1, 2]), (np.arange(1, 3), [1, 2])):
        assert [curve.name for curve in read_curves(FILE, shots=shots)] == [names[k - 1] for k in numbers]


@pytest.mark.parametrize("given", ["", "0", "a", "1,,2", "3-2", "1-", "-1", "1.5", "1-2-3", [0], [], ["x"], "9999999"])
def test_what_is_no_list_of_shots_is_refused(given):
    assert code_of(read_curves, FILE, shots=given) == "option.shots"


def test_verbs_answer_the_chosen_shots_alone_by_their_names(run):
    every = read_curves(FILE)
    with refused("reading.shots", FILE.name):
        read_curves(FILE, shots=f"1,{len(every) + 1}")
    name = every[1].name
    status, _, said = run("infer", FILE, *BDT, "--shots", 2, "-o", "infer", "--no-pictures")
    assert status in (0, 1), said
    assert [row.name for row in load("infer").curves] == [name]
    assert name in run("show", FILE, "--shots", 2)[1]
    Path("times.csv").write_text("rmax_um,stretch,t1_us\n200,8,18\n250,8,22\n300,8,27\n", encoding="utf-8")
    run("collapse-time", "times.csv", "--shots", "1,3", "-o", "out")
    assert [shot.name for group in load("out").groups for shot in group.shots] == ["1", "3"]


def test_a_frame_rate_that_can_be_two_numbers_is_refused(run):
    Path("px.csv").write_text("frame,R_px\n" + "".join(f"{k},{90 - abs(k - 9)}\n" for k in range(60)), encoding="utf-8")
    for text, said in (("270.000", "270000"), ("900.000", "900000"), ("270,000", "no mark between thousands")):
        refusal(run("show", "px.csv", "--um-per-px", "3.2", "--fps", text), said)
    refusal(run("infer", "px.csv", "--window", "2.5"), "a whole number or 'all'", "'2.5'")
    for text in ("270000", "2.7e5", "270000.5"):
        assert run("show", "px.csv", "--um-per-px", "3.200", "--fps", text)[0] == 0


def sized(path: Path, factors: dict[str, float], sizes: tuple[str, ...] = (), title: str = "rmax_um") -> Path:
    """A table of one motion at several scales, with a column of R_max where sizes are given."""
    rows = ["shot,time_us,radius_um" + f",{title}" * bool(sizes)]
    for k, (name, factor) in enumerate(factors.items()):
        more = f",{sizes[k]}" if sizes else ""
        rows += [f"{name},{1e6 * t},{1e6 * factor * r}{more}" for t, r in zip(TIME, RADIUS, strict=True)]
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def test_files_of_one_name_are_one_group_and_a_unit_told_by_its_size_is_said_once_for_it(run, tmp_path):
    stems = {"soft_1": "soft", "soft 02": "soft", "soft_1 (2)": "soft", "soft(3)": "soft", "gel5kPa_3": "gel5kPa"}
    stems |= {"agarose 0.5 %": "agarose 0.5 %", "agarose_0.5": "agarose_0.5", "agarose_0.5_12": "agarose_0.5"}
    stems |= {"stiff_1": "stiff", "7": tmp_path.name, "8": tmp_path.name}
    for k, name in enumerate(stems):
        text_table(tmp_path / f"{name}.csv", "time,radius", 1e6 * TIME, (1e6 + 1e4 * k) * RADIUS)
    run("infer", *(f"{name}.csv" for name in stems), *BDT, "--group", "name", "--no-pictures", "-o", "out")
    made = load("out")
    assert [one.group for one in made.curves] == [*stems.values()]
    assert len(made.notes) == 2  # of time and of radius
    assert all("um" in note or "us" in note for note in made.notes)


def test_files_of_one_name_in_two_folders_are_told_apart(run):
    files = [Path(place) for place in ("one/s1.csv", "two/s1.csv", "two/s2.csv")]
    for k, file in enumerate(files):
        file.parent.mkdir(exist_ok=True)
        text_table(file, "time_us,radius_um", 1e6 * TIME, (1e6 + 1e4 * k) * RADIUS)
    for how, groups in {"file": ("s1", "s1", "s2"), "folder": ("one", "two", "two")}.items():
        run("infer", *files, *BDT, "--group", how, "--no-pictures", "-o", how)
        assert [one.name for one in load(how).curves] == ["one/s1", "two/s1", "s2"]
        assert tuple(one.group for one in load(how).curves) == groups


def test_a_recording_that_was_also_written_with_fewer_digits_counts_once(run, tmp_path):
    files = [tmp_path / f"{name}.csv" for name in ("one", "rounded", "other")]
    columns = (RADIUS, 1e6 * RADIUS), (np.round(RADIUS, 8), 1060.0 + 0.0 * TIME), (1.002 * RADIUS, 1e6 * RADIUS)
    for file, (radii, density) in zip(files, columns, strict=True):
        text_table(file, "time_us,radius_um,density", 1e6 * TIME, 1e6 * radii, density)
    run("infer", *files, *BDT, "--no-pictures", "-o", "out")
    assert [one.name for one in load("out").curves] == ["one", "other"]
    said = [one.text for one in load("out").groups[0].messages]
    assert "density 998 kg/m3: assumed; what the file gives" in str(said)
    assert re.search(r"rounded.*\(nothing\), not the former \(density 1060\)", load("out").notes[0])


def test_one_r_max_is_not_that_of_shots_of_several_sizes(run, tmp_path):
    several = sized(tmp_path / "several.csv", {"a": 1.0, "b": 1.5})
    alone = [sized(tmp_path / f"{name}.csv", {name: factor}) for name, factor in (("a", 1.0), ("b", 1.5))]
    same = sized(tmp_path / "same.csv", {"a": 1.0, "b": 1.005})
    words = ["infer", *BDT, "--no-pictures", "--rmax-um", 300]
    refusal(run(*words, several), "300", "several[a]", "several[b]", "rmax_um")
    assert run(*words, *alone)[0] == 2
    assert run(*words, same, "-o", "same")[0] in (0, 1)
    assert [row.max_radius_m for row in load("same").curves] == pytest.approx([300e-6] * 2)


def test_a_column_gives_each_shot_its_r_max(run, tmp_path):
    shots = {"a": 1.0, "b": 1.5, "c": 1.0}
    found = read_curves(sized(tmp_path / "sized.csv", shots, ("310", "450.5", "")))
    own = read_curves(sized(tmp_path / "plain.csv", shots))[2].max_radius
    assert [curve.max_radius for curve in found] == pytest.approx([310e-6, 450.5e-6, own])
    assert "rmax_um" in run("show", "sized.csv")[1]
    two = sized(tmp_path / "two.csv", {"a": 1.0}, ("310",)).read_text(encoding="utf-8").replace(",310\n", ",311\n", 1)
    (tmp_path / "two.csv").write_text(two, encoding="utf-8")
    refusal(run("show", "two.csv"), "rmax_um")
    (curve,) = read_curves(sized(tmp_path / "no_unit.csv", {"x": 1.0}, ("3",), "Rmax"))
    assert any("not used" in note for note in curve.notes)
