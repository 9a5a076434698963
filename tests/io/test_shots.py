"""--shots: some of the shots of a file, by every verb that reads curves."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import BDT, ROOT
from files import RADIUS, TIME, bdt_variables
from scipy.io import savemat

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.io import read_curves, write_csv
from cavirheo.io.shots import read_shots, selected, shot_numbers, stem_of

FILE = ROOT / "examples" / "stiff_gel.mat"


@pytest.mark.parametrize(
    ("given", "numbers"),
    [("1,4-7", [1, 4, 5, 6, 7]), (" 3 ", [3]), ("7,2-2,7", [2, 7]), ([2, 1], [1, 2]), (np.arange(1, 3), [1, 2])],
)
def test_numbers_and_ranges_are_read(given, numbers):
    assert shot_numbers(given) == numbers


@pytest.mark.parametrize("given", ["", "0", "a", "1,,2", "3-2", "1-", "-1", "1.5", "1-2-3", [0], [], ["x"], "9999999"])
def test_what_is_no_list_of_shots_is_refused(given):
    with pytest.raises(InputError) as refused:
        shot_numbers(given)
    assert refused.value.code == "option.shots"


def test_the_shots_of_a_file_keep_their_names_and_their_order():
    every = read_curves(FILE)
    some = read_curves(FILE, shots=[3, 1])
    assert [curve.name for curve in some] == [every[0].name, every[2].name]
    assert np.array_equal(some[1].radius, every[2].radius, equal_nan=True)
    assert [curve.name for curve in read_curves(FILE, shots="2")] == [every[1].name]


def test_a_number_beyond_the_file_is_refused_with_its_name():
    count = len(read_curves(FILE))
    with pytest.raises(InputError) as refused:
        read_curves(FILE, shots=f"1,{count + 1}")
    assert refused.value.code == "reading.shots"
    assert FILE.name in str(refused.value)
    assert selected("abc", None) == ["a", "b", "c"]


def test_verbs_answer_the_chosen_shots_alone(run):
    name = read_curves(FILE)[1].name
    status, _, said = run("infer", FILE, *BDT, "--shots", 2, "-o", "infer", "--no-pictures", "--quiet")
    assert status in (0, 1), said
    rows = json.loads(Path("infer/result.json").read_text(encoding="utf-8"))["curves"]
    assert [row["name"] for row in rows] == [name]
    assert name in run("show", FILE, "--shots", 2)[1]
    _, out, _ = run("collapse-time", FILE, "--shots", 2, "-o", "times", "--no-pictures", "--json")
    assert [shot["name"] for group in json.loads(out)["groups"] for shot in group["shots"]] == [name]


@pytest.mark.parametrize("verb", ["infer", "fit", "which-law", "collapse-time", "show"])
def test_a_shot_that_is_not_there_is_bad_usage(verb, run):
    where = [] if verb == "show" else ["-o", "out"]
    for shots in ("99", "x"):
        status, _, said = run(verb, FILE, "--shots", shots, *where)
        assert status == 2
        assert shots in said
        assert not Path("out").exists()


@pytest.mark.parametrize(
    ("file", "stem"),
    [
        ("soft_1.csv", "soft"), ("soft 02.csv", "soft"), ("soft_1 (2).csv", "soft"), ("soft(3).csv", "soft"),
        ("soft.csv", "soft"), ("gel5kPa_3.mat", "gel5kPa"), ("agarose 0.5 %.csv", "agarose 0.5 %"),
        ("agarose_0.5.csv", "agarose_0.5"), ("x/agarose_0.5_12.csv", "agarose_0.5"), ("7.csv", ""),
    ],
)  # fmt: skip
def test_the_name_of_a_file_before_its_number(file, stem):
    assert stem_of(file) == stem


def test_files_of_one_name_are_one_group(run, tmp_path):
    curve = read_curves(FILE)[0]
    names = ("soft_1", "soft_2", "stiff_1", "7", "8")
    for k, name in enumerate(names):
        write_csv(f"{name}.csv", RadiusCurve(curve.time, curve.radius * (1.0 + 0.01 * k)))
    found = read_shots([f"{name}.csv" for name in names], group="name").curves
    assert [one.group for one in found] == ["soft", "soft", "stiff", *[tmp_path.name] * 2]
    status, _, said = run("infer", "soft_1.csv", "stiff_1.csv", *BDT, "--group", "name", "-o", "by", "--no-pictures")
    assert status in (0, 1), said
    groups = json.loads(Path("by/result.json").read_text(encoding="utf-8"))["groups"]
    assert [one["name"] for one in groups] == ["soft", "stiff"]


def test_shots_of_what_is_no_measurement_are_refused(run):
    Path("a.json").write_text("{}", encoding="utf-8")
    assert run("show", "a.json", "--shots", "1")[0] == 2


def test_the_rows_of_a_table_of_collapse_times_are_chosen_too(run):
    rows = "200,8,18\n250,8,22\n300,8,27\n"
    Path("times.csv").write_text("rmax_um,stretch,t1_us\n" + rows, encoding="utf-8")
    _, out, _ = run("collapse-time", "times.csv", "--shots", "1,3", "-o", "out", "--no-pictures", "--json")
    (group,) = json.loads(out)["groups"]
    assert [shot["name"] for shot in group["shots"]] == ["1", "3"]


def test_a_set_that_is_compared_may_name_its_shots(run):
    command = ["compare", FILE.parent, "--references", "sets.csv", "-o", "out", "--no-pictures", "--json"]
    Path("sets.csv").write_text(f'set,files,shots\ngel,{FILE.name},"2-3"\n', encoding="utf-8")
    made = json.loads(run(*command)[1])
    assert [curve["name"] for curve in made["curves"]] == [curve.name for curve in read_curves(FILE, shots="2-3")]
    Path("sets.csv").write_text(f"set,files,shots\ngel,{FILE.name},2x\n", encoding="utf-8")
    status, _, said = run(*command)
    assert status == 2
    assert "line 2" in said


# --- what a file says of scale and constants -------------------------------------------------------------------------


def test_what_a_file_says_of_its_density_is_said_once_for_its_group(run):
    savemat("gel.mat", bdt_variables() | {"rho": 1060.0, "P_inf": 101325.0})
    savemat("same.mat", bdt_variables() | {"rho": 998.0})
    one, *_ = curves = read_curves("gel.mat")
    assert len(curves) == 3
    (hint,) = one.hints
    assert hint in one.notes
    assert "1060" in hint
    assert "998" in hint
    assert read_curves("same.mat")[0].hints == ()
    assert read_curves("gel.mat", density=1060.0)[0].hints == ()
    status, out, _ = run("infer", "gel.mat", "--verify", "none", "-o", "out", "--no-pictures")
    assert status in (0, 1)
    assert " ".join(out.split()).count("--density 1060") == 1
    assert "--density 1060" in json.loads(Path("out/result.json").read_text(encoding="utf-8"))["notes"][0]


def test_a_unit_that_is_told_by_its_size_is_said_once_for_its_group(run):
    for k in range(2):
        rows = "".join(f"{t:.8g},{r * (1.0 + 0.001 * k):.8g}\n" for t, r in zip(TIME * 1e6, RADIUS * 1e6, strict=True))
        Path(f"shot{k}.csv").write_text("time,radius\n" + rows, encoding="utf-8")
    found = read_shots(sorted(Path().glob("*.csv")))
    assert len(found.curves) == 2
    assert all("um" in remark or "us" in remark for remark in found.hints)
    assert len(found.hints) == 2  # of time and of radius


def sized(path: Path, factors: dict[str, float], sizes: dict[str, str] | None = None) -> Path:
    """A table of one motion at several scales, with a column of R_max where sizes are given."""
    title, last = "shot,time_us,radius_um", ",rmax_um" if sizes else ""
    rows = [title + last]
    for name, factor in factors.items():
        more = f",{sizes[name]}" if sizes else ""
        rows += [f"{name},{1e6 * t},{1e6 * factor * r}{more}" for t, r in zip(TIME, RADIUS, strict=True)]
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def test_one_r_max_is_not_that_of_shots_of_several_sizes(run, tmp_path):
    """A wrong scale is one factor."""
    several = sized(tmp_path / "several.csv", {"a": 1.0, "b": 1.5})
    words = ["infer", *BDT, "--no-pictures", "--quiet", "--rmax-um", 300]
    status, _, err = run(*words, several)
    assert (status, err.count("\n")) == (2, 1)
    assert all(word in err for word in ("300", "several[a]", "several[b]", "rmax_um"))
    alone = [sized(tmp_path / f"{name}.csv", {name: factor}) for name, factor in (("a", 1.0), ("b", 1.5))]
    assert run(*words, *alone)[0] == 2
    same = sized(tmp_path / "same.csv", {"a": 1.0, "b": 1.005})
    assert run(*words, same)[0] in (0, 1)
    written = json.loads(Path("cavirheo-result/result.json").read_text(encoding="utf-8"))
    factor = 300e-6 / read_curves(same)[0].max_radius
    assert any(f"scaled by {factor:.3g}"[:14] in note for note in written["notes"])
    assert [row["max_radius_m"] for row in written["curves"]] == pytest.approx([300e-6] * 2)


def test_a_column_gives_each_shot_its_r_max(tmp_path):
    shots = {"a": 1.0, "b": 1.5, "c": 1.0}
    file = sized(tmp_path / "sized.csv", shots, {"a": "310", "b": "450.5", "c": ""})
    found = read_shots([file])
    own = read_curves(sized(tmp_path / "plain.csv", shots))[2].max_radius
    assert [curve.max_radius for curve in found.curves] == pytest.approx([310e-6, 450.5e-6, own])
    assert any("rmax_um" in remark for remark in found.hints)
    lines = file.read_text(encoding="utf-8").replace(",310\n", ",311\n", 1)
    file.write_text(lines, encoding="utf-8")
    assert "rmax_um" in read_shots([file]).problems[0]
    text = sized(file, {"x": 1.0}, {"x": "3"}).read_text(encoding="utf-8")
    file.write_text(text.replace("rmax_um", "Rmax"), encoding="utf-8")
    assert any("not used" in note for note in read_shots([file]).curves[0].notes)


def test_a_column_of_sizes_says_by_how_much_it_scales(tmp_path):
    """A wrong R_max moves G by a multiple of its error: the factor stands in the remarks of the curve's reading."""
    radius = 100.0 * np.abs(np.cos(np.linspace(0.0, 3.0, 40))) + 5.0
    for size, told in ((150.0, "scaled by 1.4"), (105.0, "scaled to it")):
        rows = "".join(f"{k},{r:.4f},{size}\n" for k, r in enumerate(radius))
        (tmp_path / "one.csv").write_text("time_us,radius_um,rmax_um\n" + rows)
        (curve,) = read_curves(tmp_path / "one.csv")
        assert any(told in hint for hint in curve.hints)
