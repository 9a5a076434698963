"""The step of a recording in the browser app, without a browser: measured apart, frames left out, confirmed."""

import json
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("gradio") is None or find_spec("av") is None:
    pytest.skip("the extras app and video are not installed", allow_module_level=True)

import tifffile
from recordings import RATE, SCALE, film

from cavirheo.app import words
from cavirheo.app.film import (
    confirm,
    curve,
    drawn,
    framed,
    left_out,
    measure,
    options,
    toggle,
    typed,
    unlisted,
    unready,
)
from cavirheo.app.film import said as said_of
from cavirheo.app.session import PageSettings, Session, VisitorLimits
from cavirheo.app.steps import infer
from cavirheo.errors import InputError, number_of
from cavirheo.io import read_curves
from cavirheo.io.camera import Camera
from cavirheo.io.subprocess_reader import Reader
from cavirheo.video.picture import sheet_address

CAMERA = Camera(RATE, SCALE)
TYPED = (str(RATE), str(SCALE), "")


@pytest.fixture(scope="module")
def shot():
    return film()


@pytest.fixture(scope="module")
def reader():
    one = Reader(seconds=60.0)
    yield one
    one.close()


@pytest.fixture
def session(reader, tmp_path, shot):
    """With shot.tif loaded."""
    one = Session(VisitorLimits(), reader)
    shot.save(tmp_path / "shot.tif")
    one.add([tmp_path / "shot.tif"], PageSettings(), copy=True)
    yield one
    one.close()


@pytest.fixture
def seen(session):
    """The film, measured."""
    shares = []
    measure(session, CAMERA, lambda share, _: shares.append(share))
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert 0.8 < shares[-1] <= 1.0
    return session.current


def test_a_recording_waits_until_it_is_confirmed(session):
    assert (session.waiting, session.curves, session.files) == (["shot.tif"], [], [])
    with pytest.raises(InputError) as error:
        confirm(session)
    assert error.value.code == "app.not_measured"
    assert "shot.tif" in words.found(session)


def test_the_confirmed_curve_is_that_of_the_command_line(session, seen, tmp_path):
    unlisted(seen, "6, 12-14")
    confirm(session)
    (mine,), (theirs,) = (
        session.curves,
        read_curves(tmp_path / "shot.tif", frame_rate_hz=RATE, um_per_px=SCALE, exclude="6,12-14"),
    )
    for name in ("time", "radius", "radius_std"):
        assert np.array_equal(getattr(mine, name), getattr(theirs, name), equal_nan=True)
    assert "excluded by hand: frames 6, 12-14" in mine.notes
    assert mine.notes == theirs.notes
    assert mine.meta["contact_sheet"] == theirs.meta["contact_sheet"]
    assert session.waiting == []
    assert (
        session.command(session.settings) == f"cavirheo infer shot.tif --fps {RATE:g} --um-per-px 5.5 --exclude 6,12-14"
    )


@pytest.mark.slow
def test_the_answer_names_what_was_excluded(session, seen):
    unlisted(seen, "6, 12-14")
    confirm(session)
    document = infer(session, ["shot"]).document
    assert "excluded by hand: frames 6, 12-14" in document.curves[0].notes
    assert str(session.folder) not in json.dumps(document.model_dump(mode="json"))


def test_a_radius_from_a_part_of_the_outline_says_so_unfolded(seen):
    assert "of the outline" not in said_of(seen)
    cut = replace(seen.found, track=replace(seen.found.track, arc=np.full_like(seen.found.track.arc, 0.29)))
    seen.found = seen.kept = cut
    told = said_of(seen)
    assert "29 % of the outline" in told[: told.index("<details>")]


def test_a_confirmed_curve_is_replaced_and_stands_beside_others(session, seen, tmp_path):
    (tmp_path / "other.csv").write_text("time_us,radius_um\n" + "".join(f"{k},{100 - k * k}\n" for k in range(8)))
    confirm(session)
    session.add([tmp_path / "other.csv"], PageSettings())
    assert [one.name for one in session.curves] == ["shot", "other"]
    unlisted(seen, "20")
    unlisted(session.current, "20")
    confirm(session)
    assert [one.name for one in session.curves] == ["shot", "other"]
    assert np.isnan(session.curves[0].radius[19])
    assert session.command(session.settings).startswith("cavirheo infer shot.tif other.csv (shot.tif: --fps")
    with pytest.raises(InputError):  # it is not that of the other shot
        session.prepare(PageSettings(rmax_um=150.0))
    session.clear()
    assert (session.films, session.film, session.files) == ({}, "", [])


def test_frames_are_left_out_and_brought_back(seen):
    seen.shown = 12
    toggle(seen)
    assert seen.exclude == "12"
    assert np.isnan(curve(seen).radius[11])
    assert unlisted(seen, "12, 3-5,") == [""]  # while it is typed
    assert np.flatnonzero(left_out(seen)).tolist() == [2, 3, 4, 11]
    toggle(seen)
    assert seen.exclude == "3-5"
    (wrong,) = unlisted(seen, "3, 99")
    assert "1 to 34" in wrong
    assert seen.exclude == "3-5"
    (wrong,) = unlisted(seen, "1-34")
    assert "all measured frames" in wrong
    assert unlisted(seen, "") == [""]
    assert not left_out(seen).any()


