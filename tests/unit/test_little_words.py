"""Guarantees that say little are called so, in the report and on the terminal; useful ones are not."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from codegen import show
from codegen.designs import read_design
from codegen.report.design_words import words_of
from codegen.report.little_words import TRY, warnings
from codegen.report.verdict import verdict

GENERATED = Path(__file__).resolve().parents[2] / "generated"


def claimed(design, monkeypatch) -> str:
    """What the terminal shows of a design."""
    page = io.StringIO()
    monkeypatch.setattr(show, "out", Console(file=page, highlight=False, soft_wrap=True, width=300))
    show.claims(design)
    return page.getvalue()


def with_ranges(design, vector: str, factor: float):
    """The same design for a plant that declares other ranges."""
    signals = tuple(replace(s, lo=factor * s.lo, hi=factor * s.hi) for s in getattr(design.plant, vector))
    return replace(design, plant=replace(design.plant, **{vector: signals}))


@pytest.mark.parametrize("name, vector, factor, words", [
    ("cart_tnl-interval", "x", 0.5, "nearly as wide as the declared range, or wider: speed 134"),
    ("cart_tnl-interval", "f", 0.1, "no step is surely detected that is smaller than this share"),
    ("digester_descriptor-fault-estimation", "f", 0.001, "what the faults do to an output is estimated"),
    ("pushed_hinf-filter", "f", 0.02, "without any fault an estimate may reach"),
    ("valve_lpv-interval", "f", 0.016, "no step is surely detected"),
])
def test_a_guarantee_that_says_little_is_called_so(name, vector, factor, words, monkeypatch):
    design = read_design(GENERATED / name)
    real = design.plant.target.real
    assert warnings(design, real) == () and "warning" not in claimed(design, monkeypatch)
    poor = with_ranges(design, vector, factor)
    found = warnings(poor, real)
    assert any(words in text for text in found) and found[-1] == TRY
    assert f"warning: {found[0]}" in claimed(poor, monkeypatch)
    assert verdict(poor, real, {}, []).warnings[-1] == TRY


@pytest.mark.parametrize("name", ["valve_lpv-interval", "pushed_hinf-filter", "valve_sliding_lpv-interval"])
def test_terminal_and_report_promise_the_fault_of_the_claim_or_none(name, monkeypatch):
    design = read_design(GENERATED / name)
    sure = design.certificate["float32"].get("faults", ())
    assert bool(sure) == (name != "valve_sliding_lpv-interval")
    page, found = claimed(design, monkeypatch), words_of(design, "float32")
    rows = [[getattr(cell, "text", cell) for cell in row.cells] for row in found.detection[0].rows]
    tiles = {f.term: f.text for f in verdict(design, "float32", {}, []).figures}
    if sure:
        least = min(sure, key=lambda f: f["size"])
        upto = f"to {show.number(least['upto'])}" if "upto" in least else "on"
        assert f"surely detected: from {show.number(least['size'])} {upto}, within {least['within']} sample" in page
        assert "while the mode stays, as above" in page and len(rows) == len(sure)
        ((term, size),) = tiles.items()
        assert term.startswith("smallest surely detected sensor fault, within") and "while the mode stays" in term
        assert size in [row[2].split()[0] for row in rows] and float(size) >= least["size"]
    else:
        assert "surely detected: not at any size" in page and rows[0][2] == "no size is promised"
        assert tiles == {"sensor: no fault surely detected": "none"}
    assert any("nothing watches that" in item for item in found.assumed)
    assert not any("thresholds" in item for item in found.not_guaranteed) or sure
    assert "sensor" not in [str(h) for h in found.choice.head]
