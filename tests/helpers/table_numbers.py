"""Whether all numbers of tables are among those that were read back from the C."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np


def every_number_of_the_family(t, found, modes):
    """All arrays of the tables but S and the ranges of x where the C has none; of pairs of modes no diagonal.

    Of a polytopic observer the constants of its weights and all numbers of a law beside it too.
    """
    by_mode, checked = {key[0] for key in found if key[1]}, 0
    own = vars(t)
    if hasattr(t, "weights"):
        own = own | {"weights": np.array(t.weights.constants)}
    if getattr(t, "uneven", False):
        own = own | {"least_pivot": np.array(t.least_pivot)}
    if getattr(t, "law", None) is not None:
        own = own | vars(t.law) | {"period": np.array(t.law.period)}
    for name, value in own.items():
        there = name in {key[0] for key in found}
        if not isinstance(value, np.ndarray) or (name in ("S", "x_lo", "x_hi", "x0_lo", "x0_hi") and not there):
            continue
        if not there and not np.any(value if name != "pivot" else value - 1):
            continue  # a product with zeros alone is left out, and one with pivots that are all 1
        for index, v in np.ndenumerate(value):
            if name.startswith(("J", "birth")) and index[0] == index[1]:
                continue
            key = (modes[index[0]], *index[1:]) if name in by_mode else ("", *index)
            assert found[name, *key] == float(v), (name, index)
            checked += 1
    assert checked == len(found)


def every_number_of_framers(t, found, modes, gains, names):
    """Gains, open loop, parameters of framers that are told their mode; returns what it looked at."""
    checked = set()
    for name in (*(f"{g}_{s}" for g in gains for s in ("hi", "lo")), *names):
        stem = name if any(key[0] == name for key in found) else name[0]  # both framers have the same one
        for (q, *index), value in np.ndenumerate(getattr(t, name)):
            assert found[stem, modes[q], *index] == float(value), (name, q, index)
            checked.add((stem, modes[q], *index))
    for name, label in (() if t.vary is None else (*((k, f"{k}_theta") for k in "MGL"), *((k, k) for k in (
            "R", "S", "E", "Ra", "Sa", "theta_lo", "theta_hi")))):
        for (q, *index), value in np.ndenumerate(getattr(t.vary, name)):
            assert found[label, modes[q], *index] == float(value), (name, q, index)
            checked.add((label, modes[q], *index))
    for name in () if t.change is None else ("Z", "X", "e_hi", "e_lo", "b_hi", "b_lo", "z_lo", "z_hi"):
        stem = name if any(key[0] == name for key in found) else name[0]
        for index, value in np.ndenumerate(getattr(t.change, name)):
            for key in [(stem, mode, *index) for mode in ("", *modes) if (stem, mode, *index) in found]:
                assert found[key] == float(value), key
                checked.add(key)
    assert t.change is None or {"Z", "X", "z_lo"} <= {key[0] for key in checked}
    return checked


def every_number_of_driven(t, found, modes):
    """Those of the framers, of the estimator, and of what joins them; beside it weights of the parameters."""
    checked = every_number_of_framers(t.told, found, modes, "MGLNd", ("A", "B", "a_hi", "a_lo"))
    rest = {k: v for k, v in found.items() if k not in checked and k[0] != "theta_weight"}
    own = {k: v for k, v in vars(t).items() if k not in ("S", "S_rounded", "told")}
    joint = {"frame_limit": t.told.box, "forth": t.S_rounded}
    every_number_of_the_family(SimpleNamespace(**own, **joint), rest, modes)


def every_number_of_guided(t, found, modes):
    """Those of the framers, each by the name that keeps it apart, and of the estimator."""
    of_framers = {key for key in found if key[0].startswith(("told_", "theta"))}
    told = {(key[0].removeprefix("told_"), *key[1:]): found[key] for key in of_framers}
    checked = every_number_of_framers(t.told, told, modes, "MGLNd", (*"ABCD", "a_hi", "a_lo", "c_hi", "c_lo"))
    for name in ("x_lo", "x_hi"):
        for (i,), value in np.ndenumerate(getattr(t.told, name)):
            assert told[name, "", i] == float(value)
            checked.add((name, "", i))
    assert {key for key in told if key[0] != "theta_weight"} == checked
    every_number_of_the_family(SimpleNamespace(**{k: v for k, v in vars(t).items() if k != "told"}), {
        key: v for key, v in found.items() if key not in of_framers}, modes)


def every_number_of_follower(t, found, modes):
    """Those of the observer that is told its mode, of the estimator, and of what joins them."""
    told = {(key[0].removeprefix("told_"), *key[1:]): v for key, v in found.items() if key[0].startswith("told_")}
    every_number_of_a_set(t.told, told, modes, ("box",))
    own = {k: v for k, v in vars(t).items() if k not in ("S", "S_rounded", "told") and (k != "square" or t.by_squares)}
    joint = {"forth": t.S_rounded, "widest": t.widest}
    every_number_of_the_family(SimpleNamespace(**own, **joint), {
        key: v for key, v in found.items() if not key[0].startswith("told_")}, modes)


def every_number_of_guided_point(t, found, modes):
    """Those of the observer that is told its mode, and of the estimator; of a table what its start must hold."""
    told = {(key[0].removeprefix("told_"), *key[1:]): v for key, v in found.items() if key[0].startswith("told_")}
    every_number_of_a_set(t.told, told, modes, ("box",))
    own = {k: v for k, v in vars(t).items() if k != "told"} | ({"widest": t.widest} if t.by_table else {})
    every_number_of_the_family(SimpleNamespace(**own), {
        key: v for key, v in found.items() if not key[0].startswith("told_")}, modes)


OF_FILTERS = ("M", "G", "L", "K", "Du", "Dy", "h", "limit")


def every_number_of_trailing(t, found, modes, own=None, of_a_start=("E", "sizes", "grow", "floor")):
    """Those of the filters, each by the name that keeps it apart, and of the estimator, which are ``own``."""
    told = {(key[0].removeprefix("told_"), *key[1:]): v for key, v in found.items() if key[0].startswith("told_")}
    of_filters = {k: getattr(t.told, k) for k in (*OF_FILTERS, *of_a_start)}
    every_number_of_the_family(SimpleNamespace(**of_filters), told, modes)
    every_number_of_the_family(SimpleNamespace(**{k: v for k, v in (own or vars(t)).items() if k != "told"}), {
        key: v for key, v in found.items() if not key[0].startswith("told_")}, modes)


def every_number_of_guided_filter(t, found, modes):
    """The same; where a filter starts is the C's, what that was made of is not."""
    every_number_of_trailing(t, found, modes, vars(t) | {"begun": t.begun}, ())


