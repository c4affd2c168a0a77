"""The true plant in exact rational arithmetic, and the signals that press hardest against a framer.

The numbers of a plant file are float64, that is, exact rationals. Here the plant is simulated with them
without any rounding; the firmware gets the nearest float of every y and u, while the physical u acts
unrounded. Written without ``codegen.analysis`` and ``codegen.certify``, whose claims it is to test.
"""

from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_mat

#: Gallery plants of the interval families, with the methods under test.
GALLERY = (("zammali_fd", "interval"), ("zammali_fd", "tnl-interval"), ("cart", "tnl-interval"),
           ("press", "tnl-interval"), ("emps", "tnl-interval"), ("relay", "interval"), ("relay", "tnl-interval"))


def Q(x) -> fmpq:
    """The exact value of a float."""
    return x if isinstance(x, fmpq) else fmpq(*float(x).as_integer_ratio())


def nearest(value: fmpq, real: str = "float32"):
    """The float nearest to a rational: one rounding, not two."""
    kind = np.dtype(real).type
    guess = kind(float(value))
    around = (guess, np.nextafter(guess, kind(-np.inf)), np.nextafter(guess, kind(np.inf)))
    return min(around, key=lambda x: abs(Q(x) - value))


@dataclass(frozen=True)
class Run:
    """K samples of the true plant: x, y lists of rows of fmpq; u, y_read what the firmware is given; q modes."""

    q: np.ndarray
    x: list
    y: list
    u: np.ndarray
    u_read: np.ndarray
    y_read: np.ndarray


class ExactPlant:
    """x+ = A x + B u + Bw w + Bf f, y = C x + D u + Dv v + Df f, exactly."""

    def __init__(self, plant):
        self.plant = plant
        self.step = [self._mat(np.hstack([m.A, m.B, m.Bw, m.Bf])) for m in plant.modes]
        self.out = [self._mat(np.hstack([m.C, m.D, m.Dv, m.Df])) for m in plant.modes]

    @staticmethod
    def _mat(a):
        return fmpq_mat([[Q(x) for x in row] for row in a])

    def run(self, q, w, v, x0, u=None, f=None, pilot=None, real="float32") -> Run:
        """Simulate; u (K, n_u), or from ``pilot(k, x)`` where the input must keep the plant in its ranges."""
        p, K = self.plant, len(q)
        f = np.zeros((K, p.n_f)) if f is None else f
        x = [Q(a) for a in x0]
        xs, ys, us = [], [], np.zeros((K, p.n_u))
        for k in range(K):
            us[k] = u[k] if pilot is None else pilot(k, [float(a) for a in x])
            now, fault = [Q(a) for a in us[k]], [Q(a) for a in f[k]]
            xs.append(x)
            ys.append(self._apply(self.out[q[k]], [*x, *now, *(Q(a) for a in v[k]), *fault]))
            x = self._apply(self.step[q[k]], [*x, *now, *(Q(a) for a in w[k]), *fault])
        y_read = np.array([[nearest(a, real) for a in row] for row in ys], dtype=real).reshape(K, p.n_y)
        return Run(np.asarray(q), xs, ys, us, us.astype(real), y_read)

    @staticmethod
    def _apply(matrix, column):
        out = matrix * fmpq_mat([[a] for a in column])
        return [out[i, 0] for i in range(out.nrows())]


# -- signals ---------------------------------------------------------------------------------------
def random_corners(plant, q, rng):
    """w (K, n_w), v (K, n_v) at random corners of the bounds of each sample's mode."""
    def pick(name):
        lo = np.array([getattr(plant.modes[i], name + "_lo") for i in q]).reshape(len(q), -1)
        hi = np.array([getattr(plant.modes[i], name + "_hi") for i in q]).reshape(len(q), -1)
        return np.where(rng.random(lo.shape) < 0.5, lo, hi)
    return pick("w"), pick("v")


