"""Boxes of a reduced zonotope in other coordinates: chosen where those of x diverge, proved, else refused."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scripts import GENERATED
from set_plants import PRINTED62

from codegen.certify import set_claims, set_freeze
from codegen.certify.exact import rational
from codegen.certify.sets import SetDemands, ZonotopeDemands
from codegen.certify.settled import Boxes
from codegen.designs import read_design
from codegen.errors import CertificateError, DesignError
from codegen.observers import Supervision, ZonotopeObserver
from codegen.plant.load import load
from codegen.selection.point_sets import draft, reductions, sized
from codegen.selection.points import certified
from codegen.selection.set_simulation import settled, simulated

ORDER = {"order": 5}


def printed(modes):
    """The plant of section 6.2.4 in some of its modes, with the printed gains."""
    plant = load("zammali_zonotope")
    plant = replace(plant, modes=tuple(plant.modes[q] for q in modes), scenarios=())
    L = PRINTED62[list(modes)]
    return plant, {"L": L, "N": np.zeros_like(L), "kind": "luenberger"}


def made(modes, dwell, real="float32"):
    plant, gains = printed(modes)
    gains |= sized(plant, gains, ORDER, dwell)
    return plant, gains, *certified(plant, gains, {"kind": "none"}, real)


@pytest.fixture(scope="module")
def slow():
    return made((0, 1, 2), 6)


@pytest.mark.parametrize("modes,dwell,words", [((2,), 1, "for arbitrary switching"),
                                               ((0, 1, 2), 6, "while every mode lasts at least 6 samples")])
def test_other_coordinates_are_chosen_where_those_of_x_diverge(modes, dwell, words, slow):
    plant, gains, t, cert = slow if dwell > 1 else made(modes, dwell)
    z = t.shape
    assert z.oblique and z.order == 5 and gains["reduction"]["coordinates"] is not None
    claims = set_claims.check(plant.modes, t, cert)
    assert any("Ultimate width" in claim and words in claim for claim in claims)
    half = (plant.x0_hi - plant.x0_lo) / 2
    paths = np.array([np.resize(np.repeat(range(len(modes)), dwell), 120)])
    widths = simulated(t, half, paths, ZonotopeObserver)[:, 0]
    assert np.all(widths[-30:] <= np.array(cert["steady_box"]["width"]) / 2)
    x = draft(plant, gains, 5, 1e9 * np.ones(3), "float64", np.zeros((0, 2)))
    in_x = simulated(x, half, paths, ZonotopeObserver)
    assert settled(in_x) is None or np.max(in_x[-1] / widths[-1]) > 5


def test_the_step_holds_the_set_exactly(slow):
    """In rationals: every point of the set before the reduction is, moved, in the set after it with its rounding."""
    plant, _, t, _ = slow
    z, run, rng = t.shape, ZonotopeObserver({t.real: t}, Supervision()), np.random.default_rng(0)
    H = (rng.uniform(-1, 1, (1, 3, z.columns)) * rng.uniform(0, 0.02, z.columns)).astype(t.dtype)
    for p in range(3):
        at = np.array([p])
        after = rational(run.moved(t, at, at, np.zeros(1, int), H, True)[0])
        D = rational(np.concatenate([np.eye(3), rng.normal(size=(20, 3))]))
        before = abs(D @ rational(t.M[p]) @ rational(H[0])).sum(axis=1) + abs(D @ rational(z.F[p, 0])).sum(axis=1)
        spared = abs(D) @ rational(z.e) - abs(D @ rational(t.M[p])) @ rational(z.e)
        assert np.all(before <= abs(D @ after).sum(axis=1) + abs(spared))
        assert np.all(abs(D @ rational(t.M[p])) @ rational(z.e) <= abs(D @ after).sum(axis=1))


@pytest.mark.parametrize("name,change,message", [
    ("inside", lambda x: x * np.float32(0.5), "inside.*, the box of rounding in the coordinates of boxes"),
    ("S", lambda x: x * np.float32(1.0001), "the box of rounding beside the error set"),
    ("B", lambda x: x[:2], "coordinates of boxes are not given for every mode")])
def test_tampered_tables_are_refused(name, change, message, slow):
    plant, _, t, cert = slow
    bad = replace(t, shape=replace(t.shape, **{name: change(getattr(t.shape, name))}))
    with pytest.raises(CertificateError, match=message):
        set_claims.check(plant.modes, bad, cert)


def test_boxes_that_are_not_kept_are_refused(slow):
    plant, _, t, cert = slow
    box = cert["steady_box"]
    for smaller in ({"boxes": {"dwell": 6, "half": (0.99 * np.array(cert["boxes"]["half"])).tolist()}},
                    {"steady_box": box | {"half": (0.9 * np.array(box["half"])).tolist()}}):
        with pytest.raises(CertificateError, match="the hull of the error set leaves its box in mode"):
            set_claims.check(plant.modes, t, cert | smaller)


def test_boxes_leave_room_for_sums_that_are_rounded_up(slow):
    """Boxes found as if the sum of a box were never above its exact value do not hold."""
    plant, _, t, cert = slow
    demands = ZonotopeDemands(SetDemands(plant.modes, t), t.shape)
    every, tight = Boxes(t, demands, 6), Boxes(t, demands, 6)
    assert every.broken(np.array(cert["boxes"]["half"])) is None
    for (p, q), added in tight.added.items():
        slip = demands.inside()[p] - (abs(rational(t.shape.B[p])) @ demands.e)
        tight.added[p, q] = added - tight.maps[p, q] @ slip
    half = tight.found()
    assert tight.broken(half) is None and every.broken(half) is not None


def test_a_hull_near_its_limit_has_room_for_sums_that_are_rounded_up():
    """Where the hull is as large as the limit allows, the rounding of products at the limit no longer covers that."""
    design = read_design(GENERATED[0].parent / "zammali_zonotope_zonotope")
    t = design.observer.tables["float32"]
    half = np.array(design.certificate["float32"]["steady_box"]["half"])
    near = replace(t, limit=(1.01 * half).astype(np.float32))
    demands = ZonotopeDemands(SetDemands(design.plant.modes, near), near.shape)
    found = set_freeze.steady_hull(near, demands)
    assert not demands.steady(found)
    assert np.all(found < 1.0001 * half) and demands.steady(found * (1 - 2e-5))
    demands.chain = lambda magnitude: magnitude * 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(set_freeze, "UNIT", {"float32": 0.0})
        loose = set_freeze.steady_hull(near, demands)
    assert ZonotopeDemands(SetDemands(design.plant.modes, near), near.shape).steady(loose)


def test_where_nothing_is_proved_a_small_order_is_refused():
    """0.85 times a rotation: |A| has a radius above 1 in every basis. A larger order settles, without a proof."""
    plant, gains = printed((0,))
    a, b = np.cos(1.2), np.sin(1.2)
    c, d, e = (1 + 2 * a) / 3, (1 - a) / 3 - b / np.sqrt(3), (1 - a) / 3 + b / np.sqrt(3)
    turning = .85 * np.array([[c, d, e], [e, c, d], [d, e, c]])
    plant = replace(plant, modes=(replace(plant.modes[0], A=turning),))
    gains = gains | {"L": np.zeros((1, 3, 2))}
    assert not any(proved for _, proved in reductions(turning[None], 1))
    words = r'mode "1" has spectral radius 1\.\d+ of .A - L C.; in 6 coordinates and keys no set is proved to settle'
    with pytest.raises(DesignError, match=words):
        sized(plant, gains, {"order": 4}, 1)
    gains |= sized(plant, gains, {"order": 24}, 1)
    assert gains["reduction"]["coordinates"] is None
    t, cert = certified(plant, gains, {"kind": "none"}, "float32")
    assert cert["steady_box"] is None and not any("Ultimate" in c for c in set_claims.check(plant.modes, t, cert))
