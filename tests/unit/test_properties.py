"""What is said of a descriptor system: three tests that agree, published systems, and what vertices do not say."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.pencils import A26, CHAPTER_3_C, CHAPTER_4, random_pencil  # noqa: E402

from codegen import METHODS, show  # noqa: E402
from codegen.algebra import admissibility  # noqa: E402
from codegen.algebra.admissibility import is_lyapunov_matrix, left_kernel, lyapunov_matrix  # noqa: E402
from codegen.algebra.discrete_admissibility import (  # noqa: E402
    discrete_lyapunov_matrix,
    is_discrete_lyapunov_matrix,
)
from codegen.algebra.visibility import by_laurent, by_rank, by_svd, by_weierstrass  # noqa: E402
from codegen.errors import DesignError  # noqa: E402
from codegen.pipeline import design  # noqa: E402
from codegen.plant import properties as plant_properties  # noqa: E402
from codegen.plant.load import gallery_names, load, loads  # noqa: E402
from codegen.plant.properties import descriptor_properties, hull_admissible, vertex_properties  # noqa: E402

TESTS = (by_rank, by_weierstrass, by_svd)
POLYTOPIC = [name for name in gallery_names() if load(name).polytope is not None]


def judged(E, A, C):
    """Properties on which the three tests agree."""
    found = descriptor_properties("a", *(np.array(M, dtype=float) for M in (E, A, C)), "continuous")
    assert None not in (found.regular, found.impulse_free, found.stable, found.r_observable, found.c_observable,
                        found.i_observable, found.detectable), found
    return found


@pytest.mark.parametrize("seed", range(150))
def test_three_tests_agree_with_each_other_and_with_the_laurent_coefficients(seed):
    made = random_pencil(seed)
    found = [test(made.E, made.A, made.C) for test in TESTS]
    answers = {(v.regular, v.impulse_free, v.index, len(v.finite), v.r_observable, v.c_observable, v.i_observable,
                v.stable(), v.admissible(), v.detectable()) for v in found}
    assert len(answers) == 1
    first = found[0]
    assert (first.index, len(first.finite), first.impulse_free) == (made.index, made.n1, made.index <= 1)
    assert by_laurent(made.E, made.A, made.C) == (first.r_observable, first.c_observable, first.i_observable)
    values = np.linalg.eigvals(made.A1)
    assert first.stable() == bool(np.all(values.real < -1e-3))
    assert first.stable("discrete") == bool(np.all(np.abs(values) < 1 - 1e-3))
    for v in found:
        for value in v.hidden:
            pencil = np.vstack([value * made.E - made.A, made.C])
            assert np.linalg.svd(pencil, compute_uv=False)[-1] < 1e-4


def test_the_random_systems_are_of_every_kind():
    found = [by_rank(m.E, m.A, m.C) for m in map(random_pencil, range(150))]
    for key in ("impulse_free", "r_observable", "c_observable", "i_observable"):
        assert 0.1 < np.mean([getattr(v, key) for v in found]) < 0.95, key
    assert 0.05 < np.mean([v.stable() for v in found]) < 0.9 and 0.1 < np.mean([v.detectable() for v in found]) < 0.95


def test_tests_that_disagree_say_so(monkeypatch):
    E, vertices, C = CHAPTER_4
    assert judged(E, vertices[0], C).r_observable
    monkeypatch.setattr(plant_properties, "by_svd", lambda E, A, C: replace(by_svd(E, A, C), r_observable=False))
    found = descriptor_properties("a", E, vertices[0], C, "continuous")
    assert found.r_observable is None and found.c_observable is True


def test_a_system_on_the_edge_is_too_close_to_tell():
    """An unobservable direction that is 1e-7 away: some tests take that for zero, some do not."""
    E, A = np.diag([1.0, 1, 0]), np.diag([-1.0, -2, 1])
    answers = {descriptor_properties("a", E, A, np.array([[1.0, e, 1]]), "continuous").r_observable
               for e in (1.0, 3e-7, 1e-12)}
    assert {True, False} < answers and None in answers


SINGLE = [
    # E, A, C; regular, impulse-free, stable, R, C, I, detectable; the dossier's and textbook ones
    ("rank [E; C] is 1", [1, 0], [[-1, 0], [0, 1]], [[1, 0]], (1, 1, 1, 1, 0, 1, 1)),
    ("algebraic row of use", [1, 0], [[1, 0], [1, 1]], [[0, 1]], (1, 1, 0, 1, 1, 1, 1)),
    ("impulses unseen", [1, 0], [[0, 1], [1, 0]], [[1, 0]], (1, 0, 1, 1, 0, 0, 1)),
    ("impulses seen", [1, 0], [[0, 1], [1, 0]], [[0, 1]], (1, 0, 1, 1, 1, 1, 1)),
    ("no solution", [1, 0], [[1, 0], [1, 0]], [[0, 1]], (0, 0, 0, 0, 0, 0, 0)),
    ("unstable and unseen", [1, 1], [[1, 0], [0, -1]], [[0, 1]], (1, 1, 0, 0, 0, 1, 0)),
    ("stable and unseen", [1, 1], [[-1, 0], [0, 1]], [[0, 1]], (1, 1, 0, 0, 0, 1, 1)),
    ("double zero", [1, 1], [[0, 1], [0, 0]], [[1, 0]], (1, 1, 0, 1, 1, 1, 1)),
]


@pytest.mark.parametrize("name, e, A, C, expected", SINGLE, ids=[s[0] for s in SINGLE])
def test_small_systems(name, e, A, C, expected):
    found = judged(np.diag(e), A, C)
    assert (found.regular, found.impulse_free, found.stable, found.r_observable, found.c_observable,
            found.i_observable, found.detectable) == tuple(map(bool, expected))


def test_discrete_time_has_another_stable_region():
    E, A, C = np.diag([1.0, 1, 0]), np.diag([0.5, -2.0, 1]), np.array([[0.0, 1, 1]])
    for seen, detectable in ((C, (False, True)), (C[:, [1, 0, 2]], (True, False))):
        found = [descriptor_properties("a", E, A, seen, kind) for kind in ("continuous", "discrete")]
        assert tuple(f.detectable for f in found) == detectable and not any(f.stable for f in found)
    assert descriptor_properties("a", E, A / 4, C, "discrete").admissible


def test_published_systems():
    E, vertices, C = CHAPTER_4
    reduced = [C, CHAPTER_3_C, *(np.delete(M, i, axis=0) for M in (C, CHAPTER_3_C) for i in range(len(M)))]
    for outputs in reduced[:5] + reduced[5:]:
        for A in vertices:
            found = judged(E, A, outputs)
            assert found.admissible and found.i_observable and found.r_observable
    for outputs in (C, CHAPTER_3_C, *(np.delete(CHAPTER_3_C, i, axis=0) for i in range(3))):
        assert all(judged(E, A, outputs).c_observable for A in vertices)
    disc = load("disc").polytope
    for v in disc.vertices:
        assert all(getattr(judged(disc.E, v.A, disc.C), f"{key}_observable") for key in "rci")
        dual = judged(disc.E.T, v.A.T, v.B.T)
        assert dual.r_observable and dual.i_observable and not dual.c_observable  # not C-controllable
    example = judged(*A26, np.eye(4))
    assert example.regular and not example.impulse_free and len(example.finite) == 2


def test_outputs_of_the_bioreactor():
    """From COD, methane and growth, as printed, biomass cannot be told: it decays by itself, -0.02 per day."""
    p = load("bioreactor").polytope
    assert len(p.vertices) == 16
    for v in p.vertices:
        good, printed = judged(p.E, v.A, p.C), by_rank(p.E, v.A, np.eye(4)[1:])
        assert good.r_observable and good.i_observable and not good.c_observable and good.admissible
        assert not judged(p.E, v.A, np.eye(4)[1:]).r_observable and printed.detectable()
        assert np.allclose(np.array(printed.hidden) * 86400, -0.02, rtol=1e-5)


HULL = {
    "regularity": (np.diag([1.0, 0]), [np.diag([-1.0, -1]), np.diag([-1.0, 1])], np.eye(2), "regular"),
    "impulse freedom": (np.diag([1.0, 0]), [np.array([[-1.0, 1], [1, -1]]), np.array([[-1.0, 1], [1, 1]])], np.eye(2),
                        "impulse_free"),
    "stability": (np.eye(2), [np.array([[-1.0, 8], [0, -1]]), np.array([[-1.0, 0], [8, -1]])], np.eye(2), "stable"),
    "observability": (np.eye(2), [np.array([[-1.0, 1], [0, -2]]), np.array([[-1.0, -1], [0, -2]])],
                      np.array([[1.0, 0]]), "r_observable"),
}


@pytest.mark.parametrize("name", HULL)
def test_properties_of_the_vertices_are_not_those_of_their_hull(name):
    E, vertices, C, key = HULL[name]
    assert all(getattr(judged(E, A, C), key) for A in vertices)
    middle = judged(E, sum(vertices) / 2, C)
    assert not getattr(middle, key)
    if name == "stability":
        assert np.max(middle.finite.real) == pytest.approx(3)
    if name != "observability":
        assert lyapunov_matrix(E, vertices) is None


def disc_at(*slopes):
    return [np.array([[0, 1, 0, 0], [s, -0.75, 0, 0.025], [0, 1, -0.4, 0], [s, -0.75, 0, 0.075]]) for s in slopes]


ADMISSIBLE = {
    "chapter 4": (CHAPTER_4[0], CHAPTER_4[1]),
    "disc, printed sector": (np.diag([1.0, 1, 0, 0]), disc_at(-2.125, -3.2)),
    "disc, tight sector": (np.diag([1.0, 1, 0, 0]), disc_at(-2.5, -2.696)),
    "mixed rows": (np.array([[1.0, 2, 0], [0, 1, 1], [1, 0, 1]]) @ CHAPTER_4[0],
                   [np.array([[1.0, 2, 0], [0, 1, 1], [1, 0, 1]]) @ A for A in CHAPTER_4[1]]),
    "nonsingular": (np.eye(2), [np.array([[-1.0, 8], [0, -1]])]),
}
NOT_ADMISSIBLE = {
    "unstable": (np.eye(1), [np.array([[0.1]])]),
    "marginal": (np.eye(1), [np.array([[0.0]])]),
    "index 2": (np.diag([1.0, 0]), [np.array([[0.0, 1], [1, 0]])]),
    "singular": (np.diag([1.0, 0]), [np.array([[-1.0, 0], [1, 0]])]),
    "one of two": (np.eye(1), [np.array([[-1.0]]), np.array([[0.01]])]),
}


@pytest.mark.parametrize("name", ADMISSIBLE)
def test_a_common_lyapunov_matrix_proves_the_whole_hull(name):
    E, vertices = ADMISSIBLE[name]
    found = lyapunov_matrix(E, vertices)
    assert is_lyapunov_matrix(E, vertices, found.Y, found.X)
    P = found.P
    assert np.allclose(E.T @ P, P.T @ E, atol=1e-9 * np.abs(P).max())
    assert np.linalg.eigvalsh(E.T @ P + P.T @ E).min() > -1e-9
    rng = np.random.default_rng(0)
    for _ in range(20):
        h = rng.dirichlet(np.ones(len(vertices)))
        A = np.tensordot(h, vertices, 1)
        assert np.linalg.eigvalsh(A.T @ P + P.T @ A).max() < 0
        assert judged(E, A, np.eye(len(E))).admissible


@pytest.mark.parametrize("name", NOT_ADMISSIBLE)
def test_no_lyapunov_matrix_where_there_is_none(name):
    assert lyapunov_matrix(*NOT_ADMISSIBLE[name]) is None


def test_the_exact_check_refuses_what_is_not_strict():
    E, vertices = ADMISSIBLE["chapter 4"]
    found = lyapunov_matrix(E, vertices)
    assert not is_lyapunov_matrix(E, vertices, 0 * found.Y, 0 * found.X)  # meets the printed condition "<= 0"
    assert not is_lyapunov_matrix(E, vertices, found.Y, -found.X)
    assert not is_lyapunov_matrix(E, vertices, -found.Y, found.X)
    assert not is_lyapunov_matrix(E, vertices, found.Y, found.X[:0])
    assert not is_lyapunov_matrix(E, [*vertices, -vertices[0]], found.Y, found.X)
    # Y must be positive, whatever the vertices give; and it is the symmetric part of A' P that counts.
    assert not is_lyapunov_matrix(np.eye(1), [np.eye(1)], -np.eye(1), np.zeros((0, 1)))
    assert not is_lyapunov_matrix(np.eye(2), [-np.array([[1.0, 3], [0, 1]]).T], np.eye(2), np.zeros((0, 2)))
    assert is_lyapunov_matrix(np.eye(2), [-np.array([[1.0, 1.5], [0, 1]]).T], np.eye(2), np.zeros((0, 2)))
    # The smallest float64 there is still has a sign.
    one, over = np.array([[1.0]]), np.array([[np.nextafter(0.0, 1)]])
    assert is_lyapunov_matrix(one, [-over], one, np.zeros((0, 1)))
    assert not is_lyapunov_matrix(one, [0 * one], one, np.zeros((0, 1)))
    assert not is_lyapunov_matrix(one, [over], one, np.zeros((0, 1)))


def test_a_wrong_answer_of_the_solver_is_not_believed(monkeypatch):
    E, vertices = ADMISSIBLE["chapter 4"]
    wrong = {"rows": np.ones(3), "columns": np.ones(3), "time": 1.0, "apply": lambda self, E, A: (E, A - 20 * E)}
    monkeypatch.setattr(admissibility, "balanced", lambda E, A: type("Wrong", (), wrong)())
    unstable = [*vertices, np.diag([1.0, 1, 1])]
    assert lyapunov_matrix(E, unstable) is None
    monkeypatch.setattr(admissibility, "is_lyapunov_matrix", lambda *arguments: True)
    assert lyapunov_matrix(E, unstable) is not None


def test_left_kernel_is_exact():
    E = np.array([[1.0, 2, 3], [0.1, 0.2, 0.3], [0, 0, 0]])
    S = left_kernel(np.array([[1.0, 2], [3, 6]]))
    assert [[float(x) for x in row] for row in S] == [[-3], [1]]
    # 0.1 is no tenth of 1, and the floats say so: the second row is not a multiple of the first.
    assert len(left_kernel(E)[0]) == 1 and left_kernel(np.eye(2)) == []


@pytest.mark.parametrize("name", POLYTOPIC)
def test_check_prints_the_properties_of_the_gallery(name, monkeypatch):
    plant, page = load(name), io.StringIO()
    monkeypatch.setattr(show, "out", Console(file=page, highlight=False, soft_wrap=True, width=300))
    show.plant(plant)
    text = page.getvalue()
    assert f"{len(plant.polytope.vertices)} vertices" in text and "modes, worst" not in text
    for v, p in zip(plant.polytope.vertices, vertex_properties(plant)):
        cells = [c.strip() for c in next(r for r in text.splitlines() if r.startswith(f"{v.name} ")).split("│")]
        assert cells[2:] == [{True: "yes", False: "no", None: "too close to tell"}[x] for x in (
            p.regular, p.impulse_free, p.stable, p.r_observable, p.c_observable, p.i_observable, p.detectable)]
    # Known terms may be what solves the algebraic equations; without them the vertices of the digester are not regular.
    # The quadrotor turns freely: it is what the law of "tracking" is for.
    admissible = not plant.polytope.known and name != "quadrotor"
    assert hull_admissible(plant) is admissible and ("admissible for every weight" in text) is admissible
    assert ("exact while" in text, "linearised at points" in text) == (bool(plant.polytope.premises),
                                                                       name == "disc_points")
    for z in plant.polytope.premises:
        assert any(r.startswith(z.name) for r in text.splitlines())
    assert all(m in text for m in METHODS)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", POLYTOPIC)
def test_every_method_takes_a_polytopic_plant_or_says_why_not(name, method):
    plant = load(name)
    reason = METHODS[method].module.inapplicable(plant)
    if reason is not None:
        assert reason.endswith(".") and (METHODS[method].family in ("polytopic", "descriptor", "bank") or (
            reason.startswith("the plant is polytopic") and "expected" in reason))
        with pytest.raises(DesignError, match=re.escape(f'{name}: method "{method}" does not apply: {reason}')):
            design(plant, method)


def test_what_lies_between_the_vertices_is_told_where_it_is_not_admissible(monkeypatch):
    text = load("dlpv").text
    assert "[-2, 4, 7]" in text
    text = text.replace("[-2, 4, 7]", "[-2, 4, -7]")
    plant, page = loads(text), io.StringIO()
    assert all(p.admissible for p in vertex_properties(plant)) and hull_admissible(plant) is False
    monkeypatch.setattr(show, "out", Console(file=page, highlight=False, soft_wrap=True, width=300))
    show.plant(plant)
    assert "not shown to be admissible" in page.getvalue()
    discrete = loads(load("dlpv").text.replace('"continuous"', '"discrete"'))
    assert hull_admissible(discrete) is False and not any(p.stable for p in vertex_properties(discrete))


def by_euler(E, vertices, period):
    return [E + period * A for A in vertices]


def test_one_lyapunov_matrix_in_discrete_time():
    """Causal, regular and stable for all weights; stiff units and an E of no special form change nothing."""
    E, vertices, _ = (np.array(M, dtype=float) for M in CHAPTER_4)
    for period, left, right in ((0.02, np.eye(3), np.eye(3)),
                                (0.05, np.array([[1.0, 2, 0], [0, 1, 0], [3, 0, 1]]), np.diag([1e3, 1, 1e-2]))):
        E2, moved = left @ E @ right, [left @ A @ right for A in by_euler(E, vertices, period)]
        found = discrete_lyapunov_matrix(E2, moved)
        assert is_discrete_lyapunov_matrix(E2, moved, found.Y, found.R)
        for h in np.random.default_rng(1).dirichlet(np.ones(3), 20):
            middle = descriptor_properties("h", E2, sum(a * b for a, b in zip(h, moved)), np.eye(3), "discrete")
            assert middle.admissible
    # Euler's rule fails where the period is too long: the fastest mode of all vertices is -9.2.
    assert discrete_lyapunov_matrix(E, by_euler(E, vertices, 0.23)) is None
    assert not is_discrete_lyapunov_matrix(E, by_euler(E, vertices, 0.23), found.Y, found.R)


def test_no_lyapunov_matrix_in_discrete_time_where_there_is_none():
    E = np.diag([1.0, 0])
    bad = {"unstable": [np.diag([1.01, 1])], "not causal": [np.array([[0.5, 1], [1, 0]])],
           "not regular": [np.diag([0.5, 0])], "middle not causal": [np.diag([0.5, 1]), np.diag([0.5, -1])]}
    for name, vertices in bad.items():
        assert discrete_lyapunov_matrix(E, vertices) is None, name
    fine = [np.diag([0.9, 1]), np.array([[-0.9, 0], [0.3, 2]])]
    found = discrete_lyapunov_matrix(E, fine)
    for Y, R, vertices in ((-found.Y, found.R, fine), (found.Y, -found.R, fine), (found.Y, found.R[:1], fine),
                           (found.Y, found.R, [*fine, np.diag([1.0, 1])]), (0 * found.Y, 0 * found.R, fine)):
        assert is_discrete_lyapunov_matrix(E, fine, found.Y, found.R)
        assert not is_discrete_lyapunov_matrix(E, vertices, Y, R)
    assert discrete_lyapunov_matrix(np.eye(2), [np.array([[0, 1.2], [0.5, 0]])]) is not None  # no algebraic equations
