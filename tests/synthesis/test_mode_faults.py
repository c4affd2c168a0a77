"""Steps of a sensor that leave no mode possible: what is promised is found in every run, less is not promised."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.kept import KEPT, family_of

import codegen
from codegen.analysis.mode_promise import missed
from codegen.certify import mode_certificate, mode_faults
from codegen.designs import read_design
from codegen.errors import CertificateError
from codegen.plant.bounded import bounded
from codegen.plant.load import loads

FOLDER = next(f for f in KEPT if family_of(f) == "driven")
RUNS = 3


@lru_cache
def design():
    return read_design(FOLDER)


@lru_cache
def runs(share, sign):
    """Courses with disturbances at corners, a step of so much of the promised size from sample 30 on; with answers."""
    made = design()
    size = made.certificate["float32"]["faults"][0]["size"] * share * sign
    text = made.plant.text.replace('value = "0.2"', f'value = "{size!r}"').replace('"uniform"', '"corner"').replace(
        "from = 120, to = 150", "from = 30, to = 36").replace("steps = 200", "steps = 40").replace(
            ', [60.25, "shut"]]', "]")
    assert text.count("corner") == 5 and "from = 30" in text
    plant = loads(text)
    truths = [codegen.simulate(plant, "sensor fault", seed=seed) for seed in range(RUNS)]
    return truths, [made.observer.run(t.u, t.y, theta=t.theta, real="float32") for t in truths]


def lost(share, sign, cert):
    out = 0
    for truth, trace in zip(*runs(share, sign)):
        settled = np.arange(len(truth.q)) < 30
        out += missed("continuous", ("sensor",), cert, truth, trace, settled)
    return out


@pytest.mark.parametrize("sign", [1, -1])
def test_what_is_promised_is_found(sign):
    cert = design().certificate["float32"]
    (promise,) = cert["faults"]
    assert promise["within"] == 1 and promise["after"] == cert["dwell"] + cert["quiet"]
    assert 0.005 < promise["size"] < 0.02  # noise is 0.003 wide
    assert lost(1.0001, sign, cert) == 0
    # The promise is about these steps, and not an empty one: without the alarm it is broken in every run.
    truths, traces = runs(1.0001, sign)
    blind = [replace(t, raw_bits=0 * t.raw_bits) for t in traces]
    assert sum(missed("continuous", ("sensor",), cert, a, b, np.arange(len(a.q)) < 30)
               for a, b in zip(truths, blind)) == RUNS


@pytest.mark.parametrize("sign", [1, -1])
def test_a_promise_for_less_is_broken(sign):
    """A fifth of the size hides in the noise of some run: were that promised, validation would say so."""
    cert = design().certificate["float32"]
    wrong = cert | {"faults": [f | {"size": 0.2 * f["size"]} for f in cert["faults"]]}
    assert lost(0.2, sign, wrong) > 0 and lost(0.2, sign, cert) == 0


@pytest.mark.parametrize("key, change", [("size", lambda x: 0.99 * x), ("after", lambda x: x - 1),
                                         ("within", lambda x: x - 1)])
def test_tampering_is_caught(key, change):
    made = design()
    cert, t = made.certificate["float32"], made.observer.tables["float32"]
    wrong = cert | {"faults": [f | {key: change(f[key])} for f in cert["faults"]]}
    with pytest.raises(CertificateError, match="the fault sensor is claimed to be found"):
        mode_certificate.check(bounded(made.plant), t, wrong)


def test_more_noise_hides_more_and_children_count():
    """The size follows the noise; none is of a fault that no output sees, a larger one where children come of age."""
    made = design()
    cert, t, p = made.certificate["float32"], made.observer.tables["float32"], bounded(made.plant)
    claims, widths = mode_certificate.claims_on(p, t, cert), np.array(cert["widths"])
    size = cert["faults"][0]["size"]
    noisy = mode_certificate.claims_on(p, replace(t, v_lo=3 * t.v_lo, v_hi=3 * t.v_hi), cert)
    of = mode_faults.channel(p, t, 0)
    assert mode_faults.smallest(noisy, widths, cert["quiet"], of, 1)[0] > size + 0.004
    assert mode_faults.smallest(claims, widths, cert["quiet"], of, 1, limit=0.9 * size)[0] == np.inf
    neither = replace(of, seen=0 * of.seen)
    assert mode_faults.smallest(claims, widths, cert["quiet"], neither, 1)[0] == np.inf
    aged = mode_certificate.claims_on(p, replace(t, ages=1), cert)  # children come of age before they die
    assert mode_faults.smallest(aged, widths, cert["quiet"], of, 3)[0] > size


def test_the_header_says_so():
    text = (FOLDER / "valve.h").read_text()
    size = json.loads((FOLDER / "design.json").read_text())["certificate"]["float32"]["faults"][0]["size"]
    assert f'a step of the fault "sensor" of {size:.6g} or more' in " ".join(text.replace(" * ", " ").split())