class Pusher:
    """Chooses w, v and x0 that drive one error (state bound or residual bound) to its minimum.

    With e_hi = x_hi - x and e_lo = x - x_lo:
    e_hi+ = M e_hi + d_hi - T Bw w + L Dv v + N Dv v+,    e_lo+ = M e_lo - d_lo + T Bw w - L Dv v - N Dv v+.
    A row (on e_hi, on e_lo) is carried backwards; every w and v takes the corner that makes the sum small.
    """

    def __init__(self, plant, tables):
        self.plant = plant
        self.t = {k: np.asarray(getattr(tables, k), dtype=float)
                  for k in ("M_hi", "M_lo", "L_hi", "L_lo", "N_hi", "N_lo")}
        eye = np.eye(plant.n_x)
        for s in ("hi", "lo"):
            self.t["T_" + s] = np.stack([eye - N @ m.C for N, m in zip(self.t["N_" + s], plant.modes)])

    def target(self, mode, what, side, i):
        """Start rows and weight on v for a state bound ("x") or an output bound ("y") at its sample."""
        m = self.plant.modes[mode]
        unit, none = np.eye(self.plant.n_x), np.zeros(self.plant.n_x)
        if what == "x":
            rows = (unit[i], none) if side == "hi" else (none, unit[i])
            return (*rows, np.zeros(self.plant.n_v))
        up, down = np.maximum(m.C[i], 0), np.maximum(-m.C[i], 0)
        return (up, down, -m.Dv[i]) if side == "hi" else (down, up, m.Dv[i])

    def signals(self, q, targets, rng):
        """w, v, x0 for targets [(sample, what, side, index), ...] in ascending order of samples.

        Each stretch between two targets is given to the later one; what is left over is a random corner.
        """
        p, t = self.plant, self.t
        w, v = random_corners(p, q, rng)
        x0 = np.where(rng.random(p.n_x) < 0.5, p.x0_lo, p.x0_hi)
        begin = 0
        for stop, what, side, i in targets:
            hi, lo, v_weight = self.target(q[stop], what, side, i)
            for k in range(stop - 1, begin - 1, -1):
                m, after = p.modes[q[k]], p.modes[q[k + 1]]
                v_weight = v_weight + (hi @ t["N_hi"][q[k]] - lo @ t["N_lo"][q[k]]) @ after.Dv
                v[k + 1] = least(v_weight, after.v_lo, after.v_hi, v[k + 1])
                w_weight = (lo @ t["T_lo"][q[k]] - hi @ t["T_hi"][q[k]]) @ m.Bw
                w[k] = least(w_weight, m.w_lo, m.w_hi, w[k])
                v_weight = (hi @ t["L_hi"][q[k]] - lo @ t["L_lo"][q[k]]) @ m.Dv
                hi, lo = hi @ t["M_hi"][q[k]], lo @ t["M_lo"][q[k]]
            if begin == 0:
                v[0] = least(v_weight, p.modes[q[0]].v_lo, p.modes[q[0]].v_hi, v[0])
                x0 = least(lo - hi, p.x0_lo, p.x0_hi, x0)
            begin = stop
        return w, v, x0


def least(weight, lo, hi, other):
    """Corner of a box that makes ``weight @ value`` smallest; ``other`` where the weight is zero."""
    return np.where(weight > 0, lo, np.where(weight < 0, hi, other))


