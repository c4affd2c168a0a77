"""The searches do no work twice: one canonicalisation per line search, one half of two equal ones, one exact model."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cvxpy.reductions.dcp2cone.dcp2cone import Dcp2Cone
from cvxpy.reductions.solvers.solving_chain import SolvingChain
from helpers import small_modes

from codegen import pipeline
from codegen.analysis import detectability
from codegen.analysis.adjoint import ResidualModel
from codegen.analysis.detectability import along, beginnings, sequences, thresholds
from codegen.analysis.quick import QuickJudge
from codegen.certify import containment, criteria
from codegen.certify.claims import check, prove
from codegen.certify.error_model import ErrorModel
from codegen.certify.freeze import freeze, limits
from codegen.errors import CertificateError
from codegen.observers import FramerTables
from codegen.plant.load import gallery_names, load
from codegen.plant.uncertain import is_uncertain
from codegen.selection import select
from codegen.selection.trials import both_sides
from codegen.synthesis import METHODS, linf, width
from codegen.synthesis.problem import Problem

PLANT = load("zammali_fd")
CART = load("cart")


def silent(text):
    pass


@pytest.fixture
def calls(monkeypatch):
    """Count the calls of a method or function from now on."""
    def counting(place, name):
        counts, old = [], getattr(place, name)

        def wrapper(*args, **kwargs):
            counts.append(name)
            return old(*args, **kwargs)

        monkeypatch.setattr(place, name, wrapper)
        return counts

    return counting


@pytest.mark.parametrize("tnl", [False, True])
@pytest.mark.parametrize("search", ["common", "multiple", "width"])
def test_a_line_search_canonicalises_once(search, tnl, calls):
    """Decay rates, jump factors and contraction rates are parameters: cvxpy keeps the compiled problem."""
    problem = Problem.of(CART if search == "multiple" else PLANT, tnl=tnl or search == "multiple")
    canonicalised, solved, said = calls(Dcp2Cone, "apply"), calls(SolvingChain, "solve_via_data"), []
    if search == "width":
        found = list(width.candidates(problem, {}, said.append))
    else:
        found = list(linf.candidates(problem, {"lyapunov": search}, said.append))
    assert len(canonicalised) == 1
    # One solution per value of the scalars, not one per framer.
    assert len(solved) == len(said) == (48 if search == "multiple" else 12) and len(found) > 3
    # The control: a problem built anew for each value is canonicalised each time.
    for a in (0.1, 0.2, 0.3):
        width.WidthProblem(problem).solve(a) if search == "width" else linf.LinfProblem(problem, False).solve(a)
    assert len(canonicalised) == 4


def test_the_shortest_dwell_time_is_searched_on_the_same_problem(calls):
    problem = replace(Problem.of(CART, True), tau=None)
    canonicalised = calls(Dcp2Cone, "apply")
    lmi = linf.LinfProblem(problem, True)
    assert list(linf.slower(problem, lmi, (0.2, 0.4), silent)) and lmi.solve(0.3, 2.0)
    assert len(canonicalised) == 1


def solved_tables():
    """Rounded tables and proof of one L-infinity design with equal halves."""
    problem = Problem.of(PLANT, True)
    c = linf.candidate(problem, "common", 0.9, linf.LinfProblem(problem, False).solve(0.9), (1, 1))
    return freeze(FramerTables, PLANT.modes, limits(PLANT), both_sides(c, PLANT), "float64"), c.proof


def test_equal_halves_are_proved_once_and_unequal_ones_both(calls):
    t, proof = solved_tables()
    cert = prove(PLANT.modes, t, proof)
    eliminations = calls(criteria, "leading_failure")
    check(PLANT.modes, t, cert)
    assert t.shared and len(eliminations) == PLANT.n_modes
    # Another P of the lower framer is a claim of its own ...
    wider = np.array(cert["P_lo"]) * 1.0001
    with pytest.raises(CertificateError, match="lo framer"):
        check(PLANT.modes, t, {**cert, "P_lo": wider.tolist()})
    eliminations.clear()
    check(PLANT.modes, t, {**cert, "P_lo": wider.tolist(), "mu": cert["mu"] * 1.001, "level": cert["level"] * 1.001})
    assert len(eliminations) == 2 * PLANT.n_modes
    # ... and so are other gains of the lower framer.
    L_lo = np.array(t.L_lo)
    L_lo[:, 0, 0] += 1e3
    with pytest.raises(CertificateError, match="lo framer"):
        other = replace(t, L_lo=L_lo)
        criteria.check_linf(ErrorModel(PLANT.modes, other), other, cert, [m.name for m in PLANT.modes])


def test_the_exact_model_of_a_table_is_built_once(calls):
    t, proof = solved_tables()
    built, updates = calls(containment.Containment, "__init__"), calls(containment.Containment, "_update")
    cert = prove(PLANT.modes, t, proof)
    assert (len(built), len(updates)) == (1, 2 * PLANT.n_modes)
    check(PLANT.modes, t, cert)
    assert (len(built), len(updates)) == (2, 4 * PLANT.n_modes)
    freeze(FramerTables, PLANT.modes, limits(PLANT), {k: getattr(t, k) for k in ("L_hi", "L_lo", "N_hi", "N_lo")},
           "float64")
    assert len(built) == 4  # before and with the invariant box


@pytest.mark.parametrize("name", [n for n in gallery_names() if load(n).modes and not is_uncertain(load(n))])
def test_thresholds_of_all_channels_are_those_of_each(name, calls):
    """The disturbance's part is computed once per delay; nothing of one channel reaches another."""
    plant = load(name)
    judge = QuickJudge(plant, np.ones(plant.n_f), 2)
    problem = Problem.of(plant, True)
    t = judge.tables(np.zeros((plant.n_modes, plant.n_x, plant.n_y)), problem.C.transpose(0, 2, 1) * 0.1)
    model, tails = ResidualModel.of(plant.modes, t), (np.ones(plant.n_x), 2 * np.ones(plant.n_x))
    paths = sequences(plant.n_modes, 4, None)
    paths = np.concatenate([paths[::-1], paths[::-1]])  # another order than the sorted one, each twice
    extremes = calls(detectability, "extremes")
    every = thresholds(model, beginnings(paths, 1), range(plant.n_f), 1, tails)
    assert len(extremes) == 3 and every.shape == (plant.n_f, 3, len(paths)) and np.isfinite(every).any()
    for j in range(plant.n_f):
        assert np.array_equal(every[j], along(model, paths, j, 1, tails))
    alone = np.array([along(model, p[None], 0, 1, tails)[:, 0] for p in paths[:5]]).T
    assert np.allclose(every[0][:, :5], alone, rtol=1e-12)
    assert np.array_equal(*np.split(every, 2, axis=2))


