"""Faults that leave no mode possible some samples later, of sensors and of states: what is promised is found, in runs
at corners of every bound; less is not promised, nor what looks like a switch."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.checker import checker_of
from helpers.kept import KEPT, family_of
from helpers.reports import StandInDriver
from helpers.small_modes import TEXT, tables

from codegen.analysis.mode_promise import missed, within_range
from codegen.analysis.promised import names, trials
from codegen.analysis.validate import side_by_side, validate
from codegen.certify import mode_certificate, mode_faults
from codegen.certify.mode_witness import stated
from codegen.designs import read_design
from codegen.errors import CertificateError
from codegen.observers import ModeObserver
from codegen.plant.bounded import bounded
from codegen.plant.load import loads
from codegen.plant.model import Fault, Scenario
from codegen.plant.simulate import simulate
from codegen.report.mode_words import detection

FOLDERS = {family_of(f): f for f in KEPT if family_of(f) in ("mode", "follower", "trailing")}


@lru_cache
def design(family):
    return read_design(FOLDERS[family])


def with_promises(plant, observer, cert, asked):
    """A certificate of the same delays for another fault, with the multipliers of all of it."""
    t, p, kept = observer.tables["float32"], bounded(plant), {}
    mode_certificate.proved(p, t, cert, kept)
    faults = mode_certificate.found_faults(p, t, cert, asked, kept)
    sizes = {mode_faults.label(0, f["within"]): f["size"] for f in faults}
    return cert | {"faults": faults, "witnesses": stated(kept, np.array(cert["widths"]), sizes)}


@lru_cache
def pushed_twice():
    """The plant of the trailing design with a fault that pushes the state as the gust does; its estimator alone."""
    made = design("trailing")
    plant = loads(made.plant.text.replace("Df = [[1]]", "Bf = [[0.5], [1]]"))
    observer = ModeObserver(made.observer.tables, made.observer.supervision)
    return plant, observer, with_promises(plant, observer, made.certificate["float32"], 3)


def case(name):
    if name == "state":
        return pushed_twice()
    made = design(name)
    return made.plant, made.observer, made.certificate["float32"]


@lru_cache
def runs(name, within, after, size):
    """Runs with a fault of this size, in every mode, either way, with what hides it."""
    plant, observer, _ = case(name)
    scenarios = trials(plant, {"channel": "sensor", "within": within, "after": after, "size": size})
    found = [simulate(plant, scenario, seed=1) for scenario in scenarios]
    u, y, q, theta = side_by_side(found)
    return found, observer.run_many(u, y, q, "float32", theta=theta), after + 2, len(found[0].q)


def lost(name, promise, size, blind=False):
    """Runs, of how many, in which a fault of this size is promised to be found and is not."""
    plant = case(name)[0]
    truths, traces, start, steps = runs(name, promise["within"], promise["after"], size)
    traces = replace(traces, raw_bits=0 * traces.raw_bits) if blind else traces
    channels, settled = tuple(f.name for f in plant.f), np.arange(steps) < start
    return sum(missed(plant.kind, channels, {"faults": [promise]}, truth, traces.row((i, slice(steps))), settled,
                      within_range(plant, truth)) for i, truth in enumerate(truths)), len(truths)


@pytest.mark.parametrize("name, share", [("mode", 0.2), ("follower", 0.3), ("trailing", 0.5), ("state", 0.5)])
def test_what_is_promised_is_found_and_less_is_not(name, share):
    faults = case(name)[2]["faults"]
    promise = faults[-1]
    assert promise["within"] == {"mode": 10, "follower": 1, "trailing": 10, "state": 3}[name]
    size = promise["size"]
    assert lost(name, promise, size)[0] == 0 and len(set(lost(name, promise, size, blind=True))) == 1
    if "upto" in promise:
        size = 0.99999 * promise["upto"]
        assert lost(name, promise, size)[0] == 0 and len(set(lost(name, promise, size, blind=True))) == 1
    less = share * promise["size"]
    assert lost(name, promise | {"size": less}, less)[0] > 0 and lost(name, promise, less)[0] == 0


def test_validation_tries_every_promise():
    made, cert = design("trailing"), design("trailing").certificate["float32"]
    tried = names(made)
    assert tried == ['as promised: "sensor" within 3', 'as promised: "sensor" within 10']
    for o, f in zip(validate(made, StandInDriver(made), tried), cert["faults"], strict=True):
        assert o.passed and o.scenario.name in tried and 0 <= o.episodes[0].delay <= f["within"]
    wrong = cert | {"faults": [f | {"size": 0.4 * f["size"]} for f in cert["faults"]]}
    wrong = replace(made, certificate=made.certificate | {"float32": wrong})
    assert all(o.late and not o.passed for o in validate(wrong, StandInDriver(wrong), tried))


def test_more_samples_find_more():
    for folder in FOLDERS.values():
        for cert in read_design(folder).certificate.values():
            for few, many in zip(cert["faults"], cert["faults"][1:]):
                assert few["within"] < many["within"]
                assert many["size"] < 0.95 * few["size"] or many["upto"] > 1.05 * few["upto"]
    few, many = design("mode").certificate["float32"]["faults"]
    assert many["size"] < 0.2 * few["size"]


@pytest.mark.parametrize("key, change", [("size", lambda x: 0.999 * x), ("after", lambda x: x - 1),
                                         ("within", lambda x: x - 1), ("upto", lambda x: 1.01 * x)])
def test_tampering_is_caught(key, change):
    plant, observer, cert = pushed_twice()
    text = " ".join(mode_certificate.check(plant, observer.tables["float32"], cert))
    assert "0.396214 or less, either way" in text and "x stays within its range" in text
    wrong = cert | {"faults": [f | {key: change(f[key])} for f in cert["faults"]]}
    with pytest.raises(CertificateError, match="the fault sensor is claimed to be found"):
        mode_certificate.check(plant, observer.tables["float32"], wrong)


def test_what_a_promise_asks_of_a_push_is_said():
    """On the state of a continuous plant it is held from a sample on; half a period before that is another story."""
    promise = {"channel": "sensor", "size": 0.5, "within": 1, "after": 20}
    for text, said in ((TEXT, False), (TEXT.replace("Df = [[1]]", "Bf = [[0.3], [-1]]"), True)):
        made = SimpleNamespace(plant=loads(text), certificate={"float32": {"faults": [promise]}})
        words = mode_certificate._seen(made.plant, promise, str)
        assert ("if it begins at a sample, 20 or more after power-up" in words) == said == ("x stays" in words)
        assert any("begin at a sample" in note for note in detection(made, "float32").notes) == said


def test_nothing_is_promised_where_nothing_is_asked():
    made = design("follower")
    cert, t = made.certificate["float32"], made.observer.tables["float32"]
    assert mode_certificate.found_faults(bounded(made.plant), t, cert, 0) == []
    assert [f["within"] for f in mode_certificate.found_faults(bounded(made.plant), t, cert, 1)] == [1]


checker = checker_of("delays", "hidden")


def without(words):
    """Leaves out the multipliers of stories with these words."""
    def change(cert, data):
        for name in [n for n in cert["witnesses"] if words in n and n.startswith("fault")]:
            del cert["witnesses"][name]
    return change


def told(key, factor):
    return lambda cert, data: cert["faults"][0].__setitem__(key, factor * cert["faults"][0][key])


def other(old, new):
    return lambda cert, data: data["plant"].__setitem__("toml", data["plant"]["toml"].replace(old, new))


@pytest.mark.parametrize("change, match", [
    (None, None), (told("size", 0.999), "may live with a fault"), (told("upto", 1.05), "may live with a fault"),
    (other("Bf = [[0.5], [1]]", "Bf = [[0.4], [0.8]]"), "may live with a fault"), (told("within", 0), "is found"),
    (without(" 0 0 0 - "), "that mode 0 may take"), (without(" 1 1 0 -1 "), "nothing bounds the fault"),
    (told("after", 0.5), "is found")])
def test_the_independent_checker_refuses_what_is_not_proved(change, match, checker):
    plant, observer, cert = pushed_twice()
    ranges = [[s.lo, s.hi] for s in plant.x]
    data = {"plant": {"toml": plant.text}, "tables": {"float32": observer.tables["float32"].to_dict()},
            "certificate": {"float32": copy.deepcopy(cert)}}
    if change is None:
        assert checker["delays"].check(data, "float32", ranges) == "delays hold, faults of the sizes told are found"
        return
    change(data["certificate"]["float32"], data)
    with pytest.raises(SystemExit, match=f"refused: .*({match})"):
        checker["delays"].check(data, "float32", ranges)


@pytest.mark.parametrize("text", [TEXT, None], ids=["continuous", "discrete"])
def test_the_push_of_a_fault_is_that_of_the_plant(text, checker):
    """Two runs that differ by the fault alone; and what the independent checker makes of it."""
    plant = loads(text.replace("Df = [[1]]", "Bf = [[0.3], [-1]]")) if text else pushed_twice()[0]
    t = tables("one input", 3, "float64") if text else pushed_twice()[1].tables["float32"]
    of = mode_faults.channel(plant, t, 0)
    assert np.all(of.off < 1e-15 * (1 + np.abs(of.pushed)))
    for q in range(plant.n_modes):
        scenario = Scenario("push", 3, ((0, q),), tuple(repr(float(s.hi)) for s in plant.u), "corner", "corner")
        still = simulate(plant, scenario, seed=1)
        moved = simulate(plant, replace(scenario, fault=(Fault(0, 0, 1, "0.5"),)), seed=1)
        assert np.allclose(t.S @ (moved.x[1] - still.x[1]), 0.5 * of.pushed[q], rtol=0, atol=1e-9)
        assert np.max(np.abs(of.pushed[q])) > 1e-3
    found = checker["hidden"].columns(__import__("tomllib").loads(plant.text), 0, checker["delays"].exact(t.S.tolist()))
    for q, (seen, pushed, room) in enumerate(found):
        assert [float(s) for s in seen] == of.seen[q].tolist() and float(room) < 1e-40
        assert np.all(np.abs(np.array([float(x) for x in pushed]) - of.pushed[q]) <= of.off[q] + 1e-16)


@pytest.mark.parametrize("folder", [f for f in KEPT if family_of(f) in ("driven", "follower", "trailing")],
                         ids=lambda f: f.name)
def test_what_runs_beside_the_estimator_only_rules_out_more(folder):
    """So that what is found by the estimator alone is found as soon, whatever is narrowed by what runs beside it."""
    made = read_design(folder)
    alone = ModeObserver(made.observer.tables, made.observer.supervision)
    run = simulate(made.plant, "sensor fault", seed=3)
    own, bare = (o.run(run.u, run.y, theta=run.theta, real="float32") for o in (made.observer, alone))
    first, later = (int(np.argmax(trace.raw_bits != 0)) for trace in (own, bare))
    assert 0 < first <= later
    assert not np.any(own.mode_set[:first] & ~bare.mode_set[:first])
