"""Forms of a pencil, put back into their equations; its expansion; published pencils."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.pencils import A26, A43, CHAPTER_4, random_pencil  # noqa: E402

from codegen.algebra.balance import balanced  # noqa: E402
from codegen.algebra.pencil import (  # noqa: E402
    finite_eigenvalues,
    is_regular,
    kernel,
    laurent,
    rank,
    regular_shift,
    svd_form,
    weierstrass,
)

SEEDS = range(40)


def slow(form, E, A):
    """Residuals of P E Q = diag(I, N), P A Q = diag(A1, I)."""
    n1 = len(form.A1)
    left, right = np.eye(len(E)), np.eye(len(E))
    left[n1:, n1:], right[:n1, :n1] = form.N, form.A1
    return np.abs(form.P @ E @ form.Q - left).max(), np.abs(form.P @ A @ form.Q - right).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_weierstrass_form_is_equivalent_and_nilpotent(seed):
    made = random_pencil(seed)
    form = weierstrass(made.E, made.A)
    assert (len(form.A1), form.index) == (made.n1, made.index)
    assert max(slow(form, made.E, made.A)) < 1e-8
    if form.index:
        assert np.allclose(np.linalg.matrix_power(form.N, form.index), 0, atol=1e-8)
        assert form.index == 1 or not np.allclose(np.linalg.matrix_power(form.N, form.index - 1), 0, atol=1e-3)
    values = finite_eigenvalues(made.E, made.A)
    # Double eigenvalues are there to half the digits; their polynomial is to all of them.
    for s in (1.5, -2.5, 3j):
        assert np.prod(s - values) == pytest.approx(np.linalg.det(s * np.eye(made.n1) - made.A1), rel=1e-6)


def test_a_wrong_form_is_seen():
    made = random_pencil(3)
    assert made.n1 and made.index > 1
    form = weierstrass(made.E, made.A)
    for name in ("P", "Q", "A1", "N"):
        changed = {k: getattr(form, k) for k in ("P", "Q", "A1", "N", "index")}
        changed[name] = changed[name] * 1.001 + 1e-3
        assert max(slow(type(form)(**changed), made.E, made.A)) > 1e-5, name


@pytest.mark.parametrize("seed", SEEDS)
def test_svd_form_is_equivalent(seed):
    made = random_pencil(seed)
    form = svd_form(made.E, made.A)
    n = len(made.E)
    assert form.r == np.linalg.matrix_rank(made.E)
    assert np.allclose(form.P @ made.E @ form.Q, np.diag([1.0] * form.r + [0.0] * (n - form.r)), atol=1e-9)
    assert np.allclose(form.P @ made.A @ form.Q, np.block([[form.A11, form.A12], [form.A21, form.A22]]), atol=1e-9)
    assert np.allclose(form.Q @ form.Q.T, np.eye(n))
    assert (rank(form.A22, 1.0) == n - form.r) == (made.index <= 1)


@pytest.mark.parametrize("seed", SEEDS)
def test_laurent_coefficients_are_those_of_the_inverse(seed):
    """Phi_k E - Phi_(k-1) A = I for k = 0, else 0; the sum is the inverse; no coefficient below minus the index."""
    made = random_pencil(seed)
    n = len(made.E)
    phi = laurent(made.E, made.A, -n - 1, 40)
    for k in range(-n, 9):
        expected = np.eye(n) if k == 0 else np.zeros((n, n))
        assert np.allclose(phi[k] @ made.E - phi[k - 1] @ made.A, expected, atol=1e-7), k
        assert np.allclose(made.E @ phi[k] - made.A @ phi[k - 1], expected, atol=1e-7), k
    assert all(np.allclose(phi[k], 0) for k in range(-n - 1, -made.index))
    s = 8.0 + 1j
    assert np.allclose(sum(p * s ** (-k - 1) for k, p in phi.items()), np.linalg.inv(s * made.E - made.A), rtol=1e-5,
                       atol=1e-7)
    shifted = {k + 1: p for k, p in phi.items()}  # the powers as the thesis prints them
    assert n == 0 or not np.allclose(sum(p * s ** (-k - 1) for k, p in shifted.items()),
                                     np.linalg.inv(s * made.E - made.A), rtol=1e-3)


def test_units_do_not_change_the_form():
    """Seconds or days, newton or kilonewton: the same structure, the eigenvalues in proportion."""
    E, A = np.diag([1.0, 1, 1, 0]), np.array([[-0.02, 0, 0, 0.05], [0, -1, 0, -0.4], [0, 0, -3, 0.2], [0, 7.0, 0, -1]])
    before = np.sort_complex(finite_eigenvalues(E, A))
    rows, columns, day = np.diag([1 / 86400, 1 / 86400, 1 / 86400, 1e4]), np.diag([1, 1e-3, 1e3, 1]), 86400
    after = np.sort_complex(finite_eigenvalues(E @ columns, rows @ A @ columns))
    assert len(before) == 3 and np.allclose(after * day, before, rtol=1e-6)
    scale = balanced(E @ columns, rows @ A @ columns)
    sizes = sum(np.sum(M**2, axis=1) for M in scale.apply(E @ columns, rows @ A @ columns))
    assert sizes.min() > 0.2 and sizes.max() < 5


def test_singular_pencils_are_told():
    for E, A in (([[1, 0], [0, 0]], [[1, 0], [1, 0]]), ([[0, 1], [0, 0]], [[1, 0], [0, 0]]), ([[0]], [[0]])):
        E, A = np.array(E, float), np.array(A, float)
        assert not is_regular(E, A) and regular_shift(E, A) is None
        for refused in (weierstrass, finite_eigenvalues):
            with pytest.raises(ValueError, match="singular for every s"):
                refused(E, A)
        with pytest.raises(ValueError, match="singular"):
            laurent(E, A, 0, 1)
    # det(sE - A) is zero at three values of s, and still not zero.
    E, A = np.eye(3), np.diag([1.0, 2.0, 3.0])
    assert is_regular(E, A) and np.allclose(np.sort(finite_eigenvalues(E, A).real), [1, 2, 3])


def test_small_matrices_have_no_rank_of_their_rounding():
    noise = 1e-17 * np.array([[1.0, 2.0], [3.0, 4.0]])
    assert rank(noise) == 2 and rank(noise, 1.0) == 0 and rank(np.zeros((2, 3))) == 0 and rank(np.zeros((0, 3))) == 0
    assert kernel(noise, 1.0).shape == (2, 2) and kernel(np.zeros((0, 3))).shape == (3, 3)
    assert kernel(np.array([[1.0, 0.0]])).shape == (2, 1)


def test_example_a26_is_regular_with_the_printed_ranks():
    E, A = A26
    assert [rank(g * E - A) for g in (0.0, 1.0, -1.0)] == [3, 4, 4]
    form = weierstrass(E, A)
    assert is_regular(E, A) and (len(form.A1), form.index) == (2, 2)


def test_chapter_4_vertices_have_the_eigenvalues_of_the_dossier():
    E, vertices, _ = CHAPTER_4
    printed = ([-5.470, -2.559], [-9.159, -2.269], [-4.525, -1.225])
    for A, values in zip(vertices, printed):
        assert np.allclose(np.sort(finite_eigenvalues(E, A).real), values, atol=5e-4)
    # Denominator of the first vertex's transfer function.
    det = [np.linalg.det(s * E - vertices[0]) for s in (0.0, 1.0, 2.0)]
    assert np.allclose(det, [-119 - 68.25 * s - 8.5 * s**2 for s in (0.0, 1.0, 2.0)])


def test_circuit_example_fulfils_its_lyapunov_equation():
    """E' X E of example A.4.3 is unique, and the printed one to its three digits; det(sE - A) as derived."""
    E, A = A43
    inductance, elastance, r1, r2 = 0.05, 100.0, 20.0, 50.0
    for s in (0.3, 1.7, 2 + 1j):
        derived = -s * r1 * (s * inductance + r2) - (r1 + s * inductance + r2) * elastance
        assert np.linalg.det(s * E - A) == pytest.approx(derived)
    Y = np.diag([1.0, 1.0, 1e6])
    form = weierstrass(E, A)
    Q = form.Q
    weight = (Q.T @ E.T @ Y @ E @ Q)[:2, :2]
    X1 = scipy.linalg.solve_continuous_lyapunov(form.A1.T, -weight)
    middle = np.zeros((3, 3))
    middle[:2, :2] = X1
    back = np.linalg.inv(Q)
    EXE = back.T @ middle @ back
    X = np.diag([1, 20, 0.0]) @ EXE @ np.diag([1, 20, 0.0])  # E is diag(1, .05, 0)
    assert np.allclose(X[:2, :2], [[0.072, -0.001], [-0.001, 0.001]], atol=5e-4)
    # The rest of X: A' X E + E' X A + E' Y E = 0 leaves only X33 free.
    row = np.linalg.solve((A.T)[2:, 2:], -(A.T @ X @ E + E.T @ X @ A + E.T @ Y @ E)[2:, :2] @ np.diag([1, 20.0]))
    X[2, :2] = X[:2, 2] = row.ravel()
    assert np.allclose(A.T @ X @ E + E.T @ X @ A + E.T @ Y @ E, 0, atol=1e-9)
    assert X[2, 0] == pytest.approx(-0.004, abs=5e-4)
    X[2, 2] = 0.00018
    assert np.allclose(np.linalg.eigvalsh(X), [0, 0.0005, 0.0725], atol=5e-5)