GENERATED = Path(__file__).parents[2] / "generated"  # a plant that has a committed folder has a design
#: Without banks, whose thresholds take a campaign of half a minute.
FOLDERS = {m: f for m, e in METHODS.items() if not (e.framers or e.sets or e.family == "bank")
           for f in sorted(GENERATED.glob(f"*_{m}"), reverse=True)}


@pytest.mark.parametrize("method", FOLDERS)
def test_progress_names_what_is_solved(method):
    """Methods without a search over candidates: what is being solved or certified, the method's name first."""
    slow = METHODS[method].estimates_mode  # a quarter of a minute each for the gallery's plant
    plant = small_modes.plant("one input") if slow else load(FOLDERS[method].name.removesuffix(f"_{method}"))
    said = []
    pipeline.design(plant, method, said.append)
    assert said and all(line.startswith(f"{method}: ") for line in said)


@pytest.mark.parametrize("method", [name for name, entry in METHODS.items() if entry.framers or entry.sets])
def test_progress_says_how_far_each_search_is(method):
    """Every line names the method; every search counts to its end; what is certified so far is told."""
    names = ["relay", *gallery_names()]
    plant = next(p for p in map(load, names) if p.switching.known and METHODS[method].module.inapplicable(p) is None)
    said = []
    made = pipeline.design(plant, method, said.append)
    searches = {}
    for line in said:
        head = re.match(r"(.*?), (\d+) of (\d+): ", line)
        assert line.startswith(f"{method}: ") and head, line
        searches.setdefault(head[1], []).append((int(head[2]), int(head[3])))
    for counts in searches.values():
        steps = [n for n, _ in counts]
        assert steps[0] == 1 and steps[-1] == counts[0][1] and set(np.diff(steps)) <= {0, 1}
        assert {total for _, total in counts} == {counts[0][1]}
    certified = [int(re.search(r"\((\d+) certified", line)[1]) for line in said]
    assert certified == sorted(certified) and 0 < certified[-1] <= len(made.choice)


def test_the_detection_search_says_how_far_it_is():
    said = []
    made = pipeline.design(PLANT, "tnl-interval", said.append, criterion="detection", evaluations=20)
    boxes = [re.search(r"detection, (\d+) of \d+: aim at output \d, (\d+) of 20 boxes, threshold ([\d.e-]+)", line)
             for line in said if "boxes" in line]
    assert [int(b[2]) for b in boxes] == [10, 20] * len({b[1] for b in boxes})
    # The threshold shown is the search's own estimate, that of the design what is sure on the rounded constants.
    shown = [float(b[3]) for b in boxes]
    sure = made.detection[PLANT.target.real][0]["by_delay"][-1] / Problem.of(PLANT, True).f_scale[0]
    assert min(shown) == pytest.approx(sure, rel=0.02)
    last = re.search(r"\((\d+) certified, best threshold ([\d.e-]+)\)$", said[-1])
    assert int(last[1]) == len(made.choice) - 1 and float(last[2]) >= 0.999 * sure


def test_only_what_is_certified_counts(monkeypatch):
    """Of designs that rounding spoils none is told as certified."""
    said, calls = [], []

    def every_third(*args):
        calls.append(args)
        if len(calls) % 3:
            raise CertificateError("certificate: refused by the test.")
        return select_certified(*args)

    select_certified = select.certified
    monkeypatch.setattr(select, "certified", every_third)
    made = pipeline.design(PLANT, "tnl-interval", said.append, criterion="width")
    shown = [int(re.search(r"\((\d+) certified", line)[1]) for line in said]
    assert shown == [n // 3 for n in range(12)] and len(made.choice) == 4
