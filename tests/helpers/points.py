"""Certified point observers for small random plants: real tables, real certificates, no solver."""

from dataclasses import replace
from functools import cache

import numpy as np

from codegen.designs import Design
from codegen.observers import FAMILIES, Supervision
from codegen.plant.model import Mode, Plant, Signal, Switching, Target
from codegen.selection.points import certified, choice_of
from helpers.designs import GUARDED


def random_plant(sizes=(3, 3, 1, 2), seed=0, noises=(2, 2), noise=0.01, name="pt", schedule=()):
    """Stable modes, bounds that are not symmetric, states and outputs in ranges that hold them; one fault on each."""
    n_modes, n_x, n_u, n_y = sizes
    n_w, n_v = noises
    rng = np.random.default_rng(seed)

    def matrix(*shape):
        return np.round(rng.uniform(-1, 1, shape), 3)

    C, Dv, Df = matrix(n_y, n_x), matrix(n_y, n_v), np.concatenate([np.zeros((n_y, 1)), matrix(n_y, 1)], axis=1)
    modes = []
    for q in range(n_modes):
        A = matrix(n_x, n_x)
        A = np.round(0.6 * A / max(np.abs(A).sum(axis=1).max(), 1e-3), 4)
        D = np.zeros((n_y, n_u))
        Bf = np.concatenate([matrix(n_x, 1), np.zeros((n_x, 1))], axis=1)
        half = noise * rng.uniform(0.5, 1.5, n_w)
        modes.append(Mode(f"mode {q}", A, matrix(n_x, n_u), C, D, matrix(n_x, n_w), Dv, Bf, Df, -half, 1.5 * half,
                          np.full(n_v, -noise), np.full(n_v, noise * (1.2 + 0.1 * q))))

    def signals(stem, n, size):
        return tuple(Signal(f"{stem}{i}", "", -size, size) for i in range(n))

    return Plant(name=name, title="Random plant", source="own example", kind="discrete", sample_period=1.0,
                 x=signals("x", n_x, 5.0), u=signals("u", n_u, 0.3), y=signals("y", n_y, 20.0),
                 w=signals("w", n_w, noise),
                 v=signals("v", n_v, noise), f=(Signal("actuator", "", -1.0, 1.0), Signal("sensor", "", -1.0, 1.0)),
                 theta=(), x0_lo=np.full(n_x, -0.1), x0_hi=np.full(n_x, 0.2), modes=tuple(modes),
                 switching=Switching(schedule=schedule), method="zonotope", options={},
                 target=Target(name, "float32", "table"), scenarios=())


def gains_of(plant, kind):
    """A fifth of what places everything at zero: stable because the plant is."""
    N = np.array([(0.2 if kind == "tnl" else 0.0) * np.linalg.pinv(m.C) for m in plant.modes])
    L = np.array([0.2 * (np.eye(plant.n_x) - n @ m.C) @ m.A @ np.linalg.pinv(m.C) for n, m in zip(N, plant.modes)])
    return {"L": L, "N": N, "kind": kind}


def point_design(plant, kind="luenberger", supervision=None, dwell=1, turn=None, reduction=None, **options):
    """Freeze and certify both number types; ``turn``: coordinates of a box, ``reduction``: how to reduce a zonotope."""
    gains = gains_of(plant, kind)
    gains |= choice_of(options, "zonotope")(plant, gains, options, dwell)
    if turn is not None:
        gains |= {"coordinates": np.array(turn, dtype=float), "limit": 8 * gains["limit"]}
    if reduction is not None:
        gains["reduction"] |= reduction
    made = {real: certified(plant, gains, {"kind": "none"}, real) for real in ("float32", "float64")}
    family = made["float32"][1]["set"]
    observer = FAMILIES[family]({real: t for real, (t, _) in made.items()}, supervision or Supervision())
    return Design(plant, family, observer, {real: cert for real, (_, cert) in made.items()},
                  {real: ["own words"] for real in made}, {real: [] for real in made})


