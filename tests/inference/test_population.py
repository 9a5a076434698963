"""The material of many shots: against closed forms and grids, with planted outliers, copies and wrong priors."""

from dataclasses import replace

import numpy as np
import pytest
from answers import (
    CENTRE,
    FLAT,
    NAMES,
    answer,
    bubble,
    document_of,
    seen,
    shots,
    unanswered,
    with_evidence,
    with_verdict,
)
from conftest import FIELD, REAL, code_of, slow
from scipy.stats import norm

from cavirheo import CommonErrors, Posterior, population
from cavirheo.inference.assumptions import Family
from cavirheo.inference.population.hierarchy import OUTLIER_STD, P_OUTLIER, SPREAD_SCALE
from cavirheo.inference.population.material import widened_limit
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.collapse import analytic_time

EXACT = CommonErrors(0.0, 0.0, 0.0, 0.0)


def on_a_grid(means, width):
    """(5 %, 50 %, 95 %) of centre and spread of one parameter."""
    c, s = np.linspace(-2.2, -0.6, 801)[:, None, None], np.linspace(0.0, 1.2, 481)[None, :, None]

    def log_p(spread):
        inside = norm.pdf(means, c, np.hypot(width, spread))
        outside = norm.pdf(means, c, np.sqrt(width**2 + spread**2 + OUTLIER_STD**2))
        return np.sum(np.log((1.0 - P_OUTLIER) * inside + P_OUTLIER * outside), axis=-1)

    def ends(density, values):
        share = np.cumsum(density)
        return np.interp([0.05, 0.5, 0.95], share / share[-1], values + 0.5 * (values[1] - values[0]))

    height = log_p(s) + norm.logpdf(s[..., 0], 0.0, SPREAD_SCALE) + np.log(2.0)
    p = np.exp(height - height.max())
    p[:, 0] *= 0.5  # trapezia
    return ends(p.sum(axis=1), c.ravel()), ends(p.sum(axis=0), s.ravel())


@pytest.mark.parametrize("scatter", [0.02, 0.15])
def test_one_parameter_is_as_on_a_grid(scatter):
    width = 0.04
    means = -1.4 + scatter * np.array([-1.2, -0.8, 0.1, 0.3, 0.6, 1.4, -0.2])
    found = population([seen([m], width, seed=k, names=NAMES[1:]) for k, m in enumerate(means)])
    centre, spread = on_a_grid(means, width)
    low, high = found.interval("viscosity")
    for got, expected in zip(np.log10([low, found.median("viscosity"), high]), centre, strict=True):
        assert abs(got - expected) < 0.05 * (centre[2] - centre[0])
    assert np.allclose(found.scatter("viscosity"), spread, atol=0.06 * spread[2])
    assert found.agree == (scatter < width)


def test_an_outlier_is_named_and_moves_little():
    clean, spoilt = population(shots(8)), population(shots(8, away=[2]), names=list("abcdefgh"))
    assert (list(spoilt.outliers), clean.outliers) == (["c"], {})
    assert len(spoilt.shots) == 8
    for name in ("shear_modulus", "viscosity"):
        assert abs(np.log10(spoilt.median(name) / clean.median(name))) < 0.04


def test_a_prior_that_is_not_divided_out_is_seen():
    """A prior of the shots that pulls each towards 1 kPa: all of them together must not be pulled."""
    made = {NAMES[0]: (1.0, 7.0, 3.0, 0.2), NAMES[1]: FLAT[NAMES[1]]}
    width, pull = 0.2, 0.5  # as wide as the prior: posteriors are half way, and narrower by sqrt 2
    rng, posteriors = np.random.default_rng(2), []
    for k, at in enumerate(CENTRE + width * rng.standard_normal((12, 2))):
        mean = np.array([pull * 3.0 + (1.0 - pull) * at[0], at[1]])
        posteriors.append(seen(mean, [width * np.sqrt(0.5), width], 2000, seed=k, prior=made))
    found = population(posteriors)
    forgotten = population([replace(one, prior={}) for one in posteriors])
    low, high = found.interval("G")
    assert low < 10.0 ** CENTRE[0] < high
    assert forgotten.interval("G")[1] < low
    assert found.median("G") / forgotten.median("G") > 2.0


