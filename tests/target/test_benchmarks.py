"""The benchmark: candidates agree before anything is measured, the goals that hold are kept, misses are told."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.tools import need

from codegen.plant.load import load

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks import bound, cases, measure, ours, run, sets, synthesis, table, whole  # noqa: E402
from benchmarks.rivals import RIVALS  # noqa: E402

NAMES = ("casadi_sx", "loop_fixed", "sympy_c")


@pytest.fixture
def tools():
    need("gcc", "valgrind", "arm-none-eabi-gcc", "qemu-system-arm")


@pytest.mark.parametrize("setting", run.QUICK, ids=lambda s: f"{s.observer}-{s.n}-{s.modes}-{s.target}")
def test_quick_rows(tools, setting):
    """literal and table need no more instructions than any rival here, loop no more flash, all near the bound."""
    records = run.run_one(setting, NAMES)
    (line,) = table.lines([{k: str(v) for k, v in r.items()} for r in records])
    assert {r["candidate"] for r in records} == {"literal", "table", "loop", *NAMES}
    assert line.to_best <= 1 and line.table_to_best <= 1 and line.to_bound <= 1.1
    assert setting.target == "host" or line.loop_to_smallest <= 1
    assert all(int(r["instructions"]) > 10 and r["flash_bytes"] > 50 for r in records)


def mutant(files: dict, old: str, new: str) -> dict:
    """Sources with one change in the first file that has the text."""
    name = next(n for n, text in files.items() if old in text)
    return files | {name: files[name].replace(old, new, 1)}


@pytest.mark.parametrize(("observer", "target", "wrong"), [
    ("point", "host", "loop_fixed"), ("interval", "m4f", "literal"), ("interval", "host", "sympy_c")])
def test_a_wrong_coefficient_is_told_and_nothing_is_measured(tools, tmp_path, monkeypatch, observer, target, wrong):
    """One number of one candidate changed in its fourth digit; a mode that few samples have."""
    case = cases.make(observer, 4, 4, "float32")
    good = {"literal": ours.sources(case)["literal"], **{n: RIVALS[n].sources(case) for n in ("loop_fixed", "sympy_c")}}
    gain = case.tables["A" if observer == "point" else "M"][3]
    value = gain[np.nonzero(gain)][0]
    size = {"sympy_c": f"{abs(value):.9g}"}.get(wrong, f"{np.float32(abs(value))!s}")
    changed = good | {wrong: mutant(good[wrong], size, f"{abs(value) * 1.001:.9g}")}
    monkeypatch.setattr(measure, "Figures", lambda *_: pytest.fail("measured in spite of a disagreement"))
    with pytest.raises(measure.Disagreement) as told:
        measure.measure(case, changed, target, "-O2", tmp_path, time=False)
    assert f"{wrong} by" in str(told.value) and str(told.value).count(" by ") == 1


def test_where_a_design_spends_its_time():
    """Every part that is timed is there by that name and takes some time; afterwards it is the function that it was."""
    parts = [(place, name, getattr(place, name)) for of in synthesis.PARTS.values() for place, name in of]
    row = synthesis.measure(load("zammali_fd"), "interval")
    assert row.tried >= row.certified > 0 and row.outcome
    assert all(getattr(row, column) > 0 for column in synthesis.PARTS if column != "search")
    assert all(getattr(place, name) is old for place, name, old in parts)
    assert "| zammali_fd |" in synthesis.table([row])


def test_bound_counted_by_hand():
    """C = [1 0], A = [0.5 0; 0.25 1], B = [0; 1], K = [0.5; 0].

    So r = x0 - y, x0' = 0.5 x0 + 0.5 r, x1' = 0.25 x0 + x1 + u. Loads x0 x1 u y 0.5 0.25;
    3 products; additions 1 + 1 + 2; stores 2 + 1 + 2. Fused: r 1; x0' 2; x1' 2.
    """
    t = {"C": [[1, 0]], "A": [[0.5, 0], [0.25, 1]], "B": [[0], [1]], "K": [[0.5], [0]]}
    case = cases.make("point", 2, 1, "float64")
    case = dataclasses.replace(case, tables={k: np.array(v, float)[None] for k, v in t.items()})
    found = bound.work(case)
    assert found == bound.Work(load=6, multiply=3, add=4, fused=5, store=5)
    assert bound.instructions(found, False) == 19 and bound.instructions(found, True) == 17
    assert bound.instructions(found, False, multiply=60, add=70) == 6 + 180 + 280 + 5 + 1


def test_expected_answers_follow_the_generators_own_reference():
    """The case's equations and ``framer.propagate`` are two hands; in double they differ by rounding alone."""
    from codegen.observers.framer import propagate, residuals

    case = cases.make("interval", 6, 4, "float64")
    t, lo, hi = ours.framer_tables(case), case.start["x_lo"][None], case.start["x_hi"][None]
    for row, u, y, q in zip(cases.expected(case), case.u[:, None], case.y[:, None], case.q[:, None]):
        np.testing.assert_allclose(row, np.concatenate([lo, hi, *residuals(t, q, lo, hi, u, y)], axis=1)[0], atol=1e-13)
        lo, hi = propagate(t, q, lo, hi, u, y, np.zeros_like(y))


