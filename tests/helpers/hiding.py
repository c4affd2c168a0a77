"""Noise that hides a fault from a point observer as well as any noise can: a linear program along a mode sequence.

Shares no code with ``analysis``: the residual is made from the plant and the gains, the sets are those that the
reference carries at run time.
"""

from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat
from scipy.optimize import linprog

from codegen.algebra import zonotope

ANGLES = np.pi * np.arange(32) / 32
ROUND = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def bounds_along(design, real, q):
    """Directions and the largest |d' r| without an alarm at every sample of a mode sequence, from the reference."""
    t, run = design.observer.tables[real], design.observer
    z, n_y = t.shape, t.C.shape[1]
    sets, origin = [], np.array([t.origins - 1])
    D = np.concatenate([np.eye(n_y), getattr(z, "directions", np.zeros((0, n_y))).astype(float)])
    half = ((t.x0_hi - t.x0_lo) / 2)[None].astype(t.dtype)
    H = run.whole(t, half, True)
    for k, mode in enumerate(q):
        now = np.array([mode])
        if k:
            last = np.array([q[k - 1]])
            H = run.moved(t, last, now, origin, H, True)
            origin = last if t.kind == "tnl" else np.zeros(1, int)
        if run.family == "thresholds":
            sets.append((z.directions.astype(float), z.h[run._row(t, now, H)][0].astype(float)))
        elif run.family == "box":
            sets.append((D, run.judged(t, now, origin, H, np.zeros((1, n_y), t.dtype))[0][0].astype(float)))
        elif run.family == "zonotope":
            R = np.concatenate([t.C[mode].astype(float) @ H[0], z.V[mode, origin[0]].astype(float)], axis=1)
            edges = np.concatenate([D, zonotope.normals(R)]) if n_y == 2 or z.pairs else D
            length = np.linalg.norm(edges, axis=1, keepdims=True)
            edges = (edges / np.where(length > 0, length, 1.0))[length[:, 0] > 0]
            sets.append((edges, np.abs(edges @ R).sum(axis=1) + np.abs(edges) @ z.rho[mode].astype(float)))
        else:
            C = t.C[mode].astype(float)
            if run.family == "ellipsoid_trace":
                R = run.shape_of_residuals(t, now, origin, H)[0].astype(float)
            else:
                R = z.gr[mode].astype(float) * C @ H[0].astype(float) @ C.T + z.V[mode, origin[0]]
            tangents = ROUND @ np.linalg.inv(np.linalg.cholesky(R)) if n_y == 2 else D
            sets.append((tangents, np.sqrt(np.einsum("di,ij,dj->d", tangents, R, tangents))))
    return sets


def effects(plant, t, q, onset, channel):
    """What each noise at its largest does to the residuals from the onset on, and what a unit step does."""
    K, n_w, n_v = len(q), plant.n_w, plant.n_v
    L, N = t.L.astype(float), t.N.astype(float)
    modes = [plant.modes[p] for p in q]
    total = K * (n_w + n_v) + 1  # all of w, all of v, the fault
    w, read = np.zeros((K, plant.n_w, total)), np.zeros((K, plant.n_y, total))
    for k, m in enumerate(modes):
        w[k, :, k * n_w:(k + 1) * n_w] = np.diag((m.w_hi - m.w_lo) / 2)
        first = K * n_w + k * n_v
        read[k, :, first:first + n_v] = m.Dv * ((m.v_hi - m.v_lo) / 2)
        read[k, :, -1] = m.Df[:, channel] * (k >= onset)
    e, out = np.zeros((plant.n_x, total)), []
    for k, (p, m) in enumerate(zip(q, modes)):
        out.append(m.C @ e + read[k])
        if k + 1 < K:
            pushed = m.A @ e + m.Bw @ w[k]
            pushed[:, -1] += m.Bf[:, channel] * (k >= onset)
            e = (np.eye(plant.n_x) - N[p] @ m.C) @ pushed - L[p] @ out[-1] - N[p] @ read[k + 1]
    out = np.array(out)[onset:]
    return out[..., :-1], out[..., -1]


def hide(sets, G, r, size=None):
    """Noise z for which a step stays inside at every sample: as large a step as possible, or of a given size.

    Returns the size (or, for a given one, how far inside: below 1 is hidden) and z.
    """
    count, rows, most = G.shape[2], [], []
    for (D, h), noise, effect in zip(sets, G, r):
        for sign in (1.0, -1.0):
            own = sign * D @ noise / h[:, None]
            last = sign * D @ effect / h
            if size is None:
                rows.append(np.concatenate([own, last[:, None]], axis=1))
                most.append(np.ones(len(h)))
            else:
                rows.append(np.concatenate([own, -np.ones((len(h), 1))], axis=1))
                most.append(-size * last)
    goal = np.zeros(count + 1)
    goal[-1] = -1.0 if size is None else 1.0
    scale = 1.0 if size is not None else max(np.max(np.abs(row[:, -1])) for row in rows) or 1.0
    rows = np.concatenate(rows)
    rows[:, -1] /= scale
    found = linprog(goal, A_ub=rows, b_ub=np.concatenate(most), bounds=[(-1, 1)] * count + [(0, None)])
    if found.status == 3:
        return np.inf, None
    return found.x[-1] / scale, found.x[:-1]


def played(plant, q, z, onset, channel, size, real):
    """Outputs of the plant in rational arithmetic under that noise, rounded as the firmware reads them."""
    def exact(a):
        return fmpq_mat(*np.shape(a), [fmpq(*float(x).as_integer_ratio()) for x in np.ravel(a)])

    def one(a):
        return exact(np.reshape(a, (-1, 1)))

    modes = [{k: exact(getattr(m, k)) for k in ("A", "C", "Bw", "Dv", "Bf", "Df")} for m in plant.modes]
    K, n_w, n_v = len(q), plant.n_w, plant.n_v
    z = np.round(np.clip(z, -1, 1) * 2**20) / 2**20
    shares = np.resize(z[:K * n_w], (K, n_w)), np.resize(z[K * n_w:], (K, n_v))
    x, y = (one(plant.x0_lo) + one(plant.x0_hi)) * fmpq(1, 2), np.empty((K, plant.n_y))
    for k, p in enumerate(q):
        m, noise = modes[p], []
        for name, share in zip("wv", shares):
            lo, hi = (one(getattr(plant.modes[p], f"{name}_{side}")) for side in ("lo", "hi"))
            half = (hi - lo) * fmpq(1, 2)
            noise.append(lo + half + exact(np.diag(share[k])) * half)
        f = one([size if j == channel and k >= onset else 0.0 for j in range(plant.n_f)])
        out = m["C"] * x + m["Dv"] * noise[1] + m["Df"] * f
        y[k] = [float(Fraction(int(a.p), int(a.q))) for a in out.entries()]
        x = m["A"] * x + m["Bw"] * noise[0] + m["Bf"] * f
    return y.astype(real)