def test_what_does_not_count_is_counted():
    good, point = shots(4), seen(CENTRE, 0.05, 600)
    others = [
        replace(point, theta=point.theta[:1]),
        unanswered(),
        with_verdict(point, "does_not_fit"),
        seen(CENTRE[1:], 0.05, names=NAMES[1:]),
        good[0],
    ]
    found = population([*good, *others])
    assert found.shots == ("shot 1", "shot 2", "shot 3", "shot 4")
    assert found.left_out == dict.fromkeys(("no_interval", "failed", "does_not_fit", "other_model", "copy"), 1)
    assert len(population(good + others[2:3], only_trusted=False).shots) == 5
    assert population(shots(2)).warnings  # they are no population


def test_two_materials_are_told_apart_and_one_is_not():
    soft, same = population(shots(10, seed=1)), population(shots(10, seed=5), seed=1)
    stiff = population(shots(10, seed=3, centre=CENTRE + np.array([0.3, 0.0])), seed=2)
    ratio, higher = stiff.against(soft)["shear_modulus"]
    assert ratio.q05 < 2.0 < ratio.q95
    assert higher > 0.99
    assert soft.against(stiff)["shear_modulus"][0].median == pytest.approx(1.0 / ratio.median)
    ratio, _ = same.against(soft)["viscosity"]
    assert ratio.q05 < 1.0 < ratio.q95


def one_sided(n, viscosity, error, *, seed=0, spread=0.05, tilt=0.0) -> tuple[list[Posterior], np.ndarray]:
    """Shots of 6.3 kPa whose mu is measured with a normal `error` (n,) in Pa s, so that some are only bounded, and the
    measured mu (n,), Pa s. log10 of G is traded for mu by `tilt` decades per Pa s."""
    rng, logs = np.random.default_rng(seed), np.linspace(-4.0, 1.0, 5001)
    answers, measured = [], []
    for deviation in np.broadcast_to(error, n):
        modulus = CENTRE[0] + spread * rng.standard_normal() + 0.05 * rng.standard_normal()
        measured.append(viscosity + deviation * rng.standard_normal())
        share = np.cumsum(np.exp(-0.5 * ((10.0**logs - measured[-1]) / deviation) ** 2))
        mu = np.interp(rng.uniform(size=1000), share / share[-1], logs)
        theta = np.column_stack([modulus + tilt * (viscosity - 10.0**mu) + 0.05 * rng.standard_normal(1000), mu])
        one = replace(seen(CENTRE, 0.05), theta=theta)
        answers.append(with_verdict(one, "bound" if one.bound("viscosity") else "ok"))
    return answers, np.array(measured)


def test_shots_that_only_bound_a_parameter_tell_the_others_as_well():
    """Gels whose mu is too small for their recordings: G as of gels whose mu is known, and of mu a bound."""
    bounded, _ = one_sided(12, 1e-5, 0.01, tilt=3.0)
    known, _ = one_sided(12, 0.03, 0.002, tilt=3.0)
    assert [one.bound("viscosity") for one in bounded].count("upper") >= 10
    found, clear = population(bounded), population(known)
    assert len(found.shots) == 12
    low, high = np.log10(found.interval("shear_modulus"))
    assert low < CENTRE[0] < high
    ends = np.log10(clear.interval("shear_modulus"))
    assert high - low < 1.1 * np.ptp(ends)
    assert clear.bound("viscosity") is None
    assert found.bound("viscosity") == found.quantity("viscosity").bound == "upper"
    assert found.interval("viscosity")[1] < np.median([one.interval("viscosity")[1] for one in bounded])
    assert found.determined == ["shear_modulus"]
    assert list(found.against(clear)) == ["shear_modulus"]


@pytest.mark.parametrize(
    ("viscosity", "error"), [(1e-5, 0.01), slow(1e-3, 0.005), slow(0.012, 0.01), (0.01, [0.002, 0.02] * 6)]
)
def test_bounds_multiply_as_on_a_grid(viscosity, error):
    """The product of the likelihoods of the shots, which are known in closed form, each widened by the spread."""
    answers, measured = one_sided(12, viscosity, error, spread=0.0)
    logs, places = np.linspace(-4.0, 1.0, 251), np.linspace(-8.0, 3.0, 1101)
    one = np.exp(-0.5 * ((10.0 ** places[:, None] - measured) / np.broadcast_to(error, 12)) ** 2)
    density = np.zeros(len(logs))
    for spread in np.linspace(0.02, 1.0, 50):
        widths = (spread, np.hypot(spread, OUTLIER_STD))
        inside, outside = (norm.pdf(places, logs[:, None], width) @ one for width in widths)
        mixed = (1.0 - P_OUTLIER) * inside + P_OUTLIER * outside
        density += np.prod(mixed, axis=1) * norm.pdf(spread, 0.0, SPREAD_SCALE)
    exact = np.interp([0.5, 0.95], np.cumsum(density) / np.sum(density), logs)
    found = np.quantile(np.log10(population(answers).draws("viscosity")), [0.5, 0.95])
    assert np.all(np.abs(found - exact) < [0.25, 0.12])