def test_a_miss_is_told():
    """A rival that is one instruction too good, too small, or a bound too low, turns up in the last column."""
    def record(candidate, instructions, flash):
        keys = dict(zip(table.KEYS, ("point", "sparse", "2", "1", "float32", "m4f", "-O2")))
        return keys | {"bound": "60", "candidate": candidate, "instructions": str(instructions),
                       "flash_bytes": str(flash), "stack_bytes": "8", "time_ratio": ""}

    def misses(rival, flash, literal=70, tabled=70):
        rows = [record("literal", literal, 0), record("table", tabled, 0), record("loop", 0, 200),
                record("eigen", rival, flash), record("loop_fixed", 900, 900)]
        return table.lines(rows)[0].misses

    assert misses(100, 200) == ()
    assert misses(99, 200) == ("literal/rival",)
    assert misses(200, 199) == ("flash",)
    assert misses(200, 200, literal=79) == ("literal/bound",)
    assert misses(200, 200, tabled=201) == ("table/rival",)


def test_committed_table_is_the_committed_measurement():
    """RESULTS.md is what the CSV files say, every row and rival is there, and every design's whole step."""
    assert run.text() == run.TABLE.read_text(encoding="ascii")
    found = {}
    for r in run.read(run.RESULTS):
        found.setdefault(tuple(r[k] for k in table.KEYS), set()).add(r["candidate"])
    wanted = {tuple(str(v) for v in dataclasses.astuple(s)) for s in run.settings()}
    assert set(found) == wanted and all(names == {"literal", "table", "loop", *RIVALS} for names in found.values())
    designs = {r["design"] for r in run.read(run.WHOLE)}
    assert designs <= {p.parent.name for p in whole.GENERATED.glob("*/design.json")} and len(designs) >= 6


def test_committed_table_of_sets():
    """SETS.md is what its CSV file says, its rows are of the walk, its goals are reached, promises are near."""
    records = sets.read()
    assert sets.render(records) == sets.TABLE.read_text(encoding="utf-8")
    assert {r["name"] for r in records} <= {v.name for v in sets.chosen(False)}
    assert set(sets.GOALS) == set(sets.goals(records))
    made = [r for r in records if not r["reason"]]
    assert len(made) >= 8 and all(int(r["instructions"]) > int(r["multiply"]) for r in made)
    for r in made:
        assert float(r["within"]) <= float(r["on"])
        assert r["promised_on"] == "" or float(r["on"]) <= float(r["promised_on"]) * 1.05, r["name"]
    reached = {kind: best <= goal for kind, (goal, best, _) in sets.goals(records).items()}
    assert reached == dict.fromkeys(sets.GOALS, True)
    worse = [r | {"on": "0.2"} if r["kind"] == "zonotope" else r for r in records]
    assert "(missed)" in sets.render(worse).split("| zonotope | 0.058")[1].split("\n")[0]


@pytest.mark.parametrize("folder", ["zammali_ellipsoid_ellipsoid"])
def test_sizes_of_sets_are_sure_and_not_idle(folder):
    """A step of the size found shows at its onset under any corner noise; one of a third of it may not."""
    from codegen.designs import read_design

    made = read_design(ROOT / "generated" / folder)
    path = np.tile(np.repeat(np.arange(3), sets.DWELL), 5)[:sets.BEFORE + sets.ONSETS + sets.WITHIN + 1]
    on, within = sets.sure(made, path)
    assert 0.03 < within <= on < 0.2
    rng, seen = np.random.default_rng(0), {1.0001: [], 0.33: []}
    for share, found in seen.items():
        for k in range(sets.BEFORE, sets.BEFORE + sets.ONSETS):
            y = noisy(made.plant, path, k, share * on * rng.choice([-1.0, 1.0]), rng)
            u = np.zeros((len(path), made.plant.n_u))
            trace = made.observer.run(u, y, path)
            assert not trace.raw_bits[:k].any()
            found.append(bool(trace.raw_bits[k]))
    assert all(seen[1.0001]) and not all(seen[0.33])


def noisy(plant, path, onset, size, rng):
    """Outputs under corner noise, from a corner of the initial box, without input; a step on the first channel."""
    x, y = np.where(rng.random(plant.n_x) < 0.5, plant.x0_lo, plant.x0_hi), []
    for k, q in enumerate(path):
        m, f = plant.modes[q], size * (k >= onset)
        w, v = (np.where(rng.random(len(lo)) < 0.5, lo, hi) for lo, hi in ((m.w_lo, m.w_hi), (m.v_lo, m.v_hi)))
        y.append(m.C @ x + m.Dv @ v + m.Df[:, 0] * f)
        x = m.A @ x + m.Bw @ w + m.Bf[:, 0] * f
    return np.array(y)
