"""A doubt about the recording or its settings decides the verdict and stands in the message."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import BDT
from fits import fit

import cavirheo
from cavirheo import NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, read_curves, simulate
from cavirheo.inference import amortised, doubts
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.law import Family
from cavirheo.inference.options import Options
from cavirheo.inference.verify import verify
from cavirheo.landmarks import RAYLEIGH
from cavirheo.physics.media import WATER
from cavirheo.posterior import Bubble
from cavirheo.reading.shots import read_shots
from cavirheo.reading.table import write_csv
from cavirheo.reporting import read_json
from cavirheo.writing.terminal import once

infer = partial(cavirheo.infer, model="bdt-viscoelastic")
infer_many = partial(cavirheo.infer_many, model="bdt-viscoelastic")

SOFT = Path(__file__).parent.parent / "examples" / "soft_gel.csv"
FRAME = 1e-6


def shot(law=None, count=130, **about) -> RadiusCurve:
    time = FRAME * np.arange(count)
    return RadiusCurve(
        time,
        simulate(law or NeoHookeanKelvinVoigt(3e3, 0.05), max_radius=250e-6, stretch=7.0, time=time).radius,
        **about,
    )


@pytest.mark.parametrize(("radius", "time"), [(2.0, 1.0), (0.36, 1.0), (1.0, 1e-3), (1.0, 2.0)])
def test_a_wrong_scale_or_rate_is_no_ok(run, tmp_path, radius, time):
    """Diameters, pixels, ms as us, half the frame rate."""
    curve = read_curves(SOFT)[0]
    wrong = replace(curve, time=curve.time * time, radius=curve.radius * radius)
    write_csv(tmp_path / "wrong.csv", wrong)
    status, said, _ = run("infer", *BDT, tmp_path / "wrong.csv", "-o", "out")
    (record,) = read_json("out/result.json").curves
    assert record.verdict in (("failed",) if time < 1 else ("failed", "check_input"))  # no network reads a thousandth
    assert status == 1
    for document in (record.message, said, Path("out/report.html").read_text()):
        assert "Rayleigh" in document
    assert read_json("out/result.json").groups[0].n_trusted == 0


def test_who_vouches_for_the_input_gets_the_verdict_and_the_doubt():
    curve = replace(read_curves(SOFT)[0], doubts=("check the unit: it is odd",))
    doubtful, trusted = infer(curve), infer(curve, trust_input=True)
    assert (doubtful.checks.verdict, trusted.checks.verdict) == ("check_input", "ok")
    assert doubtful.checks.message == trusted.checks.message == "check the unit: it is odd"
    assert doubtful.median("shear_modulus") == trusted.median("shear_modulus")


def test_a_missing_first_frame_is_no_ok():
    """Every seventh frame is lost, the first one too: R_max was a frame before, and G comes out far too large."""
    true = shot()
    radius = true.radius.copy()
    radius[::7] = np.nan
    answer = infer(replace(true, radius=radius))
    assert answer.median("shear_modulus") > 1.5 * 3e3
    assert answer.checks.verdict == "check_input"
    assert "one frame before" in answer.checks.message
    (said,) = answer.checks.doubts
    factor = float(said.rsplit(" ", 1)[1])
    assert answer.median("shear_modulus") * factor == pytest.approx(3e3, rel=0.5)


def test_a_stated_or_recorded_maximum_is_no_doubt():
    assert infer(shot(stated_time_of_max=0.0)).checks.doubts == ()
    assert shot().begins_late
    assert not shot(maximum=(0.0, 250e-6)).begins_late
    assert not any(curve.begins_late for curve in read_curves(SOFT))
    assert shot().with_max_radius(200e-6).begins_late


def test_a_stiff_gel_hardly_depends_on_one_frame():
    assert infer(shot(NeoHookeanKelvinVoigt(4e4, 0.15))).checks.verdict == "ok"


@pytest.mark.slow
def test_a_fit_says_what_one_frame_would_change():
    answer = fit(shot(), windows=False)
    assert answer.checks.verdict == "check_input"
    said = float(answer.checks.doubts[0].rsplit(" ", 1)[1])
    earlier = fit(replace(shot(), maximum=(-FRAME, 250e-6)), windows=False)
    ratio = earlier.median("shear_modulus") / answer.median("shear_modulus")
    assert ratio < 1 / doubts.FACTOR
    assert said < 1 / doubts.FACTOR
    free = fit(shot(), windows=False, free=("t0",), t0_bound=FRAME)
    assert free.checks.doubts == ()  # its interval holds such a clock


def test_verification_keeps_the_doubt():
    curve = shot(count=70)
    answer = verify(curve, fit(curve, windows=False), level="map")
    assert answer.checks.verdict == "check_input"
    assert answer.checks.doubts


def test_a_single_wrong_frame_is_a_doubt_where_it_decides():
    curve = shot(stated_time_of_max=0.0)
    radius = curve.radius.copy()
    at = int(RAYLEIGH * WATER.time_scale(250e-6) / FRAME)  # where the bubble is smallest
    radius[at] = 0.9 * 250e-6
    assert "stand out" in infer(replace(curve, radius=radius)).checks.message


def test_a_first_collapse_alone_does_not_tell_the_viscosity_of_a_liquid():
    """In water it asked for up to ninety times the viscosity: walls and sound of the vessel lengthen it, too."""
    whole = shot(Newtonian(0.03), stated_time_of_max=0.0)
    seen = whole.time < whole.collapse_times()[0] + 2.5 * FRAME
    fall = RadiusCurve(whole.time[seen], whole.radius[seen], stated_time_of_max=0.0)

    def said(curve, law="newtonian", **around):
        options = Options(window=1, bubble=Bubble(**around))
        return doubts.of_walls(Experiment(curve, Family(law), options=options))

    assert "--confinement-inertia free" in said(fall)[0]
    assert said(whole) == said(fall, "nhkv") == said(fall, confinement_inertia="free") == []
    assert said(fall, wall_distance=1e-3) == said(fall, confinement_damping=0.3) == []
    answer = cavirheo.infer(fall, material="newtonian", verify="none")
    assert answer.checks.verdict == "check_input"
    assert "read the upper end of µ alone" in answer.checks.message
    assert cavirheo.infer(fall, material="newtonian", verify="none", trust_input=True).checks.verdict != "check_input"


def test_any_exception_of_one_curve_stays_with_it(monkeypatch):
    curves = read_curves(SOFT)[:2]
    whole = amortised.Amortised._doubts

    def broken(self, curve):
        if curve.name == curves[0].name:
            raise ZeroDivisionError("by zero")
        return whole(self, curve)

    monkeypatch.setattr(amortised.Amortised, "_doubts", broken)
    bad, good = infer_many(curves)
    assert (bad.checks.verdict, good.checks.verdict) == ("failed", "ok")
    assert "ZeroDivisionError" in bad.checks.message


def test_a_liquid_read_as_a_gel_is_told_in_one_line(run, tmp_path):
    for k in range(6):
        time = FRAME * np.arange(-20, 130)
        radius = simulate(
            Newtonian(0.03 + 0.002 * k), max_radius=250e-6, stretch=6.0, time=np.sort(np.abs(time))
        ).radius[np.argsort(np.argsort(np.abs(time), kind="stable"))]
        write_csv(tmp_path / f"shot{k}.csv", RadiusCurve(time, radius))
    files = [tmp_path / f"shot{k}.csv" for k in range(6)]
    _, said, _ = run("infer", *BDT, *files, "-o", "out")
    assert said.count("bdt-viscous") == 1
    assert said.count("• ") <= 4


def test_like_messages_are_one_with_their_range():
    found = once([("a", "misses by 6.5 % of {R}"), ("b", "misses by 12 % of {R}"), ("c", ""), ("d", "short")])
    assert found == {"misses by 6.5 to 12 % of R": ["a", "b"], "short": ["d"]}


def test_the_same_recording_counts_once(run, tmp_path):
    curve = read_curves(SOFT)[0]
    for place in ("one/s1.csv", "two/s1.csv"):
        (tmp_path / place).parent.mkdir()
        write_csv(tmp_path / place, curve)
    status, said, _ = run("infer", *BDT, "one/s1.csv", "two/s1.csv", "-o", "out")
    result = read_json("out/result.json")
    assert [group.n for group in result.groups] == [1]
    assert status == 0
    assert "two/s1.csv" in said
    assert any("two/s1.csv" in note for note in result.notes)


def test_names_are_told_apart_by_folder(tmp_path):
    curves = read_curves(SOFT)[:3]
    for place, curve in zip(("one/s1.csv", "two/s1.csv", "two/s2.csv"), curves, strict=True):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        write_csv(tmp_path / place, curve)
    files = sorted(tmp_path.glob("*/*.csv"))
    assert [one.name for one in read_shots(files).curves] == ["one/s1", "two/s1", "s2"]
    groups = {how: [one.group for one in read_shots(files, group=how).curves] for how in ("file", "folder", "none")}
    assert groups == {"file": ["s1", "s1", "s2"], "folder": ["one", "two", "two"], "none": ["one/s1", "two/s1", "s2"]}
    sources = {one.group_source for one in read_shots(files, group="file").curves}
    assert len(sources) == 3


def test_a_file_that_cannot_be_read_stands_in_the_documents(run, tmp_path):
    (tmp_path / "bad.csv").write_text("no numbers\n")
    assert run("infer", *BDT, SOFT, "bad.csv", "-o", "out")[0] == 2
    assert any("bad.csv" in note for note in read_json("out/result.json").notes)
    assert "bad.csv" in Path("out/report.html").read_text()
