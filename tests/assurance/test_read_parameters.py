"""Banks whose weights read measured parameters: their bounds are stated, read back, and no other C is accepted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import small_banks
from helpers.table_numbers import every_number_of_a_bank

from codegen.assurance.claims import claims
from codegen.assurance.places import constants
from codegen.emit.package import firmware
from codegen.errors import CertificateError
from codegen.observers import BankObserver


@cache
def printed(layout, real="float32"):
    texts = firmware(small_banks.frozen(), real, layout)
    return texts["tanks.c"], texts["tanks.h"]


@pytest.mark.parametrize("real, layout", [("float32", "literal"), ("float64", "loop")])
def test_every_number_is_read(real, layout):
    d, found = small_banks.frozen(), {}
    for c in constants(d, real, layout, *printed(layout, real)):
        found |= {(c.name, c.mode, *e.index): e.value for e in c.entries}
    assert ("theta_lo", "", 0) in found
    every_number_of_a_bank(d.observer.tables[real], found)


CHANGED = (("in->theta[0] >= 0.19999999F", "in->theta[0] >= 0.19999998F"),
           ("in->theta[0] <= 0.70000005F", "in->theta[0] < 0.70000005F"),
           ("(in->theta[0] > 0.2F)", "(in->theta[0] > 0.3F)"), ("t2 ? in->theta[0]", "t2 ? in->u[0]"),
           ("status = TANKS_BAD_PARAMETER;", "status = TANKS_OK;"), ("!tanks_theta_accepted(in)", "false"))


@pytest.mark.parametrize("old, new", CHANGED)
def test_a_changed_c_is_refused(old, new):
    text, header = printed("table")
    assert text.count(old) == 1
    with pytest.raises(CertificateError, match="rint it again|Print the C again"):
        constants(small_banks.frozen(), "float32", "table", text.replace(old, new), header)


@pytest.mark.parametrize("end, change", [("", 0.0), ("theta_lo", 0.01), ("theta_hi", -0.01)])
def test_bounds_that_refuse_what_is_declared_are_no_claim(end, change):
    d = small_banks.frozen()
    t = d.observer.tables["float32"]
    t = replace(t, **{end: getattr(t, end) + np.float32(change)}) if end else t
    d = replace(d, observer=BankObserver({"float32": t}, d.observer.supervision))
    if end:
        with pytest.raises(CertificateError, match="accepted theta beyond the declared bounds"):
            claims(d, "float32")
        return
    stated = {c.id: c for c in claims(d, "float32")}
    assert len(stated["parameters"].margins) == 1 and stated["observer-0"].plant.count("signals.theta") == 1
