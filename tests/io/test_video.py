"""Recordings: radii where R(t) is known, what is read of each format, what is refused, and the command."""

import contextlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from conftest import code_of, done, refused, rows_of
from PIL import Image
from recordings import FRAMES, RATE, SCALE, film, write_cine, write_mraw
from scipy.io import loadmat

import cavirheo
from cavirheo import InputError, measure
from cavirheo.io.files import expand, without_headers
from cavirheo.io.shots import examine
from cavirheo.video.formats import Footage, is_video, read
from cavirheo.video.stage import set_stage
from cavirheo.video.track import USED, Track, follow
from validation.rendering import Film, Scene, render

HOW = {"frame_rate": RATE, "um_per_px": SCALE}
SCENES = {
    "clean": {},
    "no_frame_without_the_bubble": {"empty": 0},
    "taller_than_the_frame": {"height": 42, "exposure": 0.8, "flash": 1, "dark_frames": 1, "empty": 1},
    "noisy_10_bits": {"bits": 10, "noise": 0.0165, "row_noise": 0.008},
    "ellipse_and_drift": {"modes": ((2, 0.05, 0.3), (3, 0.01, 1.0)), "drift": (0.1, 0.05)},
    "wall_dust_shock_satellites_flicker": {
        "gradient": 0.4, "wall": 66.0, "dust": 5, "shock": True, "satellites": 2, "flicker": 0.05,
    },
    "bright": {"lit": 0.12, "dark": 6.0},
    "low_contrast_16_bits": {"bits": 16, "dark": 0.8},
    "bright_centre_long_exposure": {"bright_centre": 0.6, "exposure": 0.6},
}  # fmt: skip
MORE = ("noisy_10_bits", "bright", "bright_centre_long_exposure")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place, shot, deep = tmp_path_factory.mktemp("recordings"), film(), film(bits=12)
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


@pytest.fixture(scope="module")
def whole(folder):
    """Of shot.tif: (what is found, its curve)."""
    return examine(folder / "shot.tif", **HOW)


def track(made: Film, exposure: float = 1.0, **how: object) -> Track:
    footage = Footage(made.frames, damaged=np.zeros(len(made.frames), bool))
    return follow(set_stage(footage, **how), exposure)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in MORE)) for name in SCENES])
def test_radii_are_true(name):
    made = film(**SCENES[name])
    found = track(made, SCENES[name].get("exposure", 0.3))
    ok = (found.flags == "ok") & (made.radius > 3)
    error = found.radius[ok] - made.radius[ok]
    assert ok.sum() >= 0.6 * np.isfinite(made.radius).sum()
    assert abs(error.mean()) < 0.03
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.mean(np.abs(error) < 2 * found.sigma[ok]) > 0.75
    assert np.abs(error).max() < 0.4
    assert not np.any(np.isfinite(found.radius) & np.isnan(made.radius))
    assert not np.any(made.reversal & (found.flags == "ok"))


def test_a_shock_wave_does_not_stay_in_the_background():
    made = film(width=256, height=176, top=60.0, shock=True)
    found = track(made, 0.3)
    ok = (found.flags == "ok") & (made.radius > 3)
    assert np.mean(np.abs(found.radius - made.radius)[ok] < 2 * found.sigma[ok]) > 0.95


def test_small_bubbles_are_measured_by_their_light():
    made = film(top=9.0, width=64, height=64)
    found = track(made, 0.3)
    small = found.flags == "small"
    assert small.sum() > 5
    assert np.sqrt(np.mean((found.radius[small] - made.radius[small]) ** 2)) < 0.1
    assert made.radius[small].max() < 4.5


def test_shape_and_centre_show_in_the_outline(tmp_path):
    made = film(modes=((2, 0.06, 0.0),), drift=(0.2, 0.0))
    found = track(made, 0.3)
    assert np.abs(found.x - made.centre[:, 0])[found.flags == "ok"].max() < 0.1
    assert np.nanmedian(found.asphericity) == pytest.approx(0.06, abs=0.005)
    tifffile.imwrite(tmp_path / "a.tif", made.frames)
    (warning,) = measure(tmp_path / "a.tif", **HOW).warnings
    assert (warning.code, warning.parameters["share"]) == ("check_input.aspherical", pytest.approx(0.113, abs=0.01))