def in_turn(design, q, every=1):
    """The same modes, every so many runs those of the plant's schedule if it has one, some samples out of turn."""
    cycle = design.plant.switching.schedule
    if not cycle:
        return q
    rng, out = np.random.default_rng(1), np.array(q)
    for run in range(0, len(q), every):
        turn = np.resize(np.roll(cycle, -rng.integers(len(cycle)) * (run % 3)), q.shape[1])
        out[run] = np.where(rng.random(q.shape[1]) < 0.02, q[run], turn)
    return out


def changed(design, real="float32", shape=None, **tables):
    """The same design with other numbers in its tables, not certified."""
    t = design.observer.tables[real]
    t = replace(t, shape=replace(t.shape, **(shape or {})), **tables)
    observer = type(design.observer)({**design.observer.tables, real: t}, design.observer.supervision)
    return replace(design, observer=observer)


VARIANTS = {  # plant, then arguments of ``point_design``: between them every branch of the view and the templates
    "two outputs": ({}, {"kind": "luenberger", "order": 6}),
    "gain on the new output": ({"seed": 1}, {"kind": "tnl", "supervision": GUARDED}),
    "smallest": ({"sizes": (1, 1, 0, 1), "noises": (1, 1)}, {"kind": "luenberger", "order": 2}),
    "no sensor noise": ({"sizes": (2, 2, 1, 1), "noises": (2, 0), "seed": 2}, {"kind": "tnl", "order": 5}),
    "three outputs": ({"sizes": (2, 3, 1, 3), "noises": (1, 2), "seed": 11}, {"kind": "tnl", "order": 5}),
    "other coordinates": ({"seed": 12}, {"kind": "tnl", "order": 6, "reduction": {
        "key": "girard", "coordinates": np.random.default_rng(0).normal(size=(3, 3, 3)) / 8 + np.eye(3)}}),
    "girard": ({"seed": 13}, {"kind": "luenberger", "order": 5, "reduction": {"key": "girard"}}),
    "four outputs": ({"sizes": (2, 4, 2, 4), "noises": (1, 4), "seed": 3},
                     {"kind": "tnl", "order": 9, "supervision": Supervision(debounce=(1, 4), latch=False, recover=3)}),
    "table": ({"seed": 5}, {"kind": "tnl", "tables": "dwell", "dwell": 3, "rows": 4, "stages": 3}),
    "table of one mode": ({"sizes": (1, 2, 1, 1), "seed": 6}, {"kind": "luenberger", "tables": "dwell", "rows": 6}),
    "table, four outputs": ({"sizes": (2, 4, 0, 4), "noises": (1, 4), "seed": 3},
                            {"kind": "luenberger", "tables": "dwell", "rows": 5, "supervision": GUARDED}),
    "schedule": ({"seed": 5, "schedule": (0, 0, 1, 1, 1)}, {"kind": "tnl", "tables": "schedule", "rows": 4}),
    "schedule of one mode": ({"sizes": (1, 2, 1, 1), "seed": 6, "schedule": (0,)},
                             {"kind": "luenberger", "tables": "schedule", "rows": 2, "supervision": GUARDED}),
    "blocks": ({"seed": 5}, {"kind": "tnl", "tables": "arbitrary", "rows": 4, "order": 5}),
    "blocks of one mode": ({"sizes": (1, 2, 1, 1), "seed": 6},
                           {"kind": "tnl", "tables": "arbitrary", "rows": 3, "order": 4}),
    "blocks, four outputs": ({"sizes": (2, 4, 0, 4), "noises": (1, 4), "seed": 3},
                             {"kind": "luenberger", "tables": "arbitrary", "rows": 2, "order": 6}),
    "ellipsoid": ({"seed": 8}, {"kind": "tnl", "set": "ellipsoid"}),
    "ellipsoid, one output": ({"sizes": (1, 2, 0, 1), "noises": (1, 1), "seed": 6},
                              {"kind": "luenberger", "set": "ellipsoid", "supervision": GUARDED}),
    "ellipsoid, four outputs": ({"sizes": (2, 4, 2, 4), "noises": (1, 4), "seed": 3},
                                {"kind": "luenberger", "set": "ellipsoid"}),
    "trace": ({"seed": 8}, {"kind": "tnl", "set": "ellipsoid", "weights": "trace"}),
    "trace, one output": ({"sizes": (1, 2, 0, 1), "noises": (1, 1), "seed": 6},
                          {"kind": "luenberger", "set": "ellipsoid", "weights": "trace", "supervision": GUARDED}),
    "trace, four outputs": ({"sizes": (2, 4, 2, 4), "noises": (1, 4), "seed": 3},
                            {"kind": "luenberger", "set": "ellipsoid", "weights": "trace"}),
    "box": ({"seed": 10}, {"kind": "tnl", "set": "interval", "supervision": GUARDED}),
    "box, turned": ({"seed": 8}, {"kind": "tnl", "set": "interval",
                                  "turn": [[1, 0.3, 0], [-0.2, 1, 0.4], [0.1, 0, 0.7]]}),
    "box, one output": ({"sizes": (1, 2, 0, 1), "noises": (1, 0), "seed": 6}, {"kind": "luenberger",
                                                                               "set": "interval"}),
    "one mode": ({"sizes": (1, 3, 1, 2), "seed": 4}, {"kind": "tnl", "order": 8}),
}


