"""Bounded run time: what the header states of a call is counted on the C, and no sum or product depends on data.

The C is compiled as C++ with a number that counts. Runs of the plant with other signals, with a fault and with missing
samples take the same multiplications, divisions and additions at each call, until an alarm ends and the observer
starts again, which takes less. Comparisons differ by a few, because a range is not checked beyond its first end. A
mode estimator alone works for the modes that are possible, at most for all.
"""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import stand_in
from helpers.folders import write
from helpers.kept import KEPT, POINTS, family_of
from helpers.points import made
from helpers.scripts import load
from helpers.tools import need

from codegen import read_design
from codegen.plant.model import Scenario
from codegen.plant.simulate import simulate

need("g++")
operations = load("operations")
LAW = next(f for f in KEPT if f.name == "quadrotor_tracking")
STEPS, FAULT, GAPS = 60, range(30, 33), (20, 41, 42)
#: Stand-ins with a branch of the templates that no committed design has.
OTHERS = ("three outputs", "other coordinates", "girard", "four outputs", "table, four outputs",
          "blocks, four outputs", "ellipsoid, four outputs", "trace, four outputs", "box, turned", "smallest")


def samples(u, y, q, theta, gaps=()):
    """One run as the counting program reads it."""
    rows = np.concatenate([u, y, theta], axis=1).tolist()
    return "\n".join(f"{int(k not in gaps)} {mode} {' '.join(map(repr, row))}"
                     for k, (mode, row) in enumerate(zip(q.tolist(), rows)))


def signals(folder, seed):
    """Inputs and measurements of a run without fault, within what the firmware accepts; the largest measurements."""
    design = read_design(folder / "design.json")
    t = design.observer.tables["float64"]
    own = Scenario("quiet", STEPS, tuple((9 * q, q) for q in range(len(design.plant.modes))), ("0",) * len(t.u_lo))
    quiet = next((s for s in design.plant.scenarios if not s.fault), own)
    truth = simulate(design.plant, replace(quiet, steps=STEPS), seed=seed)
    columns = json.loads((folder / "resources.json").read_text(encoding="ascii"))["theta_columns"]
    theta = truth.theta[:, columns] if columns else np.zeros((STEPS, 0))
    return np.clip(truth.u, t.u_lo, t.u_hi), np.clip(truth.y, t.y_lo, t.y_hi), truth.q, theta, t.y_hi


def runs(folder):
    """Always the same modes: two quiet runs, one of them with a sensor's fault, both with missing samples."""
    u, y, q, theta, most = signals(folder, 1)
    other_u, other_y, _, other_theta, _ = signals(folder, 2)
    broken = y.copy()
    broken[list(FAULT)] = most
    return [samples(u, y, q, theta), samples(other_u, other_y, q, other_theta), samples(u, broken, q, theta),
            samples(u, y, q, theta, GAPS), samples(other_u, other_y, q, other_theta, GAPS)]


def by_data(quiet, other, faulty, gaps, other_gaps):
    """Calls whose sums and products, or comparisons of the selection, depend on more than modes and missing samples."""
    def work(call):
        return (*call.sums, call.selections)

    pairs = ((quiet, other), (quiet, faulty[:FAULT.stop]), (gaps, other_gaps))
    return [f"call {k}: {work(a)} and {work(b)}" for one, two in pairs for k, (a, b) in enumerate(zip(one, two))
            if work(a) != work(b)]


#: Families of which the data say what is possible, and so what is calculated.
BY_DATA = ("mode", "driven", "follower", "trailing", "sliding", "guided", "guided_point", "guided_filter")


@pytest.mark.parametrize("folder", KEPT, ids=lambda folder: folder.name)
def test_no_call_takes_more_than_stated_whatever_the_data(folder, tmp_path):
    here = folder
    golden, *found = operations.count(operations.build(here, tmp_path), runs(here))
    assert operations.excess(here, [c for calls in (golden, *found) for c in calls]) == []
    quiet, other, faulty, gaps, _ = found
    assert all(len(calls) == STEPS and all(c.status == 0 for c in calls) for calls in found)
    assert not any(c.raw for c in quiet + other) and any(c.raw for c in faulty) and not all(c.step for c in gaps)
    if family_of(folder) in BY_DATA:
        assert by_data(*found)
        return
    assert by_data(*found) == []
    stated = operations.stated(here)
    most = max(c.multiply for c in golden if not c.law)
    assert most > 5 and stated["multiply"] <= 1.2 * most  # it is a bound of this work, not of any


