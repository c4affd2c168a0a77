"""Reduced sets stay bounded where that is claimed: certificates, bounds on hulls, coordinates, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from set_plants import (
    A62,
    C62,
    D62,
    DV62,
    F62,
    H62,
    H63,
    PRINTED62,
    V62,
    W62,
    admissible_paths,
    luenberger62,
    pole_gains,
    tnl63,
)

from codegen.algebra import error_set, residual_sets, zonotope
from codegen.analysis.set_detectability import futures
from codegen.certify.exact import eye, product, rational
from codegen.certify.order import choose, patterns
from codegen.certify.reduction import box_certificate, every_block, every_sample, holds, largest_hull
from codegen.certify.rows import Generators, Norm, Powers
from codegen.errors import CertificateError


@pytest.fixture(scope="module")
def recursion20():
    return luenberger62(pole_gains(A62, C62, D62, DV62, F62, .5)[0])


@pytest.fixture(scope="module")
def recursion63():
    return tnl63()


def test_rows_are_known_up_to_their_error():
    """Against exact powers, of matrices whose entries' magnitudes grow although they are stable."""
    rng = np.random.default_rng(9)
    for n in (1, 2, 4):
        V = rng.normal(size=(n, n)) + .1 * np.eye(n)
        A = V @ np.diag(rng.uniform(-.97, .97, n)) @ np.linalg.inv(V)
        a, G = rng.normal(size=(3, n)), rng.normal(size=(n, 5))
        norm = Norm(A)
        powers = Powers(A, norm, a, np.zeros(3), 60)
        power, exact = eye(n), rational(A)
        bound = powers.support(Generators.of(G), 60)
        left = norm.columns(Generators.of(G))
        for j in range(60):
            row = product(rational(a), power)
            truth = np.array([float(x) for x in abs(product(row, rational(G))).sum(axis=1)])
            assert np.all(truth <= bound[j]) and np.all(bound[j] <= truth + 1e-9)
            assert np.all(truth <= powers.left(j) * left)
            off = row - rational(powers.rows[j])
            assert np.all([float(x @ norm.S @ x) <= e**2 for x, e in zip(off, powers.error[j])])
            power = product(power, exact)
        with pytest.raises(CertificateError, match="not contracting"):
            Norm(A / max(abs(np.linalg.eigvals(A))))
        with pytest.raises(CertificateError, match="does not hold exactly"):
            Norm(A, 3 * exact)  # the contraction of another matrix


def test_patterns_keep_to_the_dwell_time_and_use_it_up():
    for dwell in (1, 4):
        shortest = 99
        for path in patterns(3, dwell, 60):
            ends = [k for k in range(1, 60) if path[k] != path[k - 1]]
            runs = np.diff([0, *ends])
            assert len(path) == 60 and np.all(runs >= dwell)
            shortest = min([shortest, *runs])
        assert shortest == dwell
        assert any(len(set(path)) == 3 for path in patterns(3, dwell, 60))
    assert patterns(1, 1, 5) == [(0,) * 5]


@pytest.mark.parametrize("longest, dwell", [(1, 1), (1, 3), (3, 1), (3, 4), (2, 6)])
def test_steps_are_all_that_can_happen(longest, dwell):
    """Blocks along every admissible sequence of two modes, against the list."""
    steps = every_block(2, longest, dwell)
    listed = {(steps.states[s], steps.states[t], p) for s, t, p in zip(steps.source, steps.target, steps.powers)}
    seen = set()
    for path in (p for q in (0, 1) for p in futures(2, q, 0, dwell, 13)):
        mode, lasted, j = path[0], 0, 0
        for before, q in zip(path, path[1:]):
            j += 1
            if q != before or j == longest:
                following = (q, 0 if q != before else min(lasted + j, dwell))
                seen.add(((mode, lasted), following, j))
                (mode, lasted), j = following, 0
    assert seen == listed


