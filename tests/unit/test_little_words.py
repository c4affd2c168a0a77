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
    size = getattr(found.detection[0].rows[0].cells[2], "text", None)
    tiles = {f.term: f.text for f in verdict(design, "float32", {}, []).figures}
    if name == "pushed_hinf-filter":
        assert "surely detected: from 0.04785 to 0.6084, within 3 samples while the mode stays" in page
        assert size == "0.04786 to 0.608" and len(found.detection[0].rows) == 2
    elif sure:
        assert "surely detected: from 0.01574 on, within 1 sample while the mode stays" in page
        assert size == "0.01575" and tiles["smallest surely detected sensor fault, within 1 sample (50 ms) while the "
                                           "mode stays".replace(" ms", "\u202fms")] == size
    else:
        assert "surely detected: not at any size" in page and size == "no size is promised"
        assert tiles == {"sensor: no fault surely detected": "none"}
    assert any("nothing watches that" in item for item in found.assumed)
    assert not any("thresholds" in item for item in found.not_guaranteed) or sure
    assert "sensor" not in [str(h) for h in found.choice.head]
