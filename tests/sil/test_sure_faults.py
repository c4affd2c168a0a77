"""What point observers promise to detect: no noise hides it from the firmware, and not much less can be hidden.

Noise is the best that a linear program finds against the very sets that the reference carries; the plant runs in
rational arithmetic. Every family of the committed designs, and small random plants of each kind.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.hiding import bounds_along, effects, hide, played
from helpers.points import VARIANTS, made

from codegen.algebra.dwell import fewest_samples
from codegen.analysis.detectability import surely_detected
from codegen.analysis.sure_faults import FOLLOWERS, by_sequence
from codegen.designs import read_design
from codegen.selection.point_sets import CHOICES
from codegen.selection.points import certified

ROOT = Path(__file__).parents[2]
COMMITTED = [p.parent.name for p in sorted((ROOT / "generated").glob("*/design.json"))
             if any(f'"family": "{family}"' in p.read_text() for family in FOLLOWERS)]
#: Small plants of the families that are followed; the other ones have bounds of their own.
SMALL = [name for name, (_, options) in VARIANTS.items() if options.get("set", "zonotope") in FOLLOWERS
         and options.get("tables", "dwell") == "dwell" and "smallest" not in name]
LENGTH, ONSET, WITHIN = 33, 30, 2


@cache
def design_of(name):
    return made(name) if name in VARIANTS else read_design(ROOT / "generated" / name)


def admitted(design):
    """Samples that a mode lasts at least where the promise holds."""
    plant, t = design.plant, design.observer.tables["float32"]
    own = fewest_samples(plant.switching, plant.sample_period, design.certificate["float32"])
    return max(own, getattr(t.shape, "dwell", 1))


def any_path(design, rng):
    """A mode sequence as fast as may be, and now and then slower."""
    path, dwell = [], admitted(design)
    while len(path) < LENGTH:
        q = int(rng.integers(design.plant.n_modes))
        if not path or q != path[-1] or design.plant.n_modes == 1:
            path += [q] * (dwell + int(rng.integers(2)))
    return path[:LENGTH]


def worst_path(design, found, channel, delay):
    """The mode sequence whose figure is the promise, after the modes in turn."""
    path = [int(q) for q in found.paths[found.sizes[channel, :, delay].argmax()]]
    path = path[-LENGTH:]
    dwell, before = admitted(design), []
    while len(before) < LENGTH:
        before = [q for q in range(design.plant.n_modes) for _ in range(dwell) if design.plant.n_modes > 1] + before
        before = before or [0] * LENGTH
    before += [path[0]] * dwell
    return (before + path)[-LENGTH:]


@pytest.mark.parametrize("name", [*COMMITTED, *SMALL])
def test_what_is_promised_cannot_be_hidden(name):
    """Steps of the promised size, and some 3 per cent below what can be hidden along the same sequence."""
    design, real = design_of(name), "float32"
    plant, t, rng = design.plant.enclosed, design.observer.tables[real], np.random.default_rng(len(name))
    found = by_sequence(plant, t, design.certificate[real], WITHIN)
    faults = surely_detected(plant, t, design.certificate[real], WITHIN)
    runs = []  # outputs, modes, delay, whether it has to alarm (None: must not)
    tight = []
    for channel, fault in enumerate(faults):
        known = [d for d in range(WITHIN + 1) if np.isfinite(fault.by_delay[d])]
        tries = [(worst_path(design, found, channel, d), d) for d in {known[0], known[-1]}]
        for path, delay in [*tries, (any_path(design, rng), known[-1])]:
            promised, last = fault.by_delay[delay], ONSET + delay + 1
            sets = bounds_along(design, real, path)[ONSET:last]
            G, r = effects(plant, t, path[:last], ONSET, channel)
            largest, z = hide(sets, G, r)
            assert largest <= promised * (1 + 1e-9), (channel, delay)
            tight.append(largest / promised)
            for size, noise, alarms in ((promised, hide(sets, G, r, promised)[1], True), (0.97 * largest, z, False)):
                y = np.zeros((LENGTH, plant.n_y), dtype=real)
                y[:last] = played(plant, path[:last], noise, ONSET, channel, size, real)
                runs.append((y, path, last, alarms))
    trace = design.observer.run_many(np.zeros((len(runs), LENGTH, plant.n_u)), np.array([y for y, *_ in runs]),
                                     np.array([path for _, path, *_ in runs]), real)
    for raw, (_, _, last, alarms) in zip(trace.raw_bits, runs):
        assert not raw[:ONSET].any(), "no alarm before the fault"
        assert bool(raw[ONSET:last].any()) == alarms
    assert max(tight) > (0.9 if design.observer.family != "thresholds" else 0.03)


def quiet(follower):
    """Half of the noise is left out."""
    follower.m = replace(follower.m, V=0.5 * follower.m.V, W=0.5 * follower.m.W)


def shrink(follower):
    """Rows of a table that are not the firmware's."""
    follower.h, follower.later = 0.7 * follower.h, 0.7 * follower.later