def mode_sequence(n_modes, steps, style, rng):
    """Modes of each sample: "random" (may switch at every sample), "cycle" (does), or a dwell time in samples."""
    if style == "random":
        return rng.integers(0, n_modes, steps)
    if style == "cycle":
        order = rng.permutation(n_modes)
        back = rng.permutation(n_modes)
        return np.resize(np.concatenate([order, back[back != order[-1]]]), steps)
    return np.repeat(rng.integers(0, n_modes, steps // style + 1), style)[:steps]


def schedule(plant, q, rng, shortest=2, longest=25):
    """Targets at random samples: every state and output bound comes up again and again."""
    wanted = [("x", s, i) for s in ("hi", "lo") for i in range(plant.n_x)]
    wanted += [("y", s, i) for s in ("hi", "lo") for i in range(plant.n_y)]
    stops, out = np.cumsum(rng.integers(shortest, longest, len(q))), []
    for stop in stops[stops < len(q) - 1]:
        out.append((int(stop), *wanted[rng.integers(len(wanted))]))
    return out


def inputs(plant, q, rng, hold=1):
    """u (K, n_u) at the ends of the range, held so long; every other one a hair inside, where no float is exact."""
    lo, hi = plant.limits("u")
    u = np.repeat(np.where(rng.random((len(q) // hold + 1, plant.n_u)) < 0.5, lo, hi), hold, axis=0)[:len(q)]
    inside = 1 - 1e-4 * rng.random(u.shape)
    return np.where(rng.random(u.shape) < 0.5, u, (lo + hi) / 2 + (u - (lo + hi) / 2) * inside)


def double_integrator_pilot(plant, rng):
    """Full input either way, braking in time: for plants with a position and a speed (states 0, 1)."""
    (lo, hi), (u_lo, u_hi) = plant.limits("x"), plant.limits("u")
    middle, room = (lo + hi) / 2, (hi - lo) / 2
    push = max(float(m.B[1, 0]) for m in plant.modes) * u_hi[0] / plant.sample_period

    def pilot(k, x):
        offset, speed = x[0] - middle[0], x[1]
        ahead = offset + speed * abs(speed) / push
        if abs(speed) > 0.5 * room[1]:
            sign = -np.sign(speed)
        elif abs(ahead) > 0.5 * room[0]:
            sign = -np.sign(ahead)
        else:
            sign = rng.choice([-1.0, 1.0])
        return [(u_hi[0] if sign > 0 else u_lo[0]) * (1 - 1e-4 * rng.random())]
    return pilot


def campaign(plant, tables, seed, runs=6, steps=250, piloted=False, real="float32",
             styles=("cycle", "random", 3, "random", 7, "cycle")):
    """Several exact runs: worst cases aimed at bounds in turn, and random corners; fastest switching among them."""
    rng = np.random.default_rng(seed)
    exact, pusher = ExactPlant(plant), Pusher(plant, tables)
    out = []
    for r in range(runs):
        q = mode_sequence(plant.n_modes, steps, styles[r % len(styles)], rng)
        if r % 3 == 2:
            (w, v), x0 = random_corners(plant, q, rng), np.where(rng.random(plant.n_x) < 0.5, plant.x0_lo, plant.x0_hi)
        else:
            w, v, x0 = pusher.signals(q, schedule(plant, q, rng, longest=(6, 30)[r % 2]), rng)
        pilot = double_integrator_pilot(plant, rng) if piloted else None
        out.append(exact.run(q, w, v, x0, u=inputs(plant, q, rng, (1, 40, 5)[r % 3]), pilot=pilot, real=real))
    return out


# -- verdict ---------------------------------------------------------------------------------------
def in_ranges(plant, runs) -> bool:
    """Whether the exact states and outputs keep to the declared ranges (what every promise rests on)."""
    for name in "xy":
        lo, hi = ([Q(a) for a in side] for side in plant.limits(name))
        for run in runs:
            if not all(a <= b <= c for row in getattr(run, name) for a, b, c in zip(lo, row, hi)):
                return False
    return True


def lost(runs, trace) -> int:
    """Samples at which an exact state is outside its bounds."""
    count = 0
    for run, lo, hi in zip(runs, trace.x_lo, trace.x_hi):
        assert np.all(np.isfinite(lo)) and np.all(np.isfinite(hi))
        for x, a, b in zip(run.x, lo, hi):
            count += not all(Q(c) <= z <= Q(d) for c, z, d in zip(a, x, b))
    return count


def false_alarms(trace) -> int:
    """Samples at which an output is outside its bounds, or any alarm bit is set."""
    outside = np.any((trace.r_lo > 0) | (trace.r_hi < 0), axis=2)
    return int(np.sum(outside | (trace.raw_bits != 0) | trace.alarm | (trace.latched_bits != 0)))


def feed(observer, runs, q=None, **options):
    """Run an observer (numpy reference or compiled C) on what the firmware reads."""
    return observer.run_many(np.stack([r.u_read for r in runs]), np.stack([r.y_read for r in runs]),
                             np.stack([r.q for r in runs]) if q is None else q, **options)