def test_what_is_missing_is_said_at_its_field(session, seen):
    camera, wrong = typed(seen, TYPED)
    assert (camera, wrong) == (CAMERA, ["", "", ""])
    for texts, at, said in (
        (("", "5.5", ""), 0, "missing"),
        (("500,000", "5.5", ""), 0, "two ways"),
        (("5e5", "-1", ""), 1, "positive"),
        (("5e5", "5.5", "x"), 2, "number"),
    ):
        wrong = typed(seen, texts)[1]
        assert said in wrong[at]
        assert [bool(why) for why in wrong] == [k == at for k in range(3)]
    assert unready(seen, *TYPED, "6") == ["", "", "", ""]
    assert "measure again" in unready(seen, str(RATE), "6", "", "")[1]
    assert "1 to 34" in unready(seen, *TYPED, "0")[3]
    measure(session, Camera(RATE), lambda *_: None)  # a .tif may have a scale; this one has none
    assert "missing" in unready(session.current, str(RATE), "", "", "")[1]


def test_a_recording_that_cannot_be_measured_is_said_in_one_sentence(session, shot, tmp_path):
    still = np.repeat(shot.frames[:1], 9, 0)
    tifffile.imwrite(tmp_path / "still.tif", still, photometric="minisblack")
    tifffile.imwrite(tmp_path / "one.tif", shot.frames[0])
    tifffile.imwrite(tmp_path / "colour.tif", np.stack([shot.frames] * 3, axis=-1), photometric="rgb")
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "damaged.mp4").write_bytes(b"no picture" * 99)
    names = ("still.tif", "one.tif", "empty.mp4", "damaged.mp4", "colour.tif")
    session.add([tmp_path / name for name in names], PageSettings())
    for session.film, said in zip(names[:4], ("no bubble", "one frame", "empty.mp4", "can be decoded"), strict=True):
        with pytest.raises(InputError) as error:
            measure(session, CAMERA, lambda *_: None)
        told = words.told(error.value)
        assert said in told
        assert str(session.folder) not in told
        assert "Type how it was recorded" in said_of(session.current)
    session.film = "colour.tif"
    measure(session, CAMERA, lambda *_: None)
    assert "its brightness is measured" in said_of(session.current)
    assert [path.suffix for path in session.folder.iterdir() if path.is_file()] == []  # no frames are left behind


def test_too_much_is_refused(reader, shot, tmp_path):
    session = Session(VisitorLimits(film_mb=0.01, files=1), reader)
    try:
        shot.save(tmp_path / "shot.tif")
        session.add([tmp_path / "shot.tif"], PageSettings())
        for code, refused in (
            ("app.too_large", lambda: measure(session, CAMERA, lambda *_: None)),
            ("app.too_many_files", lambda: session.add([tmp_path / "more.mp4"], PageSettings())),
        ):
            with pytest.raises(InputError) as error:
                refused()
            assert error.value.code == code
    finally:
        session.close()


def test_a_header_is_no_recording_of_its_own(session, tmp_path):
    for name in ("a.mraw", "a.cihx", "b.cihx"):
        (tmp_path / name).write_bytes(b"x")
    session.add([tmp_path / name for name in ("a.cihx", "a.mraw", "b.cihx")], PageSettings())
    assert session.recordings == ["shot.tif", "a.mraw", "b.cihx"]


def test_the_shown_frame_is_marked(seen):
    assert seen.shown == 1 + int(np.nanargmax(seen.found.track.radius))
    unlisted(seen, "6")
    seen.shown = 6
    figure = drawn(seen)
    (crosses,) = [one for one in figure.data if one.name == "excluded"]
    assert crosses.customdata.tolist() == [6]
    assert figure.layout.shapes[0].x0 == pytest.approx(1e6 * 5 / RATE)
    assert sum(len(one.x) for one in figure.data) == len(seen.found.time)
    shown = framed(seen)
    assert all(said in shown for said in ("Frame 6 of 34", "excluded", "data:image/jpeg"))
    assert "Changed" not in said_of(seen)
    assert options(seen).endswith("--exclude 6")
    assert sheet_address(seen.kept) != sheet_address(seen.found)


@pytest.mark.parametrize(
    ("text", "value"), [("", None), ("1050", 1050.0), ("0,07", 0.07), ("1.050", 1.05), ("0,072", 0.072)]
)
def test_numbers_are_read_as_they_are_typed(text, value):
    assert number_of(text, "density") == value


@pytest.mark.parametrize(
    ("text", "code"), [("1,050", "which_number"), ("500,000", "which_number"), ("x", "not_a_number")]
)
def test_a_number_that_can_be_read_in_two_ways_is_refused(text, code):
    with pytest.raises(InputError) as error:
        number_of(text, "density")
    assert error.value.code == f"input.{code}"
    assert "density" in str(error.value)
