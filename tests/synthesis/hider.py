"""Runs that hide a fault from an observer with parameters or unknowns as well as they can, and plants to try them on.

``Hider`` drives the plant as the firmware sees it, in float64, with everything at its bounds (w, v, every unknown,
theta, the modes), and picks each corner so that one residual bound stays inside as long as possible. It shares no code
with ``analysis.robust``.
"""

from dataclasses import dataclass, replace

import numpy as np

from codegen.analysis import robust
from codegen.analysis.detectability import ultimate_errors
from codegen.plant.simulate import told

WITHIN = 3

# A channel on state and output at once, of opposite signs; a second one on the states alone; modes that differ in both.
VALVE = """
format = 1
name = "valve"
title = "Two tanks behind a valve"
source = "own example"
[time]
kind = "discrete"
sample_period = 1
[signals]
x = [{ name = "a", range = [-30, 30] }, { name = "b", range = [-30, 30] }]
u = [{ name = "u", range = [-3, 5] }]
y = [{ name = "y", range = [-90, 90] }]
w = [{ name = "w", bounds = [-0.1, 0.2] }]
v = [{ name = "v", bounds = [-0.3, 0.2] }]
f = [{ name = "valve", range = [-9, 9] }, { name = "leak", range = [-9, 9] }]
theta = [{ name = "e", bounds = [1, 2], error = 0.004 }, { name = "g", bounds = [-0.005, 0.005], measured = false }]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[common]
C = [[1, 0.5]]
Dv = [[1]]
Bw = [[1], [-1]]
[[mode]]
name = "one"
A = [["0.2*e - 0.1", "0.3 + g"], ["0.1 + 0.2*e", "0.2 - g"]]
B = [["e"], ["1 + g"]]
Bf = [[1, 0.2], [0.1, 1]]
Df = [[-0.5, 0]]
[[mode]]
name = "two"
A = [["0.1*e + g", 0.4], ["0.3*e - 0.1", "0.3"]]
B = [["-e"], [1]]
Bf = [[1.5, 0.5], [0.1, 2]]
Df = [[-0.4, 0]]
"""
# Told late, with dynamics close enough to each other for that; the faults act as differently as before.
LATE = VALVE.replace(
    '["0.1*e + g", 0.4], ["0.3*e - 0.1", "0.3"]', '["0.2*e - 0.1", "0.302 + g"], ["0.1 + 0.2*e", "0.2"]').replace(
    '[["-e"], [1]]', '[["e"], ["1 + g"]]').replace("[1, 2], error = 0.004", "[1.495, 1.505], measured = false") + """
[switching]
late = true
"""
# One state and a period in which what the unknown does to the fault counts.
STIRRED = """
format = 1
name = "stirred"
title = "A vessel sampled slowly"
source = "own example"
[time]
kind = "continuous"
sample_period = 0.4
[signals]
x = [{ name = "x", range = [-1, 1] }]
y = [{ name = "y", range = [-9, 9] }]
w = [{ name = "w", bounds = [-0.1, 0.1] }]
v = [{ name = "v", bounds = [-0.001, 0.001] }]
f = [{ name = "f", range = [-9, 9] }]
theta = [{ name = "a", bounds = [0.7, 1.3], measured = false }]
[initial]
x_lo = [-0.1]
x_hi = [0.1]
[[mode]]
name = "only"
A = [["-a"]]
C = [[1]]
Bw = [[1]]
Dv = [[1]]
Bf = [[1]]
"""


@dataclass(frozen=True)
class Case:
    """A certified observer and the plant that it watches; float64 where there is such a table."""

    plant: object
    observer: object
    tails: tuple
    real: str

    @classmethod
    def of(cls, design, **changes):
        real = max(design.certificate)
        return cls(replace(design.plant, **changes), design.observer, ultimate_errors(design.certificate[real]), real)

    @property
    def t(self):
        return self.observer.tables[self.real]

    def promised(self, channel, modes=None):
        return robust.thresholds(modes or self.plant.observed.modes, self.t, self.tails, channel, WITHIN)


# -- runs that hide a fault ------------------------------------------------------------------------
def corner(lo, hi, rng):
    return np.where(rng.random(np.shape(lo)) < 0.5, lo, hi)


def best(weight, lo, hi):
    """Corner of a box where ``weight @ value`` is largest."""
    return np.where(weight > 0, hi, lo)