def test_nothing_is_invented_where_no_outline_is_seen():
    """Without a bubble, or while one covers the frame; a second bubble is named."""
    without = render([0, 1], [0.01, 0.01], frames=FRAMES, scene=Scene(width=96, height=80, flicker=0.02))
    for made in (without, film(centre=(-80.0, -80.0))):
        assert code_of(track, made) == "video.no_bubble"
    made = film(width=42, height=36, top=30.0)
    assert not np.any(np.isfinite(track(made).radius) & (made.radius > 28))
    one, other = (film(centre=(x, 36.0), top=16.0) for x in (22.0, 64.0))
    assert track(replace(one, frames=np.minimum(one.frames, other.frames))).twins > 5
    for k, frame in enumerate(frames := film().frames.copy()):
        frame[4:12, 4 + 2 * k : 12 + 2 * k] = 0  # a time stamp that moves
    assert track(replace(one, frames=frames)).twins == 0


def test_flags_say_what_is_used_and_spoilt_frames_are_told_apart():
    frames, damaged = film().frames.copy(), np.arange(FRAMES) == 12
    frames[20] = frames[0]
    frames[20, 5:15, 5:15] = 5
    found = follow(set_stage(Footage(frames, damaged=damaged)))
    assert (found.flags[12], found.flags[20]) == ("lost", "elsewhere")
    used = np.isin(found.flags, USED)
    assert np.array_equal(np.isfinite(found.radius), used)
    assert np.all(found.sigma[used] > 0)
    found = track(film(empty=2, flash=1, dark_frames=1))
    assert found.flags[:4].tolist() == ["before", "before", "flash", "dark"]


BITS = {"shot.mkv": 8, "shot.tif": 8} | dict.fromkeys(("deep.mkv", "packed.tif", "images", "pages", "camera.cine"), 12)


@pytest.mark.parametrize("name", BITS)
def test_frames_are_read_as_they_are(folder, name):
    frames, expected = read(folder / name).frames, film(bits=BITS[name]).frames
    assert (frames.dtype, frames.tolist()) == (expected.dtype, expected.tolist())


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_mraw_is_read_bit_by_bit(tmp_path, bits):
    frames = np.random.default_rng(bits).integers(0, 2**bits, (3, 20, 32))
    found = read(write_mraw(tmp_path / "a.mraw", frames, bits, rate=1234))
    assert np.array_equal(found.frames, frames)
    assert (found.frame_rate, found.exposure) == (1234.0, pytest.approx(4e-7))


def test_the_stamps_of_a_cine_count_before_its_header(tmp_path):
    stamps = 0.9999995 + np.arange(FRAMES) / RATE  # over the turn of a second
    found = read(write_cine(tmp_path / "a.cine", film(bits=12).frames, stamps, 50_000))
    assert found.time == pytest.approx(np.arange(FRAMES) / RATE, abs=2e-9)
    assert found.exposure == pytest.approx(1e-6, rel=1e-3)
    given = measure(tmp_path / "a.cine", um_per_px=SCALE, frame_rate=4e5)
    assert given.time == pytest.approx(np.arange(FRAMES) / 4e5)
    curve = measure(tmp_path / "a.cine", um_per_px=SCALE)
    assert curve.frame_rate == pytest.approx(RATE, rel=1e-3)
    assert any("50000" in one.text for one in curve.warnings)


def test_what_the_camera_states_and_no_bubble_has_is_not_laid_to_the_user(tmp_path):
    path = write_cine(tmp_path / "a.cine", film(bits=12).frames, np.arange(FRAMES) / 100, 100)
    slow = "100 frames per second by the camera's time stamps: expected 1000 or more"
    with refused("video.frame_rate", slow, "--fps"):
        measure(path)
    with refused("video.exposure", "1 us by the camera's header", "0.5 us between frames by the user", "--exposure-us"):
        measure(path, frame_rate=2e6)
    assert measure(path, frame_rate=2e6, exposure=4e-7).frame_rate == 2e6


