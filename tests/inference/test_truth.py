"""Answers for simulated shots of known truth: intervals, switches and bounds, and what they do not depend on."""

from dataclasses import replace

import numpy as np
import pytest
from answers import GEL, holds, same, simulated
from conftest import EXAMPLE, ROOT, rows_of

import cavirheo
from cavirheo import Bubble, Medium, NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, fit, infer, infer_many
from cavirheo.inference import experiment
from cavirheo.inference.which_law import rank_laws
from cavirheo.physics.laws import Fung, PowerLaw
from cavirheo.physics.materials import Viscoelastic

REAL = Bubble("kinetic", 0.1, confinement_inertia=0.03, confinement_damping=0.15)
STIFF = Viscoelastic(Fung(5e3, 0.05), Newtonian(0.05))
THINS = PowerLaw(0.08 * 1e5**0.5, 0.5)  # 0.08 Pa s at 1e5 1/s
SHOTS = {  # law, stretch and bubble; what the intervals hold; switches that are on, and that are off
    "gel": (GEL, 6.5, REAL, {"shear_modulus": 8e3, "accommodation": 0.1}, {}, {"liquid"}),
    "liquid": (Newtonian(0.03), 8.0, REAL, {}, {"liquid"}, set()),
    "thinning": (THINS, 8.0, REAL, {}, {"liquid", "thinning"}, set()),
    "field": (GEL, 6.5, Bubble(), {"shear_modulus": 8e3}, {"field_bubble"}, {"liquid"}),
    # 90 frames with 0.8 % noise do not tell this stiffening from none
    "stiffening": (STIFF, 6.5, REAL, {"shear_modulus": 5e3}, set(), {"liquid"}),
}


COLUMNS = {"shear_modulus": "shear_modulus_Pa", "viscosity": "viscosity_Pa_s", "stretch": "stretch"}


def shot(name: str, noise=0.008, seed=2) -> RadiusCurve:
    law, stretch, bubble, *_ = SHOTS[name]
    about = {"stretch": stretch, "within": bubble, "frames": 90, "noise": noise, "seed": seed}
    return simulated(law, **about, stated_time_of_max=0.0)


@pytest.fixture(scope="module")
def answers():
    """By the default family."""
    return dict(zip(SHOTS, infer_many([shot(name) for name in SHOTS], workers=1), strict=True))


@pytest.mark.parametrize("name", SHOTS)
def test_the_default_answer_holds_the_truth_and_its_switches_are_set(answers, name):
    law, stretch, _, truth, on, off = SHOTS[name]
    answer = answers[name]
    assert answer.method == "verified"
    assert answer.checks.verdict in ("ok", "bound")
    viscosity = float(law.parts().viscous.apparent(np.array(1e5)))
    assert holds(answer, 0.98, viscosity=viscosity, stretch=stretch, **truth)
    assert [one for one in on if not answer.switches[one] > 0.5] == []
    assert [one for one in off if not answer.switches[one] < 0.1] == []
    assert answer.diagnostics.effective_sample_size >= 100.0
    assert answer.diagnostics.draws == len(answer.theta) <= answer.diagnostics.simulations