def every_number_of_a_bank(t, found):
    """All numbers of all members, thresholds, limits, weights and ranges of the input check, and none beside."""
    expected = {("rate", ""): t.rate} | {("weights", "", k): c for k, c in enumerate(t.weights.constants)}
    parts = [(f"{name}_{k}", getattr(m, name)) for k, m in enumerate(t.members)
             for name in ("T2", "C", "F", "G", "K", "M", "z0")]
    for name, value in (*parts, *((k, getattr(t, k)) for k in (
            "bound", "limit", "most", "u_lo", "u_hi", "y_lo", "y_hi", "theta_lo", "theta_hi"))):
        expected |= {(name, "", *index): float(v) for index, v in np.ndenumerate(value)}
    for key in [k for k in expected if k[0] == "weights" and k not in found]:
        assert not expected.pop(key)  # zeros are many
    assert found == expected


def every_number_of_a_set(t, found, modes, beside=("box", "u_lo", "u_hi", "y_lo", "y_hi")):
    """Estimate, set, box and input checks, each entry with its value; fields with equal numbers have one name."""
    stems = {key[0] for key in found}
    printed = [k for k in vars(t.shape) if k not in getattr(t.shape, "unprinted", ())]
    for name in (*"MGLNdABaCDc", *beside, *printed):
        value = getattr(t.shape, name) if name in vars(t.shape) else getattr(t, name)
        stem = f"{name} of the set" if name in vars(t) and name in vars(t.shape) else name
        if stem not in stems or not isinstance(value, np.ndarray):
            same = [v for k, v in vars(t.shape).items() if k != name and k in stems and np.array_equal(v, value)]
            # Whole numbers are compared with the C's text, directions beyond the outputs there may be none.
            alone = ("floor", "slack") * (len(t.y_lo) == 1)  # of the test of several residuals together
            assert same or not isinstance(value, np.ndarray) or name in ("directions", "N", *alone) or not np.any(
                value), name
            continue
        beyond = t.C.shape[1] if name == "directions" and (name, "", 0, 0) not in found else 0
        square = value.ndim >= 3 and value.shape[-2] == value.shape[-1]
        symmetric = square and np.array_equal(value, value.swapaxes(-2, -1))
        for index, v in np.ndenumerate(value):
            if index and index[0] < beyond:
                continue  # the first directions are the outputs themselves
            if symmetric and index[-1] > index[-2] and not any(
                    (stem, *key) in found for key in (("", *index), (modes[index[0]], *index[1:]))):
                continue  # the C has the lower triangle, each entry of which is looked for
            mode = (modes[index[0]], *index[1:]) if index and (name, modes[0], *index[1:]) in found and (
                stem == name) else ("", *index)
            assert found[stem, *mode] == float(v), (name, index)
