"""Recordings as files: what is read of each format, what is refused, and the command that measures them."""

import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile
from conftest import code_of, done, refused, rows_of
from PIL import Image
from recordings import FRAMES, RATE, SCALE, film, write_cine, write_mraw
from scipy.io import loadmat

import cavirheo
from cavirheo import InputError
from cavirheo.io.files import expand
from cavirheo.io.videos import examine, measure
from cavirheo.video.frames import is_video, read

HOW = {"frame_rate": RATE, "um_per_px": SCALE}


@pytest.fixture(scope="module")
def shot():
    return film()


@pytest.fixture(scope="module")
def deep():
    """Of 12 bits."""
    return film(bits=12)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, shot, deep):
    place = tmp_path_factory.mktemp("recordings")
    for name in ("shot.mp4", "shot.mkv", "shot.tif"):
        shot.save(place / name)
    deep.save(place / "deep.mkv")
    first, *others = map(Image.fromarray, deep.frames)
    first.save(place / "packed.tif", save_all=True, append_images=others, compression="tiff_lzw")
    for name in ("images", "pages"):
        (place / name).mkdir()
    for k, frame in enumerate(deep.frames):
        Image.fromarray(frame).save(place / "images" / f"frame{k}.png")  # frame10 before frame2 by the alphabet
        tifffile.imwrite(place / "pages" / f"{k}.tif", frame)
    write_mraw(place / "camera.mraw", deep.frames, 12)
    write_cine(place / "camera.cine", deep.frames, np.arange(FRAMES) / RATE, int(RATE))
    return place


DEEP = ("deep.mkv", "packed.tif", "images", "pages", "camera.mraw", "camera.cine")


@pytest.mark.parametrize("name", ["shot.mkv", "shot.tif", *DEEP])
def test_frames_are_read_as_they_are(folder, shot, deep, name):
    frames, expected = read(folder / name).frames, (deep if name in DEEP else shot).frames
    assert frames.dtype == expected.dtype
    assert np.array_equal(frames, expected)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_mraw_is_read_bit_by_bit(tmp_path, bits):
    frames = np.random.default_rng(bits).integers(0, 2**bits, (3, 20, 32))
    found = read(write_mraw(tmp_path / "a.mraw", frames, bits, rate=1234))
    assert np.array_equal(found.frames, frames)
    assert (found.frame_rate, found.exposure) == (1234.0, pytest.approx(4e-7))


def test_compression_hardly_moves_the_radius(folder, shot):
    curve = measure(folder / "shot.mp4", **HOW)
    ok = np.array(curve.meta["flags"]) == "ok"
    assert np.sqrt(np.mean((curve.radius[ok] / SCALE * 1e6 - shot.radius[ok]) ** 2)) < 0.05


def test_the_stamps_of_a_cine_count_before_its_header(tmp_path, deep):
    stamps = 0.9999995 + np.arange(FRAMES) / RATE  # over the turn of a second
    found = read(write_cine(tmp_path / "a.cine", deep.frames, stamps, 50_000))
    assert found.time == pytest.approx(np.arange(FRAMES) / RATE, abs=2e-9)
    assert found.exposure == pytest.approx(1e-6, rel=1e-3)
    curve = measure(tmp_path / "a.cine", um_per_px=SCALE)
    assert curve.frame_rate == pytest.approx(RATE, rel=1e-3)
    assert any("50000" in one.text for one in curve.warnings)


@pytest.mark.parametrize("name", ["shot.mp4", "shot.mkv", "shot.tif", "images"])
def test_a_container_never_says_the_rate(folder, name):
    assert code_of(lambda: measure(folder / name, um_per_px=SCALE)) == "video.frame_rate"


def test_the_users_rate_counts_before_the_cameras_and_a_difference_is_doubtful(folder):
    curve = measure(folder / "camera.mraw", frame_rate=4e5, um_per_px=SCALE)
    assert curve.frame_rate == 4e5
    assert len(curve.warnings) == 1
    assert measure(folder / "camera.mraw", um_per_px=SCALE).warnings == ()


def test_without_a_scale_radii_are_pixels_that_inference_refuses(folder, shot):
    curve = measure(folder / "shot.tif", frame_rate=RATE)
    assert np.nanmax(curve.radius) == pytest.approx(np.nanmax(shot.radius) * 1e-6, rel=1e-3)
    assert code_of(lambda: curve.max_radius) == "curve.unscaled"
    assert curve.with_max_radius(128e-6).max_radius == 128e-6


