"""The paper's network on shots of known truth, the true scale, and every way to fail."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from answers import simulated
from conftest import ROOT, refused, rows_of

import cavirheo
from cavirheo import Medium, NeoHookeanKelvinVoigt, RadiusCurve, read_curves
from cavirheo.inference.model import path_of
from cavirheo.inference.posterior_network import network_of
from cavirheo.physics.media import WATER

infer = partial(cavirheo.infer, model="bdt-viscoelastic")
infer_many = partial(cavirheo.infer_many, model="bdt-viscoelastic")

EXAMPLES = ROOT / "examples"


def shot(G=8e3, mu=0.05, **given) -> RadiusCurve:
    return simulated(NeoHookeanKelvinVoigt(G, mu), **{"frames": 140, "stated_time_of_max": 0.0, **given})


@pytest.mark.parametrize("file", ["soft_gel.csv", "stiff_gel.mat"])
def test_shipped_examples_give_back_their_truth(file):
    truth = [row for row in rows_of(EXAMPLES / "truth.csv") if row["set"] == Path(file).stem]
    answers = infer_many(read_curves(EXAMPLES / file))
    assert [a.checks.verdict for a in answers] == ["ok"] * len(truth)
    G, mu = (np.array([a.median(name) for a in answers]) for name in ("shear_modulus", "viscosity"))
    assert np.mean(G) == pytest.approx(float(truth[0]["shear_modulus_Pa"]), rel=0.15)
    assert np.mean(mu) == pytest.approx(float(truth[0]["viscosity_Pa_s"]), rel=0.2)
    stretches = [a.stretch for a in answers]
    assert stretches == pytest.approx([float(row["stretch"]) for row in truth], rel=0.08)
    assert max(a.checks.rmse_over_rmax for a in answers) < 0.03


@pytest.mark.parametrize("max_radius", [210e-6, 300e-6])
@pytest.mark.parametrize("medium", [WATER, Medium(density=1100.0, sound_speed=1600.0, surface_tension=0.06)])
def test_the_medium_and_small_changes_of_size_enter(max_radius, medium):
    """Equal Cauchy and Reynolds numbers carry the answer over where surface tension and heat change little."""
    time = np.arange(0.0, 5 * medium.time_scale(max_radius), 0.25e-6)
    curve = shot(max_radius=max_radius, time=time, medium=medium)
    answer = infer(curve, medium=medium)
    assert answer.checks.verdict == "ok"
    assert answer.median("shear_modulus") == pytest.approx(8e3, rel=0.1)
    assert answer.median("viscosity") == pytest.approx(0.05, rel=0.2)


def test_another_size_than_that_of_the_training_is_said():
    """The paper's network takes a small bubble's surface tension and heat for viscosity; the default does not."""
    small = shot(mu=0.01, max_radius=90e-6)
    paper, default = infer(small), cavirheo.infer(small, material="nhkv", trust_input=True)
    assert paper.checks.verdict == "outside_training_range"
    assert infer(shot(stretch=2.0)).checks.verdict in ("outside_training_range", "model_does_not_fit")
    off = [abs(np.log10(answer.median("viscosity") / 0.01)) for answer in (paper, default)]
    assert off[1] < 0.5 * off[0]


def test_a_short_recording_is_completed_and_says_so():
    answer = infer(shot(frames=97))
    assert answer.checks.messages
    assert answer.median("shear_modulus") == pytest.approx(8e3, rel=0.15)


@pytest.mark.parametrize(
    "radii",
    [[1e-4, 2e-4, 1e-4], np.full(50, np.nan), np.linspace(1e-4, 3e-4, 50)],
    ids=["three", "nothing", "grows"],
)
def test_what_cannot_be_answered_fails_with_its_reason(radii):
    answer = infer(RadiusCurve(np.arange(len(radii)) * 1e-6, radii, meta={"name": "bad"}))
    assert answer.checks.verdict == "failed"
    assert answer.checks.messages
    assert len(answer.theta) == 0
    assert answer.median("viscosity") is None
    assert (answer.best, answer.stretch) == ({}, None)


def test_a_wrong_model_is_refused():
    """A bubble that swells again to four times its plateau is no neo-Hookean bubble."""
    curve = shot(mu=0.1)
    drift = replace(curve, radius=curve.radius * (1 + 3.0 * np.maximum(0, curve.time / 90e-6 - 0.3)))
    assert infer(drift).checks.verdict == "model_does_not_fit"


def test_a_wrong_law_is_answered_and_refused():
    """A stiff gel as a liquid: what the network's draws do not know is simulated, too."""
    gel = cavirheo.read_curves(EXAMPLES / "stiff_gel.mat")[0]
    curve = RadiusCurve(gel.time - gel.time[0], gel.radius)
    assert cavirheo.infer(curve, material="newtonian", bubble="field").checks.verdict == "model_does_not_fit"