def test_a_law_takes_what_is_stated_whatever_the_data(tmp_path):
    """Cut or not, every call of one kind takes the same sums and products, and no fewer than stated."""
    golden, = operations.count(operations.build(LAW, tmp_path))
    calls = {step: [c for c in golden if c.law and c.step == step and c.status == 0] for step in (True, False)}
    assert [len({c.sums for c in some}) for some in calls.values()] == [1, 1] and len(calls[True]) > 40
    bound = operations.stated(LAW, law=True)
    assert max(c.multiply for c in calls[True]) == bound["multiply"] > operations.stated(LAW)["multiply"]
    assert max(c.add for c in calls[True]) == bound["add"] and 0 < len(calls[False]) < 5
    shutil.copytree(LAW, tmp_path / "law")
    header = tmp_path / "law" / "quadrotor.h"
    header.write_text(header.read_text().replace(f"{bound['add']} additions", f"{bound['add'] - 1} additions"))
    (told,) = operations.excess(tmp_path / "law", golden)
    assert told.startswith("law, law: add")


@pytest.mark.parametrize("name", OTHERS)
def test_stand_ins_of_points(name, tmp_path):
    real = ("float32", "float64")[len(name) % 2]
    folder = write(made(name), tmp_path / "pt", real)
    calls = operations.count(operations.build(folder, tmp_path))[0]
    assert operations.excess(folder, calls) == []
    assert operations.stated(folder)["add"] <= 1.25 * max(c.add for c in calls)


@pytest.mark.parametrize("family", ["interval", "tnl"])
@pytest.mark.parametrize("layout", ["literal", "loop"])
def test_stand_ins_of_framers(family, layout, tmp_path):
    folder = write(stand_in(family, prefix="cart"), tmp_path / "cart", "float32", layout)
    assert operations.excess(folder, operations.count(operations.build(folder, tmp_path))[0]) == []


def test_the_selection_takes_the_stated_comparisons(tmp_path):
    """Exactly, at each call that moves a zonotope. How many columns change places depends on data: at most the kept."""
    seen = 0
    for folder in POINTS:
        source = next(p for p in folder.glob("*.c") if not p.name.startswith(("test_", "prove_")))
        said = re.search(r"the first of equals: (\d+) comparisons and .*_KEPT exchanges, whatever", source.read_text())
        if not said:
            continue
        seen += 1
        header = source.with_suffix(".h").read_text()
        order, n_x = (int(re.search(rf"_{name} (\d+)U", header).group(1)) for name in ("ORDER", "NX"))
        calls = sum(operations.count(operations.build(folder, tmp_path), runs(folder)), [])
        assert {c.selections for c in calls} == {0, int(said.group(1))}
        exchanges = {c.exchanges for c in calls if c.selections}
        assert len(exchanges) > 1 and max(exchanges) <= order - n_x
    assert seen == 2


@pytest.mark.parametrize("find,put", [
    ("most += PT_size(along);", "most += PT_size(along); if (PT_size(value) <= most) { break; }"),  # inside: enough
    ("if (key[k] > key[best])", "if ((key[k] > 0.0F) && (key[k] > key[best]))"),  # a column of zeros is never larger
])
def test_an_early_exit_is_noticed(find, put, tmp_path):
    """Though every answer stays what it is."""
    folder = next(f for f in POINTS if f.name == "zammali_zonotope_zonotope")

    def change(text):
        found, new = (line.replace("PT", "zammali_zonotope") for line in (find, put))
        assert text.count(found) == 1
        return text.replace(found, new)

    golden, *found = operations.count(operations.build(folder, tmp_path, change), runs(folder))
    assert by_data(*found) if "break" in put else len({c.selections for c in golden}) > 2


def test_a_statement_that_is_too_low_is_noticed(tmp_path):
    folder = next(f for f in KEPT if f.name == "cart_tnl-interval")
    calls = operations.count(operations.build(folder, tmp_path))[0]
    shutil.copytree(folder, tmp_path / "cart")
    header = tmp_path / "cart" / "cart.h"
    for name, word in (("multiply", "multiplications"), ("add", "additions"), ("compare", "comparisons")):
        count = operations.stated(folder)[name]
        header.write_text((folder / "cart.h").read_text().replace(f"{count} {word}", f"{count - 1} {word}"))
        (told,) = operations.excess(tmp_path / "cart", calls)
        assert name in told and str(count) in told


def test_another_calculation_is_not_counted(tmp_path):
    folder = next(f for f in KEPT if f.name == "cart_tnl-interval")
    program = operations.build(folder, tmp_path, lambda text: text.replace("1.0003095F", "1.0003096F"))
    with pytest.raises(ValueError, match="self-test fails"):
        operations.count(program)