def test_box_certificate_is_exact_and_bounds_the_hull(recursion20, recursion63):
    rng = np.random.default_rng(5)
    for m, H0 in ((recursion20, H62), (recursion63, H63)):
        for dwell in (1, 6):
            found = box_certificate(m.A, every_sample(3, dwell))
            assert found.theta < 1 and holds(m.A, found)
            largest = largest_hull(m.A, found, m.W, H0)
            for path in admissible_paths(rng, dwell, 6, 40):
                H = H0
                for b, q in zip(residual_sets.befores(m, path), path):
                    assert np.all(zonotope.hull(H) <= largest[q])
                    H = zonotope.add(m.A[q] @ zonotope.reduce(H, 3), m.W[b, q])
        blocks = box_certificate(m.A, every_block(3, 4))
        largest = largest_hull(m.A, blocks, m.W, .01 * H0, extra=np.full(3, .05))
        without = largest_hull(m.A, blocks, m.W, .01 * H0)
        assert np.all(without <= largest) and np.any(without < largest)
        for path in admissible_paths(rng, 1, 6, 40):
            H, j, start = .01 * H0, 0, path[0]
            for b, q in zip(residual_sets.befores(m, path), path):
                if j and (q != start or j == 4):
                    H, j, start = zonotope.reduce(zonotope.add(H, .05 * np.eye(3)), 3), 0, q
                    assert np.all(zonotope.hull(H) <= largest[q])
                H, j = zonotope.add(m.A[q] @ H, m.W[b, q]), j + 1
        assert not holds(m.A * 1.6, found) and not holds(m.A, replace(found, theta=1.0))
        with pytest.raises(CertificateError, match="do not hold"):
            largest_hull(m.A * 1.6, found, m.W, H0)


def test_reduction_of_the_printed_gains_diverges_and_is_seen():
    """Area over the exact one after 60 samples of one mode, l = 5: 3.3, 4.3e4, 7.8e7 in x; cured by coordinates."""
    for q, blow_up in enumerate((3.3, 4.3e4, 7.8e7)):
        m = error_set.luenberger(A62[q:q + 1], C62, PRINTED62[q:q + 1], D62, DV62, W62, V62)
        exact = zonotope.area(residual_sets.zonotopes(m, [0] * 60, H62)[-1])
        reduced = zonotope.area(residual_sets.zonotopes(m, [0] * 60, H62, 5)[-1])
        assert reduced / exact == pytest.approx(blow_up, rel=.02)
        in_x = box_certificate(m.A, every_sample(1))
        assert (in_x is None) == (q > 0)
        choice = choose(m, 5, 1, H62)
        assert choice.proved and holds(m.A, choice.certificate, choice.coordinates) and choice.name != "x"
        better = residual_sets.zonotopes(m, [0] * 60, H62, choice.order, choice.key, choice.coordinates)[-1]
        assert zonotope.area(better) / exact < 3


def test_choice_of_coordinates_and_refusal(recursion20):
    choice = choose(recursion20, 5, 6, H62)
    assert choice.proved and choice.order == 5 and choice.ratio < 1.3
    printed = error_set.luenberger(A62, C62, PRINTED62, D62, DV62, W62, V62)
    with pytest.raises(CertificateError, match=r"mode 2: .* spectral radius of \|Ac\| 1\.287"):
        choose(printed, 5, 1, H62)
    assert box_certificate(printed.A, every_sample(3, 6)) is None
    modal = choose(printed, 5, 6, H62)
    assert modal.proved and modal.name == "modal"
    turning = np.array([[[.7, .7], [-.7, .7]]])  # |A| has radius 1.4 in every basis: its eigenvalues turn by 45 degrees
    m = error_set.ErrorRecursion(turning, np.eye(2)[None], np.ones((2, 1, 2, 1)), np.ones((2, 1, 2, 1)), (1,))
    assert box_certificate(m.A, every_sample(1)) is None
    assert box_certificate(m.A, every_block(1, 8)) is not None  # reduced once per block it contracts
    settled = choose(m, 12, 1, np.eye(2), limit=5.0)
    assert not settled.proved and settled.certificate is None
