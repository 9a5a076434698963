"""The step of a recording in the browser app, without a browser: measured apart, frames left out, confirmed."""

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
    excluded,
    measure,
    toggle,
    typed_camera,
    unlisted,
    unready,
)
from cavirheo.app.film import summary as said_of
from cavirheo.app.session import PageSettings, Session, VisitorLimits
from cavirheo.errors import InputError, number_of
from cavirheo.io import read_curves
from cavirheo.io.subprocess_reader import Reader
from cavirheo.io.videos import Camera

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
    assert "shot.tif" in words.files_table(session)


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
    assert np.flatnonzero(excluded(seen)).tolist() == [2, 3, 4, 11]
    toggle(seen)
    assert seen.exclude == "3-5"
    (wrong,) = unlisted(seen, "3, 99")
    assert "1 to 34" in wrong
    assert seen.exclude == "3-5"
    (wrong,) = unlisted(seen, "1-34")
    assert "all measured frames" in wrong
    assert unlisted(seen, "") == [""]
    assert not excluded(seen).any()


def test_what_is_missing_is_said_at_its_field(session, seen):
    camera, wrong = typed_camera(seen, TYPED)
    assert (camera, wrong) == (CAMERA, ["", "", ""])
    for texts, at, said in (
        (("", "5.5", ""), 0, "missing"),
        (("500,000", "5.5", ""), 0, "two ways"),
        (("5e5", "-1", ""), 1, "positive"),
        (("5e5", "5.5", "x"), 2, "number"),
    ):
        wrong = typed_camera(seen, texts)[1]
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
        told = words.for_page(error.value)
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


@pytest.mark.parametrize(
    ("text", "value"),
    [("", None), ("1050", 1050.0), ("0,07", 0.07), ("1.050", 1.05), ("1,050", "which_number"), ("x", "not_a_number")],
)
def test_numbers_are_read_as_they_are_typed_or_refused_where_there_are_two_ways(text, value):
    if isinstance(value, str):
        with pytest.raises(InputError, match="density") as error:
            number_of(text, "density")
        assert error.value.code == f"input.{value}"
    else:
        assert number_of(text, "density") == value
