"""From matplotlib figures to small SVG text, the same bytes every time; and which samples to draw."""

from __future__ import annotations

import re
from io import StringIO

import matplotlib
import numpy as np
from matplotlib.figure import Figure

Array = np.ndarray

STYLE = {
    "svg.hashsalt": "residua", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9.5,
    "font.sans-serif": ["DejaVu Sans"], "axes.spines.top": False, "axes.spines.right": False,
    "axes.linewidth": 0.7, "axes.edgecolor": "#444444", "axes.titlesize": 9.5, "axes.titlelocation": "left",
    "axes.formatter.useoffset": False, "axes.unicode_minus": True, "xtick.major.width": 0.7,
    "ytick.major.width": 0.7, "legend.frameon": False, "legend.fontsize": 8.5, "path.simplify": False,
}


def style():
    """Return the context in which figures are made and printed; no global setting is changed for good."""
    return matplotlib.rc_context({**matplotlib.rcParamsDefault, "backend": "svg", **STYLE})


def text(figure: Figure) -> str:
    """Print a figure as SVG.

    Parameters
    ----------
    figure : Figure
        Made within ``style()``.

    Returns
    -------
    svg : str
        From ``<svg`` on: no date, no metadata, no name that is not referred to, coordinates to a tenth of a point.
    """
    out = StringIO()
    with style():
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    svg = out.getvalue()
    svg = svg[svg.index("<svg"):]
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, flags=re.S)
    svg = re.sub(r'(?<= d=")[^"]*', lambda m: re.sub(r"(\.\d)\d+", r"\1", m[0]).replace("\n", ""), svg)
    return _rename(svg)


def standalone(figure: Figure) -> str:
    """Print a figure as a file of its own, on white.

    Parameters
    ----------
    figure : Figure

    Returns
    -------
    text : str
        XML.
    """
    return '<?xml version="1.0" encoding="utf-8"?>\n' + text(figure)


def _rename(svg: str) -> str:
    """Number the names that something refers to and drop the others: matplotlib derives some from addresses."""
    used = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    order = [name for name in dict.fromkeys(re.findall(r'\bid="([^"]+)"', svg)) if name in used]
    short = {name: f"r-{i}" for i, name in enumerate(order)}
    svg = re.sub(r' id="([^"]+)"', lambda m: f' id="{short[m[1]]}"' if m[1] in short else "", svg)
    return re.sub(r'((?:href="|url\()#)([^")]+)', lambda m: m[1] + short[m[2]], svg)


def pick(curves: Array, buckets: int) -> Array:
    """Choose samples that look like all of them: every bucket keeps the extremes of every curve.

    Parameters
    ----------
    curves : ndarray (K, n)
        NaN is a gap; one of each bucket's gaps is kept.
    buckets : int

    Returns
    -------
    index : ndarray (n,) int
        Ascending; all K where there are at most four samples per bucket.
    """
    steps = len(curves)
    if steps <= 4 * buckets:
        return np.arange(steps)
    keep = {0, steps - 1}
    for part in np.array_split(np.arange(steps), buckets):
        values = curves[part]
        gap = np.isnan(values)
        keep.update(part[np.argmin(np.where(gap, np.inf, values), axis=0)].tolist())
        keep.update(part[np.argmax(np.where(gap, -np.inf, values), axis=0)].tolist())
        if gap.any():
            keep.add(int(part[np.argmax(gap.any(axis=1))]))
    return np.array(sorted(keep))


def stretches(on: Array, longest: int = 500) -> list[tuple[int, int]]:
    """Find the stretches [start, stop) in which a flag is set.

    Stretches that a drawing of ``longest`` columns could not tell apart are drawn as one: the flag is then
    shown set where it is set at any sample of the column.

    Parameters
    ----------
    on : ndarray (K,) bool
    longest : int

    Returns
    -------
    list of (int, int)
    """
    size = -(-len(on) // longest)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    merged: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist()):
        if merged and size > 1 and start - merged[-1][1] < size:
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return merged