def test_the_scale_of_imagej_is_read_and_that_of_printing_is_not(tmp_path, shot):
    told = {"imagej": True, "metadata": {"unit": "um", "axes": "TYX"}, "resolution": (0.25, 0.25)}
    tifffile.imwrite(tmp_path / "a.tif", shot.frames, **told)
    assert read(tmp_path / "a.tif").um_per_px == pytest.approx(4.0)
    tifffile.imwrite(tmp_path / "b.tif", shot.frames, resolution=(72, 72))
    assert read(tmp_path / "b.tif").um_per_px is None


def test_parts_of_a_recording(folder, shot):
    whole, _ = examine(folder / "shot.tif", **HOW)
    found, curve = examine(folder / "shot.tif", **HOW, span=(3, 25), roi=(8, 6, 72, 60))
    assert len(curve.time) == 23
    assert curve.time[0] == pytest.approx(2 / RATE)
    both = np.isfinite(found.track.radius) & np.isfinite(whole.track.radius[2:25])
    assert np.abs(found.track.radius - whole.track.radius[2:25])[both].max() < 0.2
    assert np.abs(found.track.x + 8 - whole.track.x[2:25])[both].max() < 0.2


@pytest.mark.parametrize("listed", ["6, 12-14", [13, 6, 12, 14]])
def test_frames_can_be_excluded_by_hand(folder, listed):
    whole, _ = examine(folder / "shot.tif", **HOW)
    found, curve = examine(folder / "shot.tif", **HOW, exclude=listed)
    left = np.isin(np.arange(1, FRAMES + 1), [6, 12, 13, 14])
    assert np.isnan(curve.radius[left]).all()
    assert [flag for flag, out in zip(curve.meta["flags"], left, strict=True) if out] == ["excluded"] * 4
    assert np.array_equal(found.track.radius[~left], whole.track.radius[~left], equal_nan=True)
    assert "excluded by hand: frames 6, 12-14" in curve.notes
    assert found.options["exclude"] == "6, 12-14"
    assert found.without([13, 20]).options["exclude"] == "6, 12-14, 20"


def test_a_recording_that_is_cut_short_is_doubtful(tmp_path, folder):
    for name, cut in (("shot.mkv", "cut.mkv"), ("camera.mraw", "cut.mraw")):
        content = (folder / name).read_bytes()
        (tmp_path / cut).write_bytes(content[: int(0.8 * len(content))])
    shutil.copy(folder / "camera.cihx", tmp_path / "cut.cihx")
    assert [one.code for one in read(tmp_path / "cut.mraw").warnings] == ["check_input.file_cut_short"]
    cut = read(tmp_path / "cut.mkv")
    assert 20 < len(cut.frames) < FRAMES
    assert "check_input.file_cut_short" in [one.code for one in cut.warnings]


def several(place, shot):
    """Images of several sizes."""
    return [Image.fromarray(shot.frames[k][: 40 + k]).save(place / f"{k}.png") for k in range(4)]


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda place, shot: tifffile.imwrite(place, shot.frames[0]), "video.one_frame"),
        (lambda place, shot: tifffile.imwrite(place, shot.frames[:, :8, :8]), "video.small"),
        (lambda place, shot: place.write_bytes(b"no picture"), "video.undecodable"),
        (lambda place, shot: tifffile.imwrite(place, shot.frames[:3] * 0, photometric="minisblack"), "video.no_bubble"),
        (lambda place, shot: tifffile.imwrite(place, np.repeat(shot.frames[:1], 9, 0)), "video.no_bubble"),
        (lambda place, shot: [place.mkdir(), *several(place, shot)], "video.sizes"),
        (lambda place, shot: place.mkdir(), "video.no_images"),
        (lambda place, shot: None, "reading.missing"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path, shot, make, code):
    make(tmp_path / "a.tif", shot)
    with refused(code, "a.tif"):
        measure(tmp_path / "a.tif", **HOW)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"frame_rate": -1.0}, "video.frame_rate"),
        ({"um_per_px": float("nan")}, "video.um_per_px"),
        ({"exposure": 1.0}, "video.exposure"),
        ({"roi": (0, 0, 500, 20)}, "video.roi"),
        ({"span": (5, 500)}, "video.frames"),
        ({"reference_frame": 99}, "video.reference_frame"),
        ({"polarity": "grey"}, "video.polarity"),
        ({"exclude": "4-"}, "video.exclude"),
        ({"exclude": [99]}, "video.exclude"),
        ({"exclude": "1-34"}, "video.exclude"),
        ({"frame_rate": None}, "video.frame_rate"),
        ({"um_per_px": 1e6}, "curve.radius_unit"),
        ({"frame_rate": 1.0}, "video.frame_rate"),
        ({"frame_rate": 1e13}, "video.frame_rate"),
    ],
)
def test_options_out_of_their_range_are_refused(folder, wrong, code):
    assert code_of(lambda: measure(folder / "shot.tif", **{**HOW, **wrong})) == code