@pytest.mark.parametrize("least", [-4.0, -7.0])
def test_an_upper_bound_hangs_neither_on_the_end_of_the_range_nor_on_the_probability_of_zero(least):
    """Of the likelihood exp(-G/a) it is a ln 20, wherever the range of log10 G begins, and if G may be 0."""
    modulus = np.log10(2e3)
    places = np.linspace(least, 7.0, 20000)
    theta = np.column_stack([np.append(places, -np.inf), np.full(20001, -2.0)])
    log_weight = np.append(-(10.0 ** (places - modulus)), 7.0)
    prior = {"log10_shear_modulus": (least, 7.0)}
    answer = replace(seen(CENTRE, 0.05), theta=theta, log_weight=log_weight, prior=prior)
    assert answer.bound("G") == "upper"
    assert answer.interval("G")[1] == pytest.approx(2e3 * np.log(20.0), rel=0.01)


def test_a_value_that_a_single_shot_gives_is_not_that_of_the_material():
    """Of ten shots nine only bound mu: so does the material, and it is no value with an interval."""
    answers, _ = one_sided(10, 0.01, [0.0005] + [0.02] * 9, seed=2)
    first, *others = (one.bound("viscosity") for one in answers)
    assert (first, others.count("upper") >= 8) == (None, True)
    found = population(answers)
    assert found.bound("viscosity") == "upper"
    assert population(one_sided(5, 0.01, [0.001] * 2 + [0.02] * 3, seed=1)[0]).bound("shear_modulus") is None


@pytest.mark.parametrize(
    ("answers", "how", "code"),
    [
        ([], {}, "none"),
        (shots(2), {}, "no_draws"),
        (shots(3), {"names": ["a"]}, "names"),
    ],
)
def test_what_cannot_be_is_refused(answers, how, code):
    assert code_of(lambda: population(answers, **how).interval("shear_modulus")) == f"population.{code}"


def test_groups_of_a_document_are_told_apart():
    pairs = []
    for name, centre, seed in (("soft", CENTRE, 1), ("stiff", CENTRE + np.array([0.4, 0.0]), 2)):
        for k, one in enumerate(shots(6, seed=seed, centre=centre)):
            curve = bubble(f"{name}[{k + 1}]", name)
            pairs.append((curve, with_evidence(replace(one, checks=answer(curve).checks, stretch=8.0), 10.0)))
    assert not document_of(pairs[:1]).groups[0].population.has_material  # a single shot
    document = document_of(pairs)
    apart = {one.parameter: one for one in document.differences}["shear_modulus"]
    assert (apart.first, apart.second) == ("stiff", "soft")
    assert apart.probability_higher > 0.99


def switched(seed, liquid=0.0, stiffening=0.0, field=0.0, *, thins=0.0, mu=0.03, draws=400) -> Posterior:
    """Draws by the default family: these shares are of a liquid, of a gel that stiffens, of the field's bubble; and
    `thins` of those of the liquid, with an exponent of 0.7. A liquid's viscosity is twice that of the gel, so that the
    two heaps lie apart."""
    rng = np.random.default_rng(seed)
    of_liquid, stiff, of_field = (np.arange(draws) < round(share * draws) for share in (liquid, stiffening, field))
    modulus, alpha = 3.8 + 0.05 * rng.standard_normal(draws), -1.0 + 0.05 * rng.standard_normal(draws)
    modulus[of_liquid] = alpha[of_liquid] = -np.inf
    stiff = stiff[::-1] & ~of_liquid
    alpha[~stiff] = -np.inf
    viscosity = np.log10(mu) + 0.05 * rng.standard_normal(draws) + np.log10(2.0) * of_liquid
    damping = np.where(rng.permutation(of_field), 0.0, 0.2)
    thinning = np.log10(0.3) + 0.02 * rng.standard_normal(draws)
    thinning[np.arange(draws) >= round(thins * liquid * draws)] = -np.inf
    names = (*(f"log10_{name}" for name in Family("auto").parameters), "confinement_damping")
    order = rng.permutation(draws)
    theta = np.column_stack([modulus, alpha, viscosity, thinning, damping])[order]
    flat = {f"log10_{name}": PARAMETERS[name].search_range for name in ("stiffening", "thinning")} | FLAT
    found = {"liquid": liquid, "stiffening": stiffening, "thinning": thins * liquid, "field_bubble": field}
    about = {"prior": flat, "switches": found, "bubble": REAL, "log_weight": np.zeros(draws), "material": "auto"}
    return replace(seen(CENTRE, 0.05), names=names, units=("Pa", "1", "Pa s", "1", "1"), theta=theta, **about)