def test_rounded_radii_and_a_second_bubble_are_no_wrong_answer():
    """Radii to 10 um; and a bubble of another pulse, late in the recording."""
    curve = shot(G=8e3, mu=0.03)
    rounded = replace(curve, radius=np.maximum(np.round(curve.radius / 1e-5), 1.0) * 1e-5)
    again = np.append(curve.time, curve.time + curve.time[-1] + 1e-6), np.append(curve.radius, 0.8 * curve.radius)
    answers = cavirheo.infer_many([rounded, RadiusCurve(*again, meta={"name": "two"})], material="nhkv")
    for answer in answers:
        low, high = answer.interval("shear_modulus")
        assert low < 8e3 < high
        assert answer.checks.verdict in ("ok", "undetermined", "other_model_preferred")
    assert "another bubble" in answers[1].checks.message


def test_a_point_answer_has_no_interval_and_a_full_record():
    curve = shot()
    answer = infer(curve, stretch=7.0, window=2)
    assert answer.interval("shear_modulus") is None
    assert answer.stretch == answer.provenance["stretch"] == 7.0
    assert answer.diagnostics.stretch_source == answer.provenance["stretch_source"] == "given"
    assert answer.provenance["model_sha256"] == network_of("bdt-viscoelastic").sha256
    assert answer.best == {name: answer.median(name) for name in ("shear_modulus", "viscosity")} | {"stretch": 7.0}
    assert answer.checks.collapses == 2
    found = answer.checks
    assert found.compared_time[-1] - curve.time_of_max == pytest.approx(found.t_star_end * found.time_scale)
    assert found.rmse_over_rmax == pytest.approx(np.sqrt(np.mean(found.residual_over_rmax**2)))
    assert found.mae_over_rmax <= found.rmse_over_rmax <= found.max_difference_over_rmax


def test_a_network_that_was_read_is_checked_again_when_its_file_changes(tmp_path):
    for suffix in (".onnx", ".json"):
        shutil.copy(path_of("posterior").with_suffix(suffix), tmp_path / f"copy{suffix}")
    path = tmp_path / "copy.onnx"
    assert network_of(str(path)) is network_of(str(path))
    path.write_bytes(path.read_bytes() + b"x")
    for code in ("model.changed", "model.card"):
        with refused(code):
            network_of(str(path))
        path.with_suffix(".json").write_text("{}")


def test_the_shipped_model_is_what_its_card_says():
    """At least 3,000 training curves, metrics of a test part that training did not see, R2 of a usable model."""
    card = json.loads(path_of("bdt-viscoelastic").with_suffix(".json").read_text())
    assert card["data"]["train"] >= 3000
    assert card["data"]["test"] >= 0.09 * card["data"]["n"]
    problem = network_of("bdt-viscoelastic").problem
    assert problem.id == card["problem_id"]
    theta = problem.prior.sample(range(10**7, 10**7 + 60), seed=99)  # draws that no training set holds
    curves = np.array([run.radius for run in problem.simulate_many(theta)]) / problem.reference_max_radius
    error = np.median(np.abs(network_of("bdt-viscoelastic")(curves) - theta[:, :2]), axis=0)
    for name, off in zip(("log10_shear_modulus", "log10_viscosity"), error, strict=True):
        assert off < 3 * card["metrics"][name]["median_absolute_error"]


def test_a_recording_that_begins_a_little_before_its_maximum_is_not_taken_to_begin_at_it():
    """Six frames of growth, within 2 % of R_max, are hidden in the noise: which frame is the maximum is not known."""
    clean = simulated(NeoHookeanKelvinVoigt(1e4, 0.02), frames=150, frame=5e-7, max_radius=155e-6, stretch=5.2)
    time = 5e-7 * np.arange(-6, 150)
    radius = np.append(clean.radius[6:0:-1], clean.radius) + 1.7e-6 * np.random.default_rng(0).standard_normal(156)
    recording = RadiusCurve(time - time[0], radius)
    assert recording.begins_late
    earliest, latest = recording.time_of_max_span
    assert earliest < 3e-6 < latest
    answer = cavirheo.infer(recording, material="nhkv")
    assert answer.checks.verdict == "ok"
    for name, truth in (("shear_modulus", 1e4), ("viscosity", 0.02)):
        low, high = answer.interval(name, 0.99)
        assert low < truth < high < 3 * low


def test_noise_alone_is_no_misfit():
    """3.5 % of R_max between neighbouring frames: more than the limit of 3 % that a model may miss."""
    answer = cavirheo.infer(simulated(frames=60, noise=0.035), material="nhkv")
    assert answer.checks.rmse_over_rmax > 0.03
    assert answer.checks.verdict in ("ok", "undetermined")


def test_published_alginate_shots(real_data):
    """PAAm 12 % - alginate 0.3 %, five shots: published IMR 6.44 +- 1.64 kPa and 0.020 +- 0.009 Pa s."""
    (file,) = (real_data / "paam_alginate_0p3").glob("*.mat")
    answers = infer_many(read_curves(file))
    G, mu = ([one.median(name) for one in answers] for name in ("shear_modulus", "viscosity"))
    assert len(answers) == 5
    assert np.mean(G) == pytest.approx(6440, abs=1640)
    assert np.mean(mu) == pytest.approx(0.020, abs=0.018)
