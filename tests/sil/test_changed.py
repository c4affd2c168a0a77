"""Other coordinates, gains of the user, two modes, three states: C == reference, and the box that a caller gives."""

import numpy as np
import pytest
from helpers.folders import built
from helpers.varying import changed_design
from test_gallery import signals

from codegen.observers import FramerTables

LAYOUTS = ("literal", "table", "loop")


@pytest.fixture(scope="module")
def design():
    return changed_design()


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_every_layout_equals_the_reference(design, real, tmp_path):
    u, y, q, theta = signals(design.plant, real)
    reference = design.observer.run_many(u, y, q, real)
    assert reference.raw_bits.any() and reference.assured.any() and {0, 1, 3} <= set(np.unique(reference.status))
    for layout in LAYOUTS:
        driver = built(design, tmp_path / layout, real, layout)
        assert driver.run_many(u, y, q).differs(reference) == [], layout


def test_another_initial_box(design, tmp_path):
    """The box of z follows that of x; with the plant file's box of z in its place the bounds would be others."""
    driver = built(design, tmp_path / "box")
    u, y, q = np.ones((9, 1)), np.zeros((9, 2)), np.zeros(9, dtype=int)
    plain = driver.run(u, y, q)
    for box in ({"x0_lo": [-5, -4, -3], "x0_hi": [4, 5, 6]}, {"x0_hi": [4, 5, 6]}):
        trace = driver.run(u, y, q, **box)
        assert trace.differs(design.observer.run(u, y, q, **box)) == []
        assert np.all((trace.x_hi - trace.x_lo)[1] > (plain.x_hi - plain.x_lo)[1])


def test_stored_coordinates_read_back(design):
    for real, t in design.observer.tables.items():
        again = FramerTables.from_dict(t.to_dict(), (2, 3, 1, 2))
        assert all(np.array_equal(getattr(again.change, k), getattr(t.change, k)) for k in vars(t.change)), real
