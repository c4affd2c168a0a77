"""Figures of residual sets: the outlines are the sets, and the same figure is the same text."""

import re

import numpy as np
import pytest

from codegen.algebra import ellipsoid, zonotope
from codegen.analysis import set_plots
from codegen.analysis.svg import text

GENERATORS = np.array([[.9, .8, .35, .1, .2], [.4, .05, .81, .13, -.19]])


def area(points):
    x, y = points.T
    return (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2


def test_outlines_are_the_sets():
    G = np.r_[GENERATORS, [[1, 2, 3, 4, 5]]]
    assert area(set_plots.zonotope_outline(G)) == pytest.approx(zonotope.area(GENERATORS))
    R = np.diag([4.0, 9, 1])
    assert area(set_plots.ellipsoid_outline(R, (1, 2))) == pytest.approx(ellipsoid.area(np.diag([9.0, 1])), rel=2e-3)
    D = zonotope.normals(GENERATORS)  # all of them: the polytope is the zonotope; fewer: larger
    corners = set_plots.table_outline(zonotope.support(GENERATORS, D), D)
    assert area(corners) == pytest.approx(zonotope.area(GENERATORS))
    for count in (2, 4, 8, 16):
        D = zonotope.fan(count)
        h = zonotope.support(GENERATORS, D)
        corners = set_plots.table_outline(h, D)
        assert np.all(np.abs(corners @ D.T) <= h * (1 + 1e-9))
        assert area(corners) >= zonotope.area(GENERATORS) * (1 - 1e-9)
        assert np.all(np.max(np.abs(corners @ D.T), axis=0) >= h * (1 - 1e-9))  # supports: every direction is touched
    loose = set_plots.table_outline(np.array([1.0, 1.0, 50.0]), np.array([[1.0, 0], [0, 1], [1, 1]]))
    assert area(loose) == pytest.approx(4) and len(loose) == 4


def snapshots():
    sets = {"zonotope": set_plots.zonotope_outline(GENERATORS), "ellipsoid": set_plots.ellipsoid_outline(6 * np.eye(2))}
    return [set_plots.Snapshot("k = 3", sets, np.array([.5, -.2]), False),
            set_plots.Snapshot("k = 9", sets, np.array([3.5, 2.0]), True)]


def test_figures_are_text_that_does_not_change():
    time = np.arange(50) * .1
    curve = 1 + np.exp(-time)
    for make in (lambda: set_plots.sets_figure(snapshots(), ("r0 (m)", "r1 (m)")),
                 lambda: set_plots.area_figure(time, {"zonotope": curve, "ellipsoid": 2 * curve}),
                 lambda: set_plots.threshold_figure(time, curve, {"T2": 1.1 * curve, "T3": 1.2 * curve}, "r0 (m)"),
                 lambda: set_plots.order_figure([3, 5, 10], np.array([2, 1.5, 1.1]), np.array([3, 2, 1.2]),
                                                np.array([60, 120, 240]), "multiply-adds")):
        svg = text(make())
        assert svg == text(make()) and svg.startswith("<svg") and len(svg) < 60_000
        assert "nan" not in svg
    svg = text(set_plots.sets_figure(snapshots(), ("r0 (m)", "r1 (m)")))
    for word in ("zonotope", "ellipsoid", "residual", "outside: alarm", "k = 3", "k = 9", "r0 (m)"):
        assert word in svg
    assert "outside: alarm" not in text(set_plots.sets_figure(snapshots()[:1], ("r0", "r1")))
    assert len(re.findall("#D55E00", svg, re.I)) > len(re.findall("#D55E00", text(set_plots.sets_figure(
        snapshots()[:1], ("r0", "r1"))), re.I))


def test_the_residual_is_drawn_where_it_is():
    """Inside for the quiet snapshot, outside for the alarm: by the axes' own coordinates."""
    figure = set_plots.sets_figure(snapshots(), ("r0", "r1"))
    for axis, s in zip(figure.axes, snapshots()):
        line, patch = axis.lines[0], axis.patches[0]
        point = np.array([line.get_xdata()[0], line.get_ydata()[0]])
        assert np.array_equal(point, s.residual)
        assert patch.get_path().contains_point(point) == (not s.alarm) == zonotope.contains(GENERATORS, point)
        assert np.all(np.abs(point) < [axis.get_xlim()[1], axis.get_ylim()[1]])
