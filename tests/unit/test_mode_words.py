"""What is said of a mode estimator: by ``residua check`` before a design, and by the report of one."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.colors
import numpy as np
import pytest
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.folders import write  # noqa: E402
from helpers.small_modes import TEXT  # noqa: E402

from codegen import show, show_modes  # noqa: E402
from codegen.analysis import panels, plots  # noqa: E402
from codegen.analysis.mode_distinguishability import inapplicable  # noqa: E402
from codegen.analysis.replay import replay  # noqa: E402
from codegen.designs import read_design  # noqa: E402
from codegen.emit.manual import assumed  # noqa: E402
from codegen.host.build import build  # noqa: E402
from codegen.plant.load import load, loads  # noqa: E402
from codegen.plant.simulate import simulate  # noqa: E402
from codegen.report import firmware_words  # noqa: E402
from codegen.report.design_words import words_of  # noqa: E402

FOLDER = Path(__file__).resolve().parents[2] / "generated" / "zammali_modes_mode-set"


def told(plant) -> str:
    page = io.StringIO()
    show_modes.telling(plant, Console(file=page, highlight=False, soft_wrap=True, width=200))
    return page.getvalue()


def test_check_says_by_when_modes_differ():
    page = told(load("zammali_modes"))
    assert "1 / 2" in page and "4 (0.02 s)" in page and "1 (0.005 s)" in page and "nothing that" not in page
    whole = io.StringIO()
    console = Console(file=whole, highlight=False, soft_wrap=True, width=200)
    show_out, show.out = show.out, console
    try:
        show.plant(load("zammali_modes"))
    finally:
        show.out = show_out
    assert "telling modes apart" in whole.getvalue() and "the mode changes at any instant" in whole.getvalue()


def test_check_says_when_nothing_tells_them_apart():
    p = loads(TEXT)
    twins = replace(p, modes=(p.modes[0], replace(p.modes[0], name="twin")))
    page = told(twins)
    assert "not within 20" in page and "give the same measurements for 21 samples" in page
    assert "nothing that is declared tells them apart" not in told(p)
    hidden = told(load("press"))
    assert "some inputs hide a mode" in hidden


@pytest.mark.parametrize("name, words", [("buck", "has parameters"), ("lamouchi", None)])
def test_check_says_what_it_does_not_test(name, words):
    page = told(load(name))
    assert (words in page and "not tested" in page) if words else page == ""
    p = loads(TEXT)
    assert inapplicable(p) is None
    assert 'signals.x "level" has no range' in inapplicable(replace(p, x=(replace(p.x[0], hi=np.inf), p.x[1])))


def test_a_log_needs_no_mode_column(tmp_path):
    design = read_design(FOLDER)
    run = simulate(design.plant, "sensor fault")
    rows = "".join(f"{u[0]},{y[0]}\n" for u, y in zip(run.u, run.y))
    (tmp_path / "log.csv").write_text("u,y\n" + rows)
    folder = write(design, tmp_path / "c")
    result = replay(design, build(folder), tmp_path / "log.csv", tmp_path / "out")
    lines = [line.split(",") for line in result.bounds.read_text().splitlines()]
    assert lines[0][-4:] == ["mode", "mode_set", "settled_set", "age"] and len(lines) == 201
    assert {line[-4] for line in lines[20:60]} == {"2"} and {line[-4] for line in lines[70:110]} == {"0"}
    assert any(line[lines[0].index("alarm")] == "1" for line in lines[120:])


def test_report_states_the_delays():
    design = read_design(FOLDER)
    cert = design.certificate["float32"]
    found = words_of(design, "float32")
    (table,) = found.bounds
    cells = [[getattr(c, "text", c) for c in row.cells] for row in table.rows]
    assert len(cells) == 7 and cells[0][:2] == ["1", "2"]
    assert cells[0][3].startswith(f"{cert['identified'][0][1]} samples") and cells[-1][0] == "power-up"
    facts = {f.term: f.text for f in found.facts}
    assert "a mode that nobody tells" in facts["Proved for"] and "fewest that can be certified" in facts["Criterion"]
    assert any("nobody tells its mode" in item for item in found.assumed)
    assert len(firmware_words.gains(design, "float32")) == 4
    lines = " ".join(assumed(design, design.observer.tables["float32"], False))
    assert "one of its modes active at any instant" in lines and "in->mode" not in lines
    assert "in->mode" not in (FOLDER / "zammali_modes.h").read_text() + (FOLDER / "zammali_modes.c").read_text()


def test_comparison_has_the_estimator_once():
    from codegen.compare import dwell_of, variants

    assert [v.options for v in variants() if v.method == "mode-set"] == [{}]
    design = read_design(FOLDER)
    assert dwell_of(design) == design.certificate["float32"]["ages"] + 1 == 7


def bars(axis, colour: str) -> list:
    """Rows and times of the bars of one colour, (row, from, to)."""
    return [(round(box.y0 + box.height / 2), box.x0, box.x1) for c in axis.collections
            if matplotlib.colors.to_hex(c.get_facecolor()[0]) == colour.lower() for box in
            (path.get_extents() for path in c.get_paths())]


def test_true_possible_and_decided_modes_are_drawn():
    design = read_design(FOLDER.parent / "valve_lpv-interval")
    truth = simulate(design.plant, design.plant.scenarios[0].name)
    trace = design.observer.run(truth.u, truth.y, theta=truth.theta)
    run = plots.whole(design.plant, truth, trace)

    def strip(shown):
        (axis,) = (a for a in plots.residual_figure(shown).axes if a.get_title(loc="left").startswith("Mode: "))
        return axis

    axis, period = strip(run), design.plant.sample_period
    possible, true = bars(axis, panels.BAND), bars(axis, panels.MODE)
    assert len(true) >= 2 and len(possible) >= len(true)
    assert all(any(a == row and b <= start + 1e-9 and stop - 1e-9 <= c for a, b, c in possible)
               for row, start, stop in true)
    assert np.array_equal(axis.lines[0].get_ydata(), trace.mode) and axis.lines[0].get_xdata()[1] == period
    # A set without the true mode shows as dark beside light; a record has no true mode to be drawn.
    lost = strip(replace(run, trace=replace(trace, mode_set=trace.mode_set & ~np.uint32(1))))
    assert not any(row == 0 for row, *_ in bars(lost, panels.BAND)) and bars(lost, panels.MODE) == true
    record = strip(replace(run, truth=replace(truth, x=np.full_like(truth.x, np.nan))))
    assert not bars(record, panels.MODE) and "true" not in record.get_title(loc="left")
