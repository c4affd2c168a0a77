"""Stand-in designs with random tables: every kind of C that emission can print, without any synthesis."""

import hashlib
import json
from dataclasses import dataclass, field

import numpy as np

from codegen.observers import FAMILIES, FramerTables, Supervision
from codegen.plant.model import Mode, Plant, Signal, Switching, Target


@dataclass(frozen=True)
class StandIn:
    """What emission needs of a Design."""

    plant: Plant
    method: str
    observer: object
    certificate: dict = field(default_factory=dict)
    digest: str = "c" * 64
    plant_sha256: str = "0" * 64
    options: dict = field(default_factory=dict)

    def claims(self, real):
        return [f"Nothing: the tables ({real}) are random numbers, made to test the emission of C."]

    def save(self, path):
        tables = {real: t.to_dict() for real, t in self.observer.tables.items()}
        data = {"plant": self.plant.name, "tables": tables, "supervision": self.observer.supervision.to_dict()}
        with open(path, "w", encoding="ascii", newline="\n") as f:
            f.write(json.dumps(data))


def framer_tables(rng, n_modes, n_x, n_u, n_y, *, shared=True, clamp=False, tnl=True, sparse=0.0, same=0.0):
    """Random tables for both types; ``sparse``: share of entries 0, 1 or -1; ``same``: share equal in all modes."""
    def matrix(rows, columns, scale=1.0, low=-1.0):
        values = rng.uniform(low, 1.0, (n_modes, rows, columns)) * scale
        special = rng.choice([0.0, 1.0, -1.0], size=values.shape) if low < 0 else np.zeros_like(values)
        values = np.where(rng.random(values.shape) < sparse, special, values)
        return np.where(rng.random((rows, columns)) < same, values[:1], values)

    def metzler():
        values = matrix(n_x, n_x, low=0.0)
        return 0.9 * rng.random() * values / np.maximum(values.sum(axis=2, keepdims=True), 1e-3)

    def pair(make):
        first = make()
        return first, first if shared else make()

    t = {}
    t["M_hi"], t["M_lo"] = pair(metzler)
    t["G_hi"], t["G_lo"] = pair(lambda: matrix(n_x, n_u, 0.2))
    t["L_hi"], t["L_lo"] = pair(lambda: matrix(n_x, n_y, 0.2))
    t["N_hi"], t["N_lo"] = pair(lambda: matrix(n_x, n_y, 0.2 if tnl else 0.0))
    t["A"], t["B"] = matrix(n_x, n_x, 0.5), matrix(n_x, n_u, 0.2)
    t["C"], t["D"] = matrix(n_y, n_x), matrix(n_y, n_u, 0.2)
    for name, n, scale in (("d", n_x, 0.5), ("a", n_x, 0.5), ("c", n_y, 4.0)):
        for sign, side in ((1, "hi"), (-1, "lo")):
            t[f"{name}_{side}"] = sign * rng.uniform(0.1, 1.0, (n_modes, n)) * scale
    for name, n, half in (("x", n_x, 8.0), ("x0", n_x, 1.0), ("u", n_u, 5.0), ("y", n_y, 10.0)):
        centre = rng.uniform(-0.5, 0.5, n)
        t[f"{name}_lo"] = centre - half * rng.uniform(0.5, 1, n)
        t[f"{name}_hi"] = centre + half * rng.uniform(0.5, 1, n)
    t["box"] = np.full(n_x, 1e3)
    return {real: FramerTables(real=real, clamp=clamp, **{k: v.astype(real) for k, v in t.items()})
            for real in ("float32", "float64")}


def plant_of(tables, prefix, real="float32", layout="table"):
    """A plant with the sizes and ranges of the tables."""
    t = tables["float64"]
    n_modes, n_y, n_x = t.C.shape

    def signals(stem, lo, hi):
        return tuple(Signal(f"{stem} {i} */ \"é\"", "m/s²" if i else "", float(a), float(b))
                     for i, (a, b) in enumerate(zip(lo, hi)))

    of_x, of_y = np.zeros((n_x, 1)), np.zeros((n_y, 1))
    modes = tuple(Mode(f"mode {q}", t.A[q], t.B[q], t.C[q], t.D[q], of_x, of_y, of_x, of_y, np.array([-0.1]),
                       np.array([0.1 * (q + 1)]), np.array([-0.1]), np.array([0.1])) for q in range(n_modes))
    return Plant(name=prefix, title="A stand-in", source="Nobody: A paper. https://example.org/a//b??/",
                 kind="discrete", sample_period=0.01, x=signals("state", t.x_lo, t.x_hi),
                 u=signals("same name", t.u_lo, t.u_hi), y=signals("output", t.y_lo, t.y_hi),
                 w=(Signal("gust", "N"),), v=(Signal("noise", "m"),), f=(), theta=(),
                 x0_lo=t.x0_lo, x0_hi=t.x0_hi, modes=modes, switching=Switching(), method="stand-in", options={},
                 target=Target(prefix, real, layout), scenarios=())


def stand_in(family="interval", sizes=(3, 3, 2, 2), supervision=None, seed=0, prefix=None, **options):
    """Make a stand-in; ``sizes`` are n_modes, n_x, n_u, n_y, ``options`` go to ``framer_tables``."""
    tables = framer_tables(np.random.default_rng(seed), *sizes, tnl=family == "tnl", **options)
    observer = FAMILIES[family](tables, supervision or Supervision())
    prefix = prefix or f"Obs_{family}"
    return StandIn(plant_of(tables, prefix), "stand-in", observer, digest=hashlib.sha256(prefix.encode()).hexdigest())


GUARDED = Supervision(debounce=(2, 3), latch=True, recover=4, hold=3, dwell_add=7, dwell_drain=2, dwell_limit=20)

VARIANTS = {  # keyword arguments of ``stand_in``: between them, every branch of the view and the templates
    "full": {},
    "smallest": {"sizes": (1, 1, 0, 1)},
    "guarded": {"supervision": GUARDED, "clamp": True, "same": 0.5},
    "unequal": {"shared": False, "supervision": Supervision(debounce=(2, 2), latch=False, recover=5, hold=0)},
    "sparse": {"sparse": 0.7, "same": 0.3, "supervision": Supervision(debounce=(1, 4), dwell_add=3, dwell_drain=1,
                                                                     dwell_limit=3)},
    "same modes": {"same": 1.0, "sizes": (2, 2, 1, 2), "supervision": Supervision(recover=1)},
    "unequal clamped": {"shared": False, "clamp": True, "sizes": (2, 2, 0, 3), "sparse": 0.3},
    "big": {"sizes": (4, 8, 3, 5)},
}
