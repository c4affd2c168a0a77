"""What of a residual is in its set: exact where that is said, ties and numbers that are none included."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.points import made, point_design, random_plant

from codegen.algebra import zonotope
from codegen.certify import set_claims
from codegen.errors import CertificateError, DesignError
from codegen.observers.zonotope import reduced


def test_membership_is_exact_for_two_outputs():
    """Against the gauge of the same generators: inside and outside alike, but for the room of the rounding."""
    design = made("two outputs")
    t, run = design.observer.tables["float64"], design.observer
    rng = np.random.default_rng(0)
    H = 0.05 * rng.uniform(-1, 1, (200, 3, t.shape.columns))
    q, origin = rng.integers(0, 3, 200), np.zeros(200, dtype=int)
    sets = [np.concatenate([t.C[a] @ h, t.shape.V[a, 0]], axis=1) for a, h in zip(q, H)]
    r, wanted = rng.uniform(-1, 1, (200, 2)), 1 + 1e-9 * rng.choice([-1.0, 1.0], 200)
    r *= (wanted / [zonotope.gauge(G, x) for G, x in zip(sets, r)])[:, None]
    bound, raw = run.judged(t, q, origin, H, r)
    assert (raw.any(axis=1) == (wanted > 1)).all()
    assert raw[:, 2].sum() > raw[:, :2].any(axis=1).sum()  # the set says more than its hull
    np.testing.assert_allclose(bound, [zonotope.hull(G) for G in sets], rtol=1e-9)


@pytest.mark.parametrize("flat", [False, True])
def test_membership_is_exact_for_three_outputs(flat):
    """Against the gauge of the same generators; directions chosen offline miss some of what it finds, and nothing else
    is found that is inside. A set that is flat lets no point out of its plane pass.
    """
    design = made("three outputs")
    run = design.observer
    t = run.tables["float64"]
    rng = np.random.default_rng(0)
    H = 0.05 * rng.uniform(-1, 1, (150, 3, t.shape.columns))
    if flat:  # the noise is not: only where it is left out
        t = replace(t, shape=replace(t.shape, V=t.shape.V * 0, rho=t.shape.rho * 0))
        H[:, :, 2:] = 0.0
    q, origin = rng.integers(0, 2, len(H)), np.zeros(len(H), dtype=int)
    sets = [np.concatenate([t.C[a] @ h, t.shape.V[a, 0]], axis=1) for a, h in zip(q, H)]
    r = np.array([G @ rng.uniform(-1, 1, G.shape[1]) for G in sets])
    wanted = 1 + 1e-9 * rng.choice([-1.0, 1.0], len(H)) * (1 if not flat else 1e4)
    r *= (wanted / [zonotope.gauge(G, x) for G, x in zip(sets, r)])[:, None]
    bound, raw = run.judged(t, q, origin, H, r)
    assert (raw.any(axis=1) == (wanted > 1)).all()
    assert raw[:, 3].sum() > 2 * raw[:, :3].any(axis=1).sum()
    rows = np.concatenate([zonotope.template(G, x[None])[3:] for G, x in zip(sets[:4], r)])
    some = replace(t, shape=replace(t.shape, pairs=False, directions=rows))
    _, less = run.judged(some, q, origin, H, r)
    assert not (less & ~raw).any() and less.any(axis=1).sum() < raw.any(axis=1).sum()
    if flat:
        off = np.array([np.cross(G[:, 0], G[:, 1]) for G in sets])
        off = off * (1e-4 / np.linalg.norm(off, axis=1))[:, None]
        assert run.judged(t, q, origin, H, 0.5 * r + off)[1].any(axis=1).all()


def test_membership_of_three_outputs_is_chosen():
    """Exact where it is cheap enough or asked for; refused for more outputs; products that overflow are refused."""
    plant = random_plant((2, 3, 1, 3), 11, (1, 2))
    assert made("three outputs").observer.tables["float32"].shape.pairs
    few = point_design(plant, "tnl", order=5, membership="directions").observer.tables["float32"].shape
    assert not few.pairs and len(few.directions)
    assert not point_design(plant, "tnl", order=20).observer.tables["float32"].shape.pairs
    assert point_design(plant, "tnl", order=20, membership="exact").observer.tables["float32"].shape.pairs
    with pytest.raises(DesignError, match='membership is "exact" with 4 outputs .found., expected at most 3'):
        point_design(random_plant((2, 4, 2, 4), 3, (1, 4)), order=9, membership="exact")
    design = made("three outputs")
    t, cert = design.observer.tables["float32"], design.certificate["float32"]
    with pytest.raises(CertificateError, match="products of three residuals may overflow"):
        set_claims.check(plant.modes, replace(t, y_hi=t.y_hi * np.float32(1e13)), cert)


def test_reduction_is_the_algebra_s():
    """The same columns as ``algebra.zonotope.reduce``, ties by the lowest index; the compare count is the dossier's."""
    z = made("two outputs").observer.tables["float64"].shape
    rng = np.random.default_rng(1)
    H = rng.integers(-2, 3, (50, 3, z.columns)).astype(float)  # small integers: many ties
    kept, box = reduced(z, H * (1 / np.sqrt(z.weight.astype(float)))[:, None])
    scale = np.sqrt(z.weight.astype(float))
    for i in range(len(H)):
        G = zonotope.reduce(H[i], z.order)
        np.testing.assert_allclose(kept[i] * scale[:, None], G[:, :z.order - 3])
        np.testing.assert_allclose((box[i] - z.e) * scale, np.diag(G[:, z.order - 3:]), atol=1e-9)


def test_nan_alarms():
    """A set spoilt by an upset of the memory starts again; a residual that is no number is outside."""
    design = made("two outputs")
    t, run = design.observer.tables["float32"], design.observer
    run.start(t, 1)
    _, raw = run.judged(t, np.zeros(1, int), np.zeros(1, int), run.set, np.full((1, 2), np.nan, np.float32))
    assert raw.all()
    run.phase[:], run.guard.mode[:] = 2, 0
    run.set = np.full_like(run.set, np.nan)
    out = run.empty(t, (1,))
    run.sample(t, np.array([True]), np.array([True]), np.zeros((1, 1), np.float32), np.zeros((1, 2), np.float32),
               np.zeros(1, int), None, out)
    assert np.isfinite(out.r_bound).all() and not out.alarm.any()