@pytest.mark.parametrize("step", [1, 36])
def test_the_older_header_of_photron(tmp_path, step):
    frames = np.random.default_rng(2).integers(0, 2**12, (3, 20, 32))
    write_mraw(tmp_path / "a.mraw", frames, 16)
    (tmp_path / "a.cihx").unlink()
    lines = ("#Camera Information Header", "Record Rate(fps) : 60000", "Shutter Speed(s) : 1/800000", "Total Frame : 3")
    more = (f"Save Step : {step}", "Image Width : 32", "Image Height : 20", "Color Type : Mono", "Color Bit : 16")
    text = "\n".join((*lines, *more, "Shutter Type2(nsec) : 1250", "", "#System Information:", "Total Frame : 9"))
    (tmp_path / "a.cih").write_text(text)
    for name in ("a.mraw", "a.cih"):
        found = read(tmp_path / name)
        assert np.array_equal(found.frames, frames)
        assert (found.frame_rate, found.exposure, found.warnings) == (60_000, pytest.approx(1.25e-6), ())
        assert found.time is None if step == 1 else found.time == pytest.approx(np.arange(3) * 36 / 60e3)
    assert expand(tmp_path) == [tmp_path / "a.mraw"]


def test_rate_and_scale_are_the_users_before_the_cameras(folder, tmp_path):
    """A difference is doubtful; a container never says the rate; without a scale radii are pixels, which inference
    refuses. Compression hardly moves the radius."""
    for name in ("shot.mp4", "shot.mkv", "shot.tif", "images"):
        assert code_of(measure, folder / name, um_per_px=SCALE) == "video.frame_rate"
    curve = measure(folder / "camera.mraw", frame_rate=4e5, um_per_px=SCALE)
    assert (curve.frame_rate, len(curve.warnings)) == (4e5, 1)
    assert measure(folder / "camera.mraw", um_per_px=SCALE).warnings == ()
    curve = measure(folder / "shot.mp4", frame_rate=RATE)
    ok = np.array(curve.meta["flags"]) == "ok"
    assert np.sqrt(np.mean((curve.radius[ok] * 1e6 - film().radius[ok]) ** 2)) < 0.05
    assert code_of(lambda: curve.max_radius) == "curve.unscaled"
    assert curve.with_max_radius(128e-6).max_radius == 128e-6


def imagej(text: str, **more: object) -> dict:
    """How ImageJ describes a stack with pixels of 4 um, 0.25 per um."""
    head = f"ImageJ=1.54f\nimages={FRAMES}\nframes={FRAMES}\n{text}\n".encode("latin-1", "backslashreplace")
    return {"description": head, "metadata": None, "resolution": (0.25, 0.25)} | more


OME = {"axes": "TYX", "PhysicalSizeX": 4.0, "TimeIncrement": 2.0, "TimeIncrementUnit": "µs"}
STACKS = {  # how a stack is written; its um per pixel and frames per second
    **{
        unit: (imagej(f"unit={unit}"), 4.0, None)
        for unit in ("um", "micron", "microns", "micrometer", "\\u00B5m", "µm")
    },
    "an interval": (imagej("unit=micron\nfinterval=0.002\ntunit=ms"), 4.0, 5e5),
    "how fast it is played": (imagej("unit=mm\nfinterval=0.1", resolution=(250, 250)), 4.0, None),
    "pixels alone": (imagej("unit=pixel"), None, None),
    "for printing": ({"resolution": (72, 72), "resolutionunit": "INCH"}, None, None),
    "per cm, by no description": ({"resolution": (2500, 2500), "resolutionunit": "CENTIMETER"}, None, None),
    "OME": ({"ome": True, "metadata": OME}, 4.0, 5e5),
}


@pytest.mark.parametrize("name", STACKS)
def test_the_scale_and_the_rate_that_a_stack_states(tmp_path, name):
    how, scale, rate = STACKS[name]
    frames = film().frames
    tifffile.imwrite(tmp_path / "a.tif", frames, **how)
    found = read(tmp_path / "a.tif")
    assert np.array_equal(found.frames, frames)
    assert (found.um_per_px, found.frame_rate) == (scale and pytest.approx(scale), rate and pytest.approx(rate))
    assert found.notes == (("the file states 4 um per pixel",) if scale else ())  # true also where the user gives it


def test_parts_of_a_recording(folder, whole):
    found, curve = examine(folder / "shot.tif", **HOW, span=(3, 25), roi=(8, 6, 72, 60))
    assert (len(curve.time), curve.time[0]) == (23, pytest.approx(2 / RATE))
    both = np.isfinite(found.track.radius) & np.isfinite(whole[0].track.radius[2:25])
    assert np.abs(found.track.radius - whole[0].track.radius[2:25])[both].max() < 0.2
    assert np.abs(found.track.x + 8 - whole[0].track.x[2:25])[both].max() < 0.2