BEYOND = {  # what the emulator was trained for: R_max in m, motion, medium
    "small": (1e-5, "keller-miksis", {}), "large": (3e-3, "keller-miksis", {}), "gilmore": (2e-4, "gilmore", {}),
    "dense": (2e-4, "keller-miksis", {"density": 2500.0}), "hot": (2e-4, "keller-miksis", {"temperature": 340.0}),
    "thin": (2e-4, "keller-miksis", {"pressure": 2e4, "surface_tension": 0.0}),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", BEYOND)
def test_bubbles_beyond_the_training_of_the_emulator_are_answered_with_their_truth(name):
    radius, motion, constants = BEYOND[name]
    medium = Medium(**constants)
    viscosity = 0.025 * medium.pressure * medium.time_scale(radius)
    law, bubble = NeoHookeanKelvinVoigt(0.05 * medium.pressure, viscosity), replace(REAL, motion=motion)
    about = {"max_radius": radius, "stretch": 7.0, "within": bubble, "medium": medium, "seed": 1}
    curve = simulated(law, **about, frames=90, noise=0.008, frame=0.045 * medium.time_scale(radius))
    free = Bubble("kinetic", confinement_inertia="free", confinement_damping="free", motion=motion)
    answer = infer(curve, material="nhkv", medium=medium, bubble=free, trust_input=True)
    assert holds(answer, 0.98, shear_modulus=law.shear_modulus, viscosity=viscosity, stretch=7.0)


@pytest.mark.parametrize(
    ("verb", "shot", "how"),
    [(infer, 2, {}), (fit, 2, {"bubble": "field"}), (infer, 3, {"material": "nhkv", "bubble": Bubble("kinetic")})],
)
def test_a_shipped_example_is_answered_with_its_truth(verb, shot, how):
    rows = rows_of(ROOT / "examples" / "truth.csv")
    truth = next(row for row in rows if (row["set"], row["shot"]) == ("soft_gel", str(shot)))
    answer = verb(cavirheo.read_curves(EXAMPLE)[shot - 1], **how)
    assert answer.checks.verdict == "ok"
    values = {name: float(truth[column]) for name, column in COLUMNS.items()}
    assert holds(answer, 0.98, **values)
    low, high = answer.interval("viscosity")
    assert high < 1.5 * low


def test_of_a_liquid_the_modulus_is_bounded_from_above(answers):
    answer = answers["liquid"]
    assert answer.bound("shear_modulus") == "upper"
    assert answer.interval("shear_modulus")[1] < 5e3  # walls, whose distance is not known, may hide it
    assert answer.bound("viscosity") is None
    low, high = answer.interval("viscosity")
    assert high < 2.0 * low


def test_a_switch_that_is_off_leaves_its_parameters_at_nothing(answers):
    """A liquid has no stiffening, a gel does not thin; the field's bubble has neither damping nor slow vapour."""
    columns = {name: dict(zip(one.names, one.theta.T, strict=True)) for name, one in answers.items()}
    for by_name in columns.values():
        liquid = np.isneginf(by_name["log10_shear_modulus"])
        assert np.all(np.isneginf(by_name["log10_stiffening"][liquid]))
        assert np.all(np.isneginf(by_name["log10_thinning"][~liquid]))
    of_field = columns["field"]["confinement_damping"] == 0.0
    share = answers["field"].weights[of_field].sum()
    assert share == pytest.approx(answers["field"].switches["field_bubble"])
    assert np.all(columns["field"]["accommodation"][of_field] == 1.0)
    assert np.all(np.isfinite(columns["field"]["accommodation"]))


def test_the_first_half_of_the_draws_is_as_all_of_them(answers):
    """Draws come in random order, so that a library that takes the first ones is not misled."""
    for name, answer in answers.items():
        half = len(answer.theta) // 2
        first, second = (replace(answer, theta=answer.theta[part], log_weight=answer.log_weight[part])
                         for part in (slice(half), slice(half, None)))  # fmt: skip
        low, high = np.log(answer.interval("viscosity"))
        means = [np.average(np.log(part.draws("viscosity")), weights=part.weights) for part in (first, second)]
        assert abs(means[0] - means[1]) < 0.35 * (high - low), name


@pytest.mark.slow
def test_an_answer_says_how_a_wrong_scale_would_move_it():
    """Per cent of R_max, against the answer of the curve that is enlarged, under one seed."""
    curve = shot("gel")
    curves = [curve, curve.with_max_radius(1.03 * curve.max_radius)]
    answer, larger = infer_many(curves, material="nhkv", trust_input=True, workers=1)
    found = (np.average(larger.draws("shear_modulus"), weights=larger.weights)
             / np.average(answer.draws("shear_modulus"), weights=answer.weights) - 1.0) / 0.03  # fmt: skip
    assert found > 3.0
    assert 0.4 * found < answer.diagnostics.modulus_over_scale < 2.0 * found


FIELD = {"material": "nhkv", "bubble": "field"}


@pytest.fixture(scope="module")
def plain():
    """The answer to a shot of the field's bubble by its own law, and the number of simulations that it began."""
    began, solve = [], experiment.simulate

    def counted(*given, **how):
        began.append(1)
        return solve(*given, **how)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(experiment, "simulate", counted)
        return infer_many([shot("field")], workers=1, **FIELD)[0], len(began)


def test_every_simulation_is_counted(plain):
    answer, began = plain
    assert answer.diagnostics.simulations == began - 1 > len(answer.theta)  # one is that which is drawn
    assert answer.diagnostics.failed_simulations == 0


def test_an_answer_depends_neither_on_workers_nor_on_the_order_of_the_curves(plain):
    other = shot("field", seed=2)
    found = infer_many([other, shot("field")], workers=2, **FIELD)[1]
    assert same(found.theta, plain[0].theta)
    assert same(found.log_weight, plain[0].log_weight)
    assert found.checks.verdict == plain[0].checks.verdict
    assert found.evidence == plain[0].evidence


def test_which_law_ranks_the_true_law_first(plain):
    (found,), _ = rank_laws([shot("field")], ["newtonian", "nhkv"], bubble="field", workers=1)
    assert (found.chosen, found.contenders) == ("nhkv", ["nhkv"])
    assert found.evidence["nhkv"] == plain[0].evidence  # as `infer` finds it
    assert found.evidence["nhkv"].log > found.evidence["newtonian"].log + 5.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", ["liquid", "stiffening"])
def test_the_evidence_of_the_default_family_is_the_mean_of_that_of_its_laws(name, seed):
    """And the probability of a switch is the share of its laws in it."""
    curve = shot(name, seed=seed)
    whole, *parts = (infer(curve, material=law) for law in (None, "newtonian", "nhkv", "fung + newtonian"))
    logs = np.array([part.evidence.log for part in parts]) + np.log(1.0 / 3.0)
    assert whole.evidence.log == pytest.approx(np.logaddexp.reduce(logs), abs=0.5)
    liquid, _, stiff = np.exp(logs - np.logaddexp.reduce(logs))
    assert whole.switches["liquid"] == pytest.approx(liquid, abs=0.25)
    assert whole.switches["stiffening"] == pytest.approx(stiff, abs=0.25)


def test_a_failed_answer_has_no_draws_and_says_why(monkeypatch):
    def failing(material, *given, **how):
        raise cavirheo.InputError("no such material", "test")

    monkeypatch.setattr(experiment, "simulate", failing)
    found = infer(shot("field"), **FIELD)
    assert found.checks.verdict == "failed"
    assert (len(found.theta), found.evidence, found.best, found.log_weight) == (0, None, {}, None)
    assert found.checks.messages


def test_a_wrong_law_does_not_fit():
    answer = fit(shot("field"), material="newtonian", bubble="field")
    assert answer.checks.verdict == "does_not_fit"
    assert "misfit.systematic" in [one.code for one in answer.checks.messages]
    assert answer.diagnostics.p_value < 0.01
