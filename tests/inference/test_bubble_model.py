"""Contents, damage, walls and vapour in the inference: what was simulated is found again, and says what it is."""

import pytest
from answers import fit, holds, simulated
from conftest import REAL, code_of, slow

from cavirheo import Bubble, NeoHookeanKelvinVoigt, infer
from cavirheo.physics.bubble import ACCOMMODATION, Damage

GEL = NeoHookeanKelvinVoigt(5e3, 0.01)
QUICKLY = dict(trust_input=True, material="nhkv")


def shot(seed=0, noise=0.004, law=GEL, accommodation=ACCOMMODATION, **bubble):
    within = Bubble(accommodation=accommodation, **bubble)
    about = {"stretch": 6.0, "frames": 90, "maximum": (0.0, 250e-6)}
    return simulated(law, seed=seed, noise=noise, within=within, **about)


@pytest.mark.parametrize(
    ("true", "fitted"),
    [
        slow(dict(contents="kinetic"), Bubble("kinetic")),
        slow(dict(confinement_inertia=0.2), Bubble(confinement_inertia="free")),
        slow(dict(confinement_damping=0.3), Bubble(confinement_damping="free")),
        slow(dict(vapour_excess=3e3), Bubble(vapour_excess="free")),
        slow(dict(damage=Damage(0.4, 1.5)), Bubble(damage="strain")),
    ],
    ids=str,
)
def test_a_fit_finds_what_was_simulated(true, fitted):
    answer = fit(shot(noise=0.0004, **true), bubble=fitted, **QUICKLY)
    damage = true.get("damage", Damage(1.0))
    true = {"accommodation": 0.07, "damage_modulus": damage.modulus, "damage_radius": damage.radius, **true}
    found = {name: value for name, value in answer.best.items() if name in answer.parameters and name in true}
    assert len(found) == (1 if damage.modulus == 1.0 else 2)
    assert found == pytest.approx({name: true[name] for name in found}, rel=0.15)
    assert answer.best["shear_modulus"] == pytest.approx(5e3, rel=0.1)
    assert answer.bubble.contents == true.get("contents", "equilibrium")


def test_what_is_given_is_not_inferred():
    answer = fit(shot(contents="kinetic"), bubble=Bubble("kinetic", 0.05, confinement_damping=0.1), **QUICKLY)
    assert not {"accommodation", "confinement_damping"} & set(answer.parameters)
    assert (answer.best["accommodation"], answer.best["confinement_damping"]) == (0.05, 0.1)


def test_a_wall_at_a_distance_adds_the_inertia_of_its_image():
    distant, confined = shot(wall_distance=2e-3), shot(confinement_inertia=250e-6 / 4e-3)
    assert distant.radius == pytest.approx(confined.radius)
    assert distant.radius != pytest.approx(shot().radius, rel=1e-3)


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(bubble=Bubble(accommodation=0.07)), "option.idle"),
        (dict(bubble=Bubble(damage=Damage(0.5))), "option.damage"),
        (dict(material="newtonian", bubble=Bubble(damage="strain")), "physics.damage_without_elasticity"),
        (dict(bubble="dry"), "option.bubble"),
        (dict(bubble=Bubble(wall_distance=200e-6)), "physics.wall_too_near"),
        (dict(bubble=REAL, model="bdt-viscoelastic"), "option.bubble"),
        (dict(material="honey"), "law.not_fittable"),
        (dict(material="newtonian", model="bdt-viscoelastic"), "option.material"),
    ],
)
def test_what_cannot_be_asked_is_refused(way, code):
    for call in (infer, fit) if way.keys() <= {"bubble", "material"} else (infer,):
        assert code_of(call, shot(), **way) == code


@pytest.mark.slow
def test_a_wall_that_is_given_is_in_the_answer():
    """A wall beside the bubble: without it G is wrong."""
    curve = shot(noise=0.01, confinement_inertia=0.25)
    beside = infer(curve, bubble=Bubble(confinement_inertia=0.25), **QUICKLY)
    assert beside.bubble == Bubble(confinement_inertia=0.25)
    assert holds(beside, shear_modulus=5e3, viscosity=0.01)
    assert not holds(infer(curve, bubble="field", **QUICKLY), shear_modulus=5e3)