GROUPS = {  # switches of the shots, and law, viscosity and bubble of the material
    "nearly all say liquid": ([dict(liquid=0.99)] * 4 + [dict(liquid=0.2)], "newtonian", 0.06, REAL),
    "each is unsure, all are not": ([dict(liquid=0.2)] * 6, "nhkv", 0.03, REAL),
    "a shot without a liquid outvotes": ([dict(liquid=0.8)] * 2 + [dict()] * 2, "nhkv", 0.03, REAL),
    "stiffening": ([dict(stiffening=0.8)] * 4, "fung + newtonian", 0.03, REAL),
    "thinning": ([dict(liquid=0.9, thins=0.8)] * 4, "power-law", 0.06, REAL),
    "each is unsure of the field's bubble": ([dict(field=0.4)] * 6, "nhkv", 0.03, FIELD),
    "the field's bubble": ([dict(field=0.9)] * 4 + [dict(field=0.3)], "nhkv", 0.03, FIELD),
}


@pytest.mark.parametrize("name", GROUPS)
def test_shots_of_one_material_share_its_switches(name):
    """Two heaps of draws, of a liquid and of a gel: the material has those of one of them alone."""
    shares, law, viscosity, bubble_model = GROUPS[name]
    found = population([switched(k, **share) for k, share in enumerate(shares)])
    assert (found.material, found.bubble) == (law, bubble_model)
    assert found.median("viscosity") == pytest.approx(viscosity, rel=0.06)
    assert ("shear_modulus" in found.determined) == (law not in ("newtonian", "power-law"))
    assert ("stiffening" in found.determined) == (law == "fung + newtonian")
    assert "exponent" not in found.names or found.median("exponent") == pytest.approx(0.7, abs=0.02)
    low, high = found.interval("viscosity")
    assert low < viscosity < high < 1.5 * low


def test_a_liquid_that_may_thin_and_may_not_has_the_viscosity_of_both():
    """Draws that thin have twice the viscosity of the others."""
    answers = [switched(k, liquid=0.9, thins=0.5) for k in range(3)]
    for k, one in enumerate(answers):
        thins = np.isfinite(one.theta[:, 3])
        one.theta[thins, 2] += np.log10(2.0)
        one.theta[thins, 3] = np.random.default_rng(k).uniform(-1.0, -0.1, np.count_nonzero(thins))
    found = population(answers)
    assert (found.material, found.names) == ("newtonian", ("viscosity",))
    assert 0.2 < found.switches["thinning"] < 0.8
    low, high = found.interval("viscosity")
    assert low < 0.063 < 0.11 < high
    assert "1e5/s" in found.line


def test_a_doubtful_shot_has_no_vote_in_the_switches():
    liquids, gel = [switched(k, liquid=0.95) for k in range(3)], switched(9)
    assert population([*liquids, with_verdict(gel, "does_not_fit")]).material == "newtonian"
    assert population([*(switched(k, field=1.0) for k in range(4)), gel]).left_out == {"other_switches": 1}
    real = [replace(one, switches={"field_bubble": 0.2}) for one in shots(4)]  # another law: that of its bubble alone
    assert (population(real).material, len(population(real).shots)) == ("nhkv", 4)


@pytest.mark.parametrize(
    ("change", "factor", "of_viscosity"),
    [("scale", 1.0, 0.0), ("rate", 1.0, -1.0), ("density", 0.5, 0.0), ("pressure", -0.5, 1.0)],
)
def test_errors_that_all_shots_share_are_in_the_interval(change, factor, of_viscosity):
    """ln G changes by 20 times that of the scale: shots alone give 3 %, and an error of 1 % of the scale 20 %. The
    viscosity hardly changes with the scale, but with the units of stress and time."""
    rng, answers = np.random.default_rng(3), []
    for k in range(8):
        scale = 1.0 + 0.005 * rng.standard_normal(2000)
        made = seen([CENTRE[0] + 0.02 * rng.standard_normal(), CENTRE[1]], 0.03, draws=2000, seed=k)
        modulus = made.theta[:, 0] + 20.0 * np.log10(scale)
        theta = np.column_stack([modulus, made.theta[:, 1], scale])
        answers.append(replace(made, names=(*made.names, "radius_scale"), units=(*made.units, "1"), theta=theta))
    none = dict.fromkeys(("scale", "rate", "density", "pressure"), 0.0)
    size = 0.01
    found = population(answers, errors=CommonErrors(**none | {change: size}))
    alone = population(answers, errors=CommonErrors(**none))
    assert found.over_scale["shear_modulus"] == pytest.approx(20.0, rel=0.15)
    assert found.statistical_interval("shear_modulus") == alone.statistical_interval("shear_modulus")
    slope = 20.0 * factor + (1.0 if change == "pressure" else 0.0)
    wide, narrow = (np.std(one.centre[:, 0]) * np.log(10.0) for one in (found, alone))
    assert np.sqrt(wide**2 - narrow**2) == pytest.approx(size * abs(slope), rel=0.2)
    moved = np.std(found.centre[:, 1] - found.statistical[:, 1]) * np.log(10.0)
    assert moved == pytest.approx(size * abs(factor * found.over_scale["viscosity"] + of_viscosity), rel=0.1)


