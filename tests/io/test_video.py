"""Radii from rendered recordings, where R(t) is known."""

import numpy as np
import pytest
from conftest import refused
from recordings import FRAMES, film, history

from cavirheo import InputError
from cavirheo.video import Film, Scene, render
from cavirheo.video.frames import Footage
from cavirheo.video.stage import set_stage
from cavirheo.video.track import USED, Track, follow

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
def clean():
    return film()


def track(made: Film, exposure: float | None = None, **how: object) -> Track:
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


def test_exposure_shows_in_the_blur_and_shape_and_centre_in_the_outline():
    assert track(film(exposure=0.8)).exposure_hint == pytest.approx(0.8, abs=0.2)
    made = film(modes=((2, 0.06, 0.0),), drift=(0.2, 0.0))
    found = track(made, 0.3)
    assert np.abs(found.x - made.centre[:, 0])[found.flags == "ok"].max() < 0.1
    assert np.nanmedian(found.asphericity) == pytest.approx(0.06, abs=0.005)


def test_nothing_is_invented_where_no_outline_is_seen():
    """Without a bubble, or while one covers the frame; a mirror image is named."""
    without = render([0, 1], [0.01, 0.01], frames=FRAMES, scene=Scene(width=96, height=80, flicker=0.02))
    for made in (without, film(centre=(-80.0, -80.0))):
        with refused("video.no_bubble"):
            track(made)
    made = film(width=42, height=36, top=30.0)
    assert not np.any(np.isfinite(track(made).radius) & (made.radius > 28))
    assert track(film(centre=(43.0, 23.0), top=16.0, wall=41.0, mirror=True)).twins > 5


def test_polarity_and_reference_frame_are_obeyed(clean):
    for polarity in ("bright", "grey"):
        with pytest.raises(InputError):
            track(clean, polarity=polarity)
    free, told = track(clean), track(clean, reference_frame=1)
    both = (free.flags == "ok") & (told.flags == "ok")
    assert np.abs(free.radius - told.radius)[both].max() < 0.2


def test_flags_say_what_is_used_and_spoilt_frames_are_told_apart(clean):
    frames, damaged = clean.frames.copy(), np.arange(FRAMES) == 12
    frames[20] = frames[0]
    frames[20, 5:15, 5:15] = 5
    found = follow(set_stage(Footage(frames, damaged=damaged)))
    assert (found.flags[12], found.flags[20]) == ("lost", "elsewhere")
    used = np.isin(found.flags, USED)
    assert np.array_equal(np.isfinite(found.radius), used)
    assert np.all(found.sigma[used] > 0)
    found = track(film(empty=2, flash=1, dark_frames=1))
    assert found.flags[:4].tolist() == ["before", "before", "flash", "dark"]


def test_the_same_seed_gives_the_same_film_and_what_cannot_be_rendered_is_refused():
    assert np.array_equal(film(seed=5, frames=8).frames, film(seed=5, frames=8).frames)
    assert not np.array_equal(film(seed=5, frames=8).frames, film(seed=6, frames=8).frames)
    time, radius = history()
    for times, frames in ((time[::-1], 9), (time, 2)):
        with pytest.raises(InputError):
            render(times, radius, frames=frames)