@pytest.mark.parametrize("listed", ["6, 12-14", [13, 6, 12, 14]])
def test_frames_can_be_excluded_by_hand(folder, whole, listed):
    found, curve = examine(folder / "shot.tif", **HOW, exclude=listed)
    left = np.isin(np.arange(1, FRAMES + 1), [6, 12, 13, 14])
    assert np.isnan(curve.radius[left]).all()
    assert [flag for flag, out in zip(curve.meta["flags"], left, strict=True) if out] == ["excluded"] * 4
    assert found.track.radius[~left] == pytest.approx(whole[0].track.radius[~left], abs=0.05, nan_ok=True)
    assert "excluded by hand: frames 6, 12-14" in curve.notes
    assert found.options["exclude"] == "6, 12-14"


def test_a_recording_that_is_cut_short_is_doubtful(tmp_path, folder):
    shutil.copy(folder / "camera.cihx", tmp_path)
    for name in ("shot.mkv", "camera.mraw", "shot.tif", "packed.tif"):
        content = (folder / name).read_bytes()
        (tmp_path / name).write_bytes(content[: int(0.8 * len(content))])
        cut = read(tmp_path / name)
        assert 20 < len(cut.frames) < FRAMES
        code = "file_damaged" if name == "packed.tif" else "file_cut_short"  # which states no number of frames
        assert [one.code for one in cut.warnings] == [f"check_input.{code}"]
    files = "".join(f'<TiffData FirstT="{9 * k}"><UUID FileName="{k}.tif">{k}</UUID></TiffData>' for k in (0, 1))
    size = 'DimensionOrder="XYCZT" Type="uint8" SizeX="88" SizeY="72" SizeC="1" SizeZ="1" SizeT="18"'
    about = f"<OME><Image><Pixels {size}>{files}</Pixels></Image></OME>"
    tifffile.imwrite(tmp_path / "0.tif", film().frames[:9], description=about, metadata=None)
    assert [one.code for one in read(tmp_path / "0.tif").warnings] == ["check_input.file_of_set"]


NO_RECORDINGS: dict[str, tuple[str, Callable]] = {
    "one frame": ("video.one_frame", lambda place: tifffile.imwrite(place, film().frames[0])),
    "a few pixels": ("video.small", lambda place: tifffile.imwrite(place, film().frames[:, :8, :8])),
    "no picture": ("video.undecodable", lambda place: place.write_bytes(b"no picture")),
    "darkness": ("video.no_bubble", lambda place: tifffile.imwrite(place, film().frames[:9] * 0)),
    "a still": ("video.no_bubble", lambda place: tifffile.imwrite(place, np.repeat(film().frames[:1], 9, 0))),
    "nothing": ("reading.missing", lambda place: None),
    "channels": ("video.stack", lambda at: tifffile.imwrite(at, film().frames[:8].reshape(4, 2, 72, 88), imagej=True)),
    "computed numbers": ("video.pixels", lambda place: tifffile.imwrite(place, film().frames / 2.0)),
}


@pytest.mark.parametrize("name", NO_RECORDINGS)
def test_what_is_no_recording_is_refused(tmp_path, name):
    code, make = NO_RECORDINGS[name]
    make(tmp_path / "a.tif")
    with refused(code, "a.tif"):
        measure(tmp_path / "a.tif", **HOW)


WRONG = {
    "video.frame_rate": [{"frame_rate": -1.0}, {"frame_rate": 1.0}, {"frame_rate": 1e13}],
    "video.um_per_px": [{"um_per_px": float("nan")}],
    "curve.radius_unit": [{"um_per_px": 1e6}],
    "video.exposure": [{"exposure": 1.0}],
    "video.roi": [{"roi": (0, 0, 500, 20)}],
    "video.frames": [{"span": (5, 500)}],
    "video.polarity": [{"polarity": "grey"}],
    "video.no_bubble": [{"polarity": "bright"}],
    "video.exclude": [{"exclude": "4-"}, {"exclude": [99]}, {"exclude": "1-34"}],
}


@pytest.mark.parametrize(("code", "wrong"), [(code, wrong) for code, many in WRONG.items() for wrong in many])
def test_options_out_of_their_range_are_refused(folder, wrong, code):
    assert code_of(measure, folder / "shot.tif", **{**HOW, **wrong}) == code


