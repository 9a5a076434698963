"""The step of a recording in the browser app, without a browser: measured apart, frames left out, confirmed."""

from contextlib import closing

import numpy as np
import pytest
import tifffile
from answers import same
from conftest import refused
from recordings import RATE, SCALE, film

from cavirheo.app import film as step
from cavirheo.app import words
from cavirheo.app.session import PageSettings, Session, VisitorLimits
from cavirheo.errors import InputError
from cavirheo.io import read_curves
from cavirheo.io.subprocess_reader import Reader
from cavirheo.io.videos import Camera

CAMERA = Camera(RATE, SCALE)
TYPED = (str(RATE), str(SCALE), "")


@pytest.fixture(scope="module")
def reader():
    with closing(Reader(seconds=60.0)) as one:
        yield one


@pytest.fixture
def session(reader, tmp_path):
    """With shot.tif loaded."""
    with closing(Session(VisitorLimits(), reader)) as one:
        film().save(tmp_path / "shot.tif")
        one.add([tmp_path / "shot.tif"], PageSettings(), copy=True)
        yield one


@pytest.fixture
def seen(session):
    """The film, measured."""
    step.measure(session, CAMERA, print)
    return session.current


def test_the_confirmed_curve_is_that_of_the_command_line(session, tmp_path):
    assert (session.waiting, session.curves, session.files) == (["shot.tif"], [], [])
    with refused("app.not_measured"):
        step.confirm(session)
    step.measure(session, CAMERA, print)
    step.unlisted(session.current, "6, 12-14")
    step.confirm(session)
    (mine,) = session.curves
    (theirs,) = read_curves(tmp_path / "shot.tif", frame_rate_hz=RATE, um_per_px=SCALE, exclude="6,12-14")
    assert same([mine.time, mine.radius, mine.radius_std], [theirs.time, theirs.radius, theirs.radius_std])
    assert mine.notes == theirs.notes
    assert session.waiting == []
    expected = f"cavirheo infer shot.tif --fps {RATE:g} --um-per-px 5.5 --exclude 6,12-14"
    assert session.command(session.settings) == expected


def test_a_confirmed_curve_is_replaced_and_stands_beside_others(session, seen, tmp_path):
    (tmp_path / "other.csv").write_text("time_us,radius_um\n" + "".join(f"{k},{100 - k * k}\n" for k in range(8)))
    step.confirm(session)
    session.add([tmp_path / "other.csv"], PageSettings())
    step.unlisted(session.current, "20")
    step.confirm(session)
    assert [one.name for one in session.curves] == ["shot", "other"]
    assert np.isnan(session.curves[0].radius[19])
    with pytest.raises(InputError):  # it is not that of the other shot
        session.prepare(PageSettings(rmax_um=150.0))
    session.clear()
    assert (session.films, session.film, session.files) == ({}, "", [])


def test_frames_are_left_out_and_brought_back(seen):
    seen.frame = 12
    step.toggle(seen)
    assert seen.exclude == "12"
    assert np.isnan(step.curve(seen).radius[11])
    assert step.unlisted(seen, "12, 3-5,") == [""]  # while it is typed
    assert np.flatnonzero(step.excluded(seen)).tolist() == [2, 3, 4, 11]
    step.toggle(seen)
    for wrong, why in (("3, 99", "1 to 34"), ("1-34", "all measured frames")):
        assert why in step.unlisted(seen, wrong)[0]
        assert seen.exclude == "3-5"
    assert step.unlisted(seen, "") == [""]
    assert not step.excluded(seen).any()


def test_what_is_missing_or_must_be_measured_again_is_said_at_its_field(session, seen):
    assert step.camera_of(seen, TYPED) == (CAMERA, ["", "", ""])
    for texts, field, why in (
        (("", "5.5", ""), 0, "missing"),
        (("500,000", "5.5", ""), 0, "two ways"),
        (("5e5", "-1", ""), 1, "positive"),
        (("5e5", "5.5", "x"), 2, "number"),
    ):
        wrong = step.camera_of(seen, texts)[1]
        assert why in wrong[field]
        assert [bool(one) for one in wrong] == [k == field for k in range(3)]
    assert step.unready(seen, *TYPED, "6") == ["", "", "", ""]
    assert "measure again" in step.unready(seen, str(RATE), "6", "", "")[1]
    assert "1 to 34" in step.unready(seen, *TYPED, "0")[3]
    step.measure(session, Camera(RATE), print)  # a .tif may have a scale; this one has none
    assert "missing" in step.unready(session.current, str(RATE), "", "", "")[1]


def test_a_recording_that_cannot_be_measured_is_said_without_its_folder(session, tmp_path):
    frames = film().frames
    tifffile.imwrite(tmp_path / "still.tif", np.repeat(frames[:1], 9, 0), photometric="minisblack")
    tifffile.imwrite(tmp_path / "one.tif", frames[0])
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "damaged.mp4").write_bytes(b"no picture" * 99)
    names = ("still.tif", "one.tif", "empty.mp4", "damaged.mp4")
    session.add([tmp_path / name for name in names], PageSettings())
    for session.film in names:
        with pytest.raises(InputError) as error:
            step.measure(session, CAMERA, print)
        assert str(session.folder) not in words.for_page(error.value)
    assert [path.suffix for path in session.folder.iterdir() if path.is_file()] == []  # no frames are left behind


def test_too_much_is_refused(reader, tmp_path):
    with closing(Session(VisitorLimits(film_mb=0.01, files=1), reader)) as session:
        film().save(tmp_path / "shot.tif")
        session.add([tmp_path / "shot.tif"], PageSettings())
        with refused("app.too_large"):
            step.measure(session, CAMERA, print)
        with refused("app.too_many_files"):
            session.add([tmp_path / "more.mp4"], PageSettings())