def narrow(follower):
    """Half widths that are not the firmware's."""
    follower.S, follower.rho = 0.7 * follower.S, 0.7 * follower.rho


def lighter(follower):
    """Noise of the residual that is not the firmware's."""
    follower.V = 0.1 * follower.V


def unweighted(follower):
    """The sum of two ellipsoids without the factor that makes it hold both."""
    follower.g = np.ones_like(follower.g)


@pytest.mark.parametrize("name,spoil", [("two outputs", quiet), ("ellipsoid", unweighted), ("table", shrink),
                                        ("box", narrow), ("trace", lighter)])
def test_a_bound_that_is_too_small_promises_too_much(name, spoil, monkeypatch):
    """Along the worst sequence more can be hidden than a spoilt bound says."""
    design, real = design_of(name), "float32"
    plant, t, cert = design.plant, design.observer.tables[real], design.certificate[real]
    sound, own, hidden = by_sequence(plant, t, cert, 1), FOLLOWERS[design.observer.family], []

    def spoilt(t):
        follower = own(t)
        spoil(follower)
        return follower

    monkeypatch.setitem(FOLLOWERS, design.observer.family, spoilt)
    claimed = by_sequence(plant, t, cert, 1).sizes.max(axis=1)
    for channel in range(plant.n_f):
        path, last = worst_path(design, sound, channel, 1), ONSET + 2
        sets = bounds_along(design, real, path)[ONSET:last]
        hidden.append(hide(sets, *effects(plant, t, path[:last], ONSET, channel))[0] / claimed[channel, 1])
    assert max(hidden) > 1.0


@pytest.mark.parametrize("name,within,most", [("zammali_ellipsoid_ellipsoid", 0, 0.063),
                                              ("zammali_zonotope_zonotope", 1, 0.0063)])
def test_promises_on_the_plants_of_the_thesis(name, within, most):
    """For any switching, rounding in single precision included: at the onset of 6.3.5, one sample later of 6.2.4."""
    design = design_of(name)
    assert all(fault["by_delay"][within] <= most for faults in design.detection.values() for fault in faults)


def test_a_zonotope_on_the_plant_of_6_3_5():
    """At most 0.058 at the onset with the gains of the ellipsoid, in double precision."""
    ellipsoid = design_of("zammali_ellipsoid_ellipsoid")
    t, plant = ellipsoid.observer.tables["float64"], ellipsoid.plant
    gains = {"L": t.L.astype(float), "N": t.N.astype(float), "kind": t.kind}
    gains |= CHOICES["zonotope"](plant, gains, {}, 1)
    found = surely_detected(plant, *certified(plant, gains, {"kind": "none"}, "float64"), 0)
    assert found[0].by_delay[0] <= 0.058