class Hider:
    """One run whose signals keep the residual bound ``side`` of output i inside at sample ``aim``, as far as they can.

    A row (weights on e_hi, on e_lo) is carried back from there through the closed loop. With ``aim`` None each sample
    does what is best for the next one.
    """

    def __init__(self, case, q, theta, i, side, aim):
        self.modes, self.t, self.q, self.aim = case.plant.observed.modes, case.t, q, aim
        self.tables = [self._tables(k, theta) for k in range(len(q) - 1)]
        C = self.modes[0].C[i]
        up, down = np.maximum(C, 0), np.maximum(-C, 0)
        up, low = (up, down) if side == "hi" else (down, up)
        self.seen = np.where(np.arange(len(self.modes[0].C)) == i, -1.0 if side == "hi" else 1.0, 0.0)
        self.row = [up - low] * len(q)  # what an error of both framers in the same direction is worth at each sample
        for k in range(aim - 1 if aim is not None else -1, -1, -1):
            M, flipped = self.tables[k][0], self.t.flipped[q[k]]
            same, other = np.where(flipped, 0, M), np.where(flipped, -M, 0)
            up, low = up @ same + low @ other, low @ same + up @ other
            self.row[k] = up - low

    def _tables(self, k, theta):
        """M, L, the parameters of the step with their products, and how large each unknown may be in it."""
        v, m, q = self.t.vary, self.modes[self.q[k]], self.q[k]
        mean = (theta[k] + theta[k + 1]) / 2 if v.midpoint else theta[k]
        at = np.array([*mean, *(mean[a] * mean[b] for a, b in m.products)])
        most = np.ones(len(m.A_unc))
        for i, j in enumerate(() if m.paced is None else m.paced):
            most[i] = max(0.0, 1 - ((theta[k + 1] - theta[k])[j] / m.reach[j]) ** 2) if j >= 0 else 1.0
        M, L = (base[q] + np.tensordot(at[:len(slopes[q])], slopes[q], 1)
                for base, slopes in ((self.t.M_hi, v.M), (self.t.L_hi, v.L)))
        return M, L, at, most

    def noise(self, k):
        """v of sample k, by its weights in the residual, in the step after and in the step before."""
        m, weight = self.modes[self.q[k]], 0 * self.seen
        if self.aim is None or k == self.aim:
            weight = weight + self.seen
        elif k < self.aim:
            weight = weight + self.row[k + 1] @ self.tables[k][1]
        if k > 0 and (self.aim is None or k <= self.aim):
            weight = weight + self.row[k] @ self.t.N_hi[self.q[k - 1]]
        return best(weight @ m.Dv, m.v_lo, m.v_hi)

    def step(self, k, x, u, f, channel):
        """State at k + 1."""
        m, N, (_, _, at, most) = self.modes[self.q[k]], self.t.N_hi[self.q[k]], self.tables[k]
        push = -self.row[k + 1] @ (np.eye(len(x)) - N @ m.C)  # what a push on the state is worth
        after = m.A @ x + m.B @ u + m.Bw @ best(push @ m.Bw, m.w_lo, m.w_hi) + m.Bf[:, channel] * f
        for p, F, G in zip(at, m.A_theta, m.B_theta):
            after = after + p * (F @ x + G @ u)
        for size, F, G in zip(most, m.A_unc, m.B_unc):
            moved = size * (F @ x + G @ u)
            after = after + (moved if push @ moved > 0 else -moved)
        return after + np.sign(push) * (m.A_rad @ abs(x) + m.B_rad @ abs(u) + m.Bf_rad[:, channel] * abs(f))


@dataclass(frozen=True)
class Runs:
    """What the firmware reads of S runs of K samples, and where the framers start."""

    u: np.ndarray
    y: np.ndarray
    q: np.ndarray
    theta: np.ndarray
    x0_lo: np.ndarray
    x0_hi: np.ndarray


ONSET = 1


def hidden(case, channel, size, count, rng, last=ONSET + WITHIN):
    """Runs with a step of a fault at sample ``ONSET``, without those in which a state or an output leaves its range.

    The errors fill their ultimate box at first; mode and theta take any value of theirs at every sample.
    """
    seen, t = case.plant.observed, case.t
    (lo, hi), u_box, (y_lo, y_hi) = (case.plant.limits(name) for name in "xuy")
    out = []
    for _ in range(count):
        q = rng.integers(0, seen.n_modes, last + 2)
        theta = np.array([corner(seen.modes[i].theta_lo, seen.modes[i].theta_hi, rng) for i in q]).reshape(len(q), -1)
        aim = rng.choice([None, *range(ONSET, last + 1)])
        run = Hider(case, q, theta, rng.integers(case.plant.n_y), rng.choice(["hi", "lo"]), aim)
        x = corner(lo, hi, rng) * rng.choice([0.0, 0.5, 0.9, 1.0, rng.random()])
        far = rng.random() < 0.5  # inputs that keep the state near the ends of its range, where the radii are largest
        said = told(case.plant, q, rng) if t.vary.late else q
        start = [np.clip(x + e, lo, hi) for e in (-case.tails[1], case.tails[0])]
        xs, us, ys = [], [], []
        for k in range(last + 1):
            m, f = seen.modes[q[k]], size * (k >= ONSET)
            u = best(np.sign(x) @ m.B, *u_box) if far else corner(*u_box, rng)
            xs.append(x)
            us.append(u)
            ys.append(m.C @ x + m.D @ u + m.Dv @ run.noise(k) + m.Df[:, channel] * f)
            x = run.step(k, x, u, f, channel)
        if np.all((lo <= xs) & (xs <= hi)) and np.all((y_lo <= ys) & (ys <= y_hi)):
            out.append((us, ys, said[:-1], theta[:-1], *start))
    return Runs(*(np.array(a) for a in zip(*out))) if out else None


def missed(case, channel, size, delay, count, seed=0):
    """Number of runs without an alarm from the onset to ``delay`` samples after it, and of all; both signs."""
    rng, silent, total = np.random.default_rng(seed), 0, 0
    for sign in (1, -1):
        r = hidden(case, channel, sign * size, count, rng, ONSET + delay)
        if r is None:
            continue
        trace = case.observer.run_many(r.u, r.y, r.q, case.real, r.x0_lo, r.x0_hi, theta=r.theta)
        raw = trace.raw_bits != 0
        assert np.all(trace.status == 0) and not np.any(raw[:, :ONSET]), "no alarm before the fault"
        seen = np.any(raw, axis=1)
        if np.any([m.Bf[:, channel] for m in case.plant.modes]):
            # A framer put back to the far end of its range: there a fault on the state is not promised.
            far = np.any((trace.x_hi <= case.t.x_lo) | (trace.x_lo >= case.t.x_hi), axis=(1, 2))
            seen = seen[~far]
        silent, total = silent + int(np.sum(~seen)), total + len(seen)
    return silent, total


def finite(sizes):
    """First and last delay with a promise; nothing where there is none."""
    delays = [d for d, size in enumerate(sizes) if size < np.inf]
    return sorted({delays[0], delays[-1]}) if delays else []