@pytest.mark.parametrize("count", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_damaged_files_are_answered_or_refused_in_words(tmp_path, folder, count):
    rng = np.random.default_rng(3)
    names = ("shot.mp4", "shot.mkv", "packed.tif", "camera.cine", "camera.cihx", "camera.mraw")
    for k in range(count):
        content = bytearray((folder / names[k % 6]).read_bytes())
        for at in rng.integers(0, min(len(content), 4000) if k % 2 else len(content), 12):
            content[at] = rng.integers(256)
        if k % 3 == 2:
            del content[rng.integers(len(content)) :]
        path = tmp_path / f"{k}{(folder / names[k % 6]).suffix}"
        path.write_bytes(content)
        for ending in {".mraw": [".cihx"], ".cihx": [".mraw"]}.get(path.suffix, []):
            path.with_suffix(ending).write_bytes((folder / f"camera{ending}").read_bytes())
        with contextlib.suppress(InputError):
            assert len(measure(path, **HOW).time) > 1


def test_folders_of_images_are_recordings_and_folders_of_recordings_are_not(folder):
    assert is_video(folder / "images")
    assert is_video(folder / "pages")
    assert not is_video(folder)
    assert expand([folder / "pages"]) == [folder / "pages"]
    assert len(expand([folder])) == 7  # the header of the .mraw is no recording of its own


def test_a_film_of_two_files_is_read_once(folder, tmp_path):
    for name in ("camera.mraw", "camera.cihx", "shot.tif"):
        shutil.copy(folder / name, tmp_path)
    shutil.copy(folder / "camera.cihx", tmp_path / "alone.cihx")
    taken = ["alone.cihx", "camera.mraw", "shot.tif"]  # a header alone, for its reader to say what is missing
    assert expand([tmp_path]) == [tmp_path / name for name in taken]
    assert expand(sorted(tmp_path.iterdir())) == expand([tmp_path / "*.*"]) == expand([tmp_path])
    assert expand([tmp_path / "camera.cihx"]) == [tmp_path / "camera.cihx"]


def test_the_command_writes_what_can_be_read_again(run, folder):
    done(run("measure", folder / "shot.tif", "--fps", RATE, "--um-per-px", SCALE, "-o", "out", "--overlay"))
    rows = rows_of("out/measured.csv")
    curve = measure(folder / "shot.tif", **HOW)
    (again,) = cavirheo.read_curves("out/measured.csv")
    assert again.radius == pytest.approx(curve.radius, rel=1e-4, nan_ok=True)
    assert again.radius_std == pytest.approx(curve.radius_std, rel=1e-4, nan_ok=True)
    assert [row["flag"] for row in rows] == list(curve.meta["flags"])
    about = json.loads(Path("out/measure.json").read_text(encoding="utf-8"))
    assert about["frame_rate_hz"] == {"value": RATE, "origin": "the user"}
    assert about["max_radius_m"] == pytest.approx(curve.max_radius)
    assert sum(about["flags"].values()) == FRAMES
    assert Image.open("out/contact.png").size[0] > 400
    assert len(read(Path("out/overlay.mp4")).frames) == FRAMES
    assert cavirheo.load("out").max_radius_px > 23
    assert run("show", "out")[0] == 0


def test_a_real_recording_agrees_with_its_published_radii(real_data):
    found, _ = examine(real_data / "video" / "PAstiff_xy002.mp4", frame_rate=270e3, um_per_px=2.76)
    published = loadmat(str(real_data / "video" / "PAstiff_xy002_RofT.mat"))["Rnew"].ravel()
    radius, top = found.track.radius, published.max()
    both = (found.track.flags == "ok") & (published > 0)
    assert found.track.flags[:3].tolist() == ["before", "flash", "dark"]
    assert np.sqrt(np.mean((radius[both] - published[both]) ** 2)) < 0.006 * top
    assert np.nanmax(radius) == pytest.approx(top, rel=0.003)


def test_real_camera_files(real_data):
    place = real_data / "video_formats"
    found = read(place / "cine_781.cine")
    assert found.time is not None
    assert 1 / np.diff(found.time)[0] == pytest.approx(9003, abs=1)
    assert found.frame_rate == 90_000
    packed = read(place / "ball_12bit.cihx")
    assert (packed.frames.shape, packed.frames.max(), packed.frame_rate) == ((15, 384, 384), 4095, 30_000)
    assert read(place / "beam.mraw").frames.shape == (4, 80, 1024)