def test_two_materials_in_one_group_are_two_heaps_and_one_that_scatters_is_none():
    low = shots(3, 0.02, 0.03, seed=2)
    high = shots(3, 0.02, 0.03, seed=3, centre=np.asarray(CENTRE) + 0.8)
    found = population([*low, *high], names=[*"abcdef"])
    first, second = found.heaps["shear_modulus"]
    assert (first.shots, second.shots) == (("a", "b", "c"), ("d", "e", "f"))
    value = found.quantity("shear_modulus")
    assert (value.median, value.bound) == (None, "wide")
    assert value.q05 < 10.0 ** CENTRE[0] < 10.0 ** (CENTRE[0] + 0.8) < value.q95
    assert [population(shots(6, 0.08, 0.03, seed=seed)).heaps for seed in range(4)] == [{}] * 4
    ladder = [seen(CENTRE + 0.4 * step, 0.03, seed=step) for step in range(6)]  # evenly apart: no two materials
    assert population(ladder).heaps == {}
    outlier = population(shots(8, 0.05, 0.03, away=(2,)))
    assert outlier.heaps == {}  # one shot is no heap


def soft(seed, liquid, top) -> Posterior:
    """A shot that tells of G only that it is below 10^top Pa, and nothing of a liquid's thinning: the draws of a gel
    are flat from 100 Pa up to there."""
    one = switched(seed, liquid=liquid, stiffening=0.5 * (1.0 - liquid), thins=0.5, draws=140)
    theta, rng = one.theta.copy(), np.random.default_rng(seed)
    gel, thins = np.isfinite(theta[:, 0]), np.isfinite(theta[:, 3])
    theta[gel, 0] = rng.uniform(2.0, top, np.count_nonzero(gel))
    theta[thins, 3] = rng.uniform(*one.prior["log10_thinning"], np.count_nonzero(thins))
    return replace(one, theta=theta, prior=one.prior | {NAMES[0]: (2.0, 7.0)})


def test_many_soft_gels_are_not_surely_a_liquid_and_their_modulus_is_bounded():
    """Each shot holds a fifth of the prior of G, and says liquid with 5 : 1 of evidence; so do ten of one modulus."""
    answers = [soft(k, 5.0 / 7.0, 3.0) for k in range(10)]
    exact, usual = (population(answers, errors=errors) for errors in (EXACT, None))
    assert 0.5 < exact.switches["liquid"] < 0.95
    value = exact.quantity("G")
    assert (value.median, value.bound, value.q05, np.isnan(exact.median("G"))) == (None, "upper", 0.0, True)
    assert 300.0 < value.q95 < 2000.0
    assert exact.interval("G") == (0.0, value.q95)
    hidden = widened_limit(0.0, CommonErrors(), 101325.0, 7.0)
    assert usual.quantity("G").q95 == pytest.approx(np.hypot(value.q95, hidden), rel=0.1)


def test_a_liquid_is_one_only_as_far_as_scale_and_rate_are_right():
    """A gel of the limit collapses when a liquid does whose R_max is wrong by 1.64 standard deviations."""
    answers = [soft(k, 0.99, 3.0) for k in range(10)]
    assert population(answers, errors=EXACT).modulus_limit is None
    limit = population(answers, errors=replace(EXACT, scale=0.01)).modulus_limit
    gel, liquid = analytic_time(200e-6, 7.0, limit, 1e-3), analytic_time(200e-6 / 1.0164, 7.0, 0.0, 1e-3)
    assert gel == pytest.approx(liquid, rel=1.6e-3)  # a tenth of the error
    usual = population(answers)
    assert usual.modulus_limit > limit
    assert usual.line.startswith("G below")