@cache
def made(variant):
    """The certified design of one of these."""
    plant, options = VARIANTS[variant]
    return point_design(random_plant(**plant), **options)


#: Sizes of ``random_plant()``, with everything that a plant file must have; two modes, gains given.
TOML = """
format = 1
name = "pt"
title = "Small plant"
source = "own example"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "a", range = [-5, 5] }, { name = "b", range = [-5, 5] }, { name = "c", range = [-5, 5] }]
u = [{ name = "u", range = [-0.3, 0.3] }]
y = [{ name = "y0", range = [-20, 20] }, { name = "y1", range = [-20, 20] }]
w = [{ name = "w", bounds = [-0.01, 0.02] }]
v = [{ name = "v0", bounds = [-0.01, 0.01] }, { name = "v1", bounds = [-0.01, 0.01] }]
f = [{ name = "sensor", range = [-3, 3] }]
[initial]
x_lo = [-0.1, -0.1, -0.1]
x_hi = [0.1, 0.2, 0.1]
[common]
C = [[1, 0, 0.5], [0, 1, 0]]
Dv = [[1, 0], [0, 1]]
Df = [[1], [0]]
Bw = [[1], [0], [0.5]]
B = [[0], [1], [0]]
[[mode]]
name = "one"
A = [[0.5, 0.1, 0], [0, 0.4, 0.1], [0.1, 0, 0.3]]
[[mode]]
name = "two"
A = [[0.3, 0, 0.1], [0.1, 0.5, 0], [0, 0.1, 0.4]]
[[mode]]
name = "three"
A = [[0.3, 0, 0.1], [0.1, -0.5, 0], [0, 0.1, 0.4]]
[switching]
minimum_dwell = 0.3
[observer]
method = "zonotope"
gains = { L = [[[0.1, 0], [0, 0.1], [0, 0]], [[0.1, 0], [0, 0.1], [0, 0]], [[0.1, 0], [0, 0.1], [0, 0]]] }
[[scenario]]
name = "no fault"
steps = 60
mode = { every = 3, order = ["one", "two", "three"] }
u = ["0.3"]
w = "corner"
v = "corner"
[[scenario]]
name = "sensor"
steps = 80
mode = { every = 4, order = ["two", "one"] }
u = ["0"]
fault = [{ channel = "sensor", from = 60, to = 70, value = "2" }]
"""