@pytest.mark.parametrize("count", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_damaged_files_are_answered_or_refused_in_words(tmp_path, folder, count):
    rng = np.random.default_rng(3)
    names = ("shot.mp4", "shot.mkv", "packed.tif", "camera.cine", "camera.cihx", "camera.mraw")
    for k in range(count):
        shutil.copytree(folder, tmp_path / str(k), ignore=shutil.ignore_patterns("images", "pages"))
        path = tmp_path / str(k) / names[k % 6]
        content = bytearray(path.read_bytes())
        for at in rng.integers(0, min(len(content), 4000) if k % 2 else len(content), 12):
            content[at] = rng.integers(256)
        if k % 3 == 2:
            del content[rng.integers(len(content)) :]
        path.write_bytes(content)
        with contextlib.suppress(InputError):
            assert len(measure(path, **HOW).time) > 1


def test_folders_of_images_and_films_of_two_files_are_one_recording_each(folder, tmp_path):
    assert [is_video(folder / name) for name in ("images", "pages", ".")] == [True, True, False]
    assert expand(folder / "pages") == [folder / "pages"]
    assert len(expand(folder)) == 7  # the header of the .mraw is no recording of its own
    for name in ("camera.mraw", "camera.cihx", "shot.tif"):
        shutil.copy(folder / name, tmp_path)
    shutil.copy(folder / "camera.cihx", tmp_path / "alone.cihx")
    taken = ["alone.cihx", "camera.mraw", "shot.tif"]  # a header alone, for its reader to say what is missing
    assert expand(tmp_path) == [tmp_path / name for name in taken]
    assert without_headers(sorted(tmp_path.iterdir())) == expand(tmp_path / "*.*") == expand(tmp_path)
    assert expand(tmp_path / "camera.cihx") == [tmp_path / "camera.cihx"]


def test_a_folder_that_lacks_an_image_is_doubtful_and_one_of_two_recordings_refused(folder, tmp_path):
    shutil.copytree(folder / "images", tmp_path / "images")
    assert read(tmp_path / "images").warnings == ()
    (tmp_path / "images" / "frame17.png").unlink()
    (warning,) = read(tmp_path / "images").warnings
    assert (warning.code, warning.parameters) == ("check_input.images_missing", {"gaps": 1})
    assert "have 1 gap, as" in warning.text
    for number in (-1, 0, 1):  # negative before the trigger; a dash where no name has a number without it
        for name in (f"images/x_{number}", f"Frame_-{3 + number}", f"frame{7 + number}"):
            shutil.copy(folder / "images" / f"frame{abs(number)}.png", tmp_path / f"{name}.png")
    assert read(tmp_path).notes[0].endswith("frame6.png to Frame_-4.png")
    with refused("video.names", "2 names, frame, x_:"):
        read(tmp_path / "images")


def test_the_command_writes_what_can_be_read_again(run, folder, whole):
    done(run("measure", folder / "shot.tif", "--fps", RATE, "--um-per-px", SCALE, "-o", "out"))
    rows, (_, curve) = rows_of("out/measured.csv"), whole
    (again,) = cavirheo.read_curves("out/measured.csv")
    assert again.radius == pytest.approx(curve.radius, rel=1e-4, nan_ok=True)
    assert again.radius_std == pytest.approx(curve.radius_std, rel=1e-4, nan_ok=True)
    assert [row["flag"] for row in rows] == list(curve.meta["flags"])
    about = json.loads(Path("out/measure.json").read_text(encoding="utf-8"))
    assert about["frame_rate_hz"] == {"value": RATE, "origin": "the user"}
    assert about["max_radius_m"] == pytest.approx(curve.max_radius)
    assert sum(about["flags"].values()) == FRAMES
    assert Image.open("out/contact.png").size[0] > 400
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
    late = read(place / "excerpt.cine")
    assert np.allclose(np.diff(late.time), 0.01)
    assert [one.code for one in late.warnings] == ["check_input.time_stamps"]
    with refused("video.mraw_pair", "sample_60k_16bit.mraw"):
        read(place / "sample_60k_16bit.cih")
    packed = read(place / "ball_12bit.cihx")
    assert (packed.frames.shape, packed.frames.max(), packed.frame_rate) == ((15, 384, 384), 4095, 30_000)
    assert read(place / "beam.mraw").frames.shape == (4, 80, 1024)
