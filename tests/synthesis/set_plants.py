"""Plants of sections 6.2.4 and 6.3.5 of Zammali (2020), misprints corrected, and small gain problems for the tests."""

import cvxpy as cp
import numpy as np

from codegen.algebra import error_set
from codegen.certify.order import patterns

# -- 6.2.4 -------------------------------------------------------------------------------------------
A62 = np.array([[[.78, 0, .05], [0, .45, -.015], [.06, .012, .01]],
                [[-.02, -.2, .4], [.08, 1, -.2], [.09, .08, -.1]],
                [[.55, 0, .25], [0, .45, 0], [0, .075, -.03]]])
F62 = np.array([[-1., 1, -1], [-2, 2, -2], [1, 2, -1]])[:, :, None]
D62 = np.array([[.005, -.01, -.002], [.01, 0, .005], [.001, .001, .008]])
DV62 = np.array([[.01, -.002, .01], [.001, .001, .01]])
C62 = np.array([[1, -.5, 1], [-1, 1, 0]])
PRINTED62 = np.array([[[-.038, -.112], [-.219, -.391], [-.304, -.059]],
                      [[-.099, -.064], [-.378, -.264], [-.340, -.030]],
                      [[.163, -.236], [.143, -.356], [-.821, .058]]])
W62 = V62 = np.full(3, .1)
H62 = .1 * np.eye(3)

# -- 6.3.5 -------------------------------------------------------------------------------------------
A63 = np.array([[[.6, 2, 1], [.2, .5, .2], [-.9, .2, .8]], [[.1, 1.5, 1], [.5, .7, .5], [-.8, 0, .5]],
                [[.5, .3, 1], [.1, 0, 1], [0, .1, .1]]])
D63 = np.array([[.2, .1, .1], [.3, .1, .2], [0, .1, .1]])[:, :, None]
DV63 = .1 * np.eye(2)
F63 = np.array([[.5], [-.5]])
C63 = np.array([[1, .1, 0], [1, 1, .1]])
L63 = np.array([[[-.04, .10], [.03, .02], [-.23, -1.03]], [[-.12, -.01], [.19, .13], [-.20, -.70]],
                [[.04, .09], [-.06, -.13], [-.05, .07]]])
N63 = np.array([[[.39, .41], [.01, .20], [.25, .24]], [[.36, .41], [.04, .22], [.22, .23]],
                [[.34, .27], [.01, .49], [-.2, .21]]])
W63, V63 = np.array([.1]), np.full(2, .1)
HALF63 = np.full(3, .2)
H63 = np.diag(HALF63)


def luenberger62(L):
    """Recursion of a Luenberger observer of 6.2.4."""
    return error_set.luenberger(A62, C62, L, D62, DV62, W62, V62)


def tnl63():
    """Recursion of the TNL observer of 6.3.5 with the printed gains."""
    return error_set.tnl(A63, C63, L63, N63, D63, DV63, W63, V63)


def pole_gains(A, C, Bw, Dv, F, lam):
    """Theorem 20 (lam: the eigenvalue on the fault direction) or 19 (lam None), common P and S; least gamma."""
    Q, n, m = len(A), A.shape[1], C.shape[0]
    P, g = cp.Variable((n, n), symmetric=True), cp.Variable()
    Y = [cp.Variable((n, m)) for _ in range(Q)] if lam is None else [cp.Variable((n, m))] * Q
    p, s = Bw.shape[1], Dv.shape[1]
    K, free, limits = [], [], []
    for q in range(Q):
        CF = C @ F[q]
        pinv = np.linalg.pinv(CF)
        K.append(np.zeros((n, m)) if lam is None else (A[q] - lam * np.eye(n)) @ F[q] @ pinv)
        free.append(np.eye(m) if lam is None else np.eye(m) - CF @ pinv)
        PL = P @ K[q] + Y[q] @ free[q]
        corner = Dv.T @ C
        M = cp.bmat([[-P + C.T @ C, np.zeros((n, p)), corner.T, (P @ A[q] - PL @ C).T],
                     [np.zeros((p, n)), -g * np.eye(p), np.zeros((p, s)), (P @ Bw).T],
                     [corner, np.zeros((s, p)), Dv.T @ Dv - g * np.eye(s), -(PL @ Dv).T],
                     [P @ A[q] - PL @ C, P @ Bw, -PL @ Dv, -P]])
        limits.append((M + M.T) / 2 << -1e-9 * np.eye(2 * n + p + s))
    problem = cp.Problem(cp.Minimize(g), [*limits, P >> 1e-6 * np.eye(n)])
    problem.solve(solver=cp.CLARABEL)
    L = [K[q] + np.linalg.solve(P.value, Y[q].value) @ free[q] for q in range(Q)]
    return np.array(L), float(np.sqrt(g.value))


def best_pole_gain(A, C, Bw, Dv, F, lam):
    """The same for one mode alone."""
    return pole_gains(A[None], C, Bw, Dv, F[None], lam)[0][0]


def linf_gains(A, C, Bw, Dv, lam=.8, interval=False):
    """Theorem 21 with a common P >= I: least mu at decay lam; L and N per mode.

    ``interval``: P diagonal and the error matrix nonnegative, the gains of chapter 5.
    """
    Q, n, m = len(A), A.shape[1], C.shape[0]
    P, mu = cp.diag(cp.Variable(n)) if interval else cp.Variable((n, n), symmetric=True), cp.Variable()
    limits, W, X = [P >> np.eye(n)], [], []
    for q in range(Q):
        W.append(cp.Variable((n, m)))
        X.append(cp.Variable((n, m)))
        PT = P - X[q] @ C
        PH = cp.hstack([PT @ Bw[q], -W[q] @ Dv, -X[q] @ Dv])
        k = PH.shape[1]
        PM = PT @ A[q] - W[q] @ C
        limits += [PM >= 0] if interval else []
        block = cp.bmat([[(1 - lam) * P, np.zeros((n, k)), PM.T], [np.zeros((k, n)), mu * np.eye(k), PH.T],
                         [PM, PH, P]])
        limits.append((block + block.T) / 2 >> 1e-9 * np.eye(2 * n + k))
    cp.Problem(cp.Minimize(mu + 1e-3 * cp.trace(P)), limits).solve(solver=cp.CLARABEL)
    return (np.array([np.linalg.solve(P.value, w.value) for w in W]),
            np.array([np.linalg.solve(P.value, x.value) for x in X]))


def random_path(rng, modes, dwell, steps, spread=6):
    """A mode sequence with at least ``dwell`` samples per mode."""
    path, q = [], int(rng.integers(modes))
    while len(path) < steps:
        path += [q] * int(dwell + rng.integers(spread))
        q = int((q + 1 + rng.integers(modes - 1)) % modes)
    return path[:steps]


def observe(A, C, L, N, Bw, Dv, path, w, v, x0, guess=None, w_mid=0., v_mid=0., u=None, f=None, Df=None):
    """Plant and observer side by side, from the equations of the plant: residuals (K, m).

    w (K, p) and v (K, s) are the true ones, w_mid and v_mid what the observer is told; u (K, n) drives both.
    """
    x, xi = np.array(x0, dtype=float), np.zeros(A.shape[1]) if guess is None else np.array(guess, dtype=float)
    w_mid, v_mid = np.zeros(w.shape[1]) + w_mid, np.zeros(v.shape[1]) + v_mid
    out, last, told = [], None, xi
    for k, q in enumerate(path):
        y = C @ x + Dv @ (v[k] - v_mid) + (0 if f is None else Df @ f[k])
        if last is not None:
            told = xi + N[last] @ y
        r = y - C @ told
        out.append(r)
        drive = 0 if u is None else u[k]
        T = np.eye(len(x)) - N[q] @ C
        xi = T @ (A[q] @ told + drive + Bw[q] @ w_mid) + L[q] @ r
        x = A[q] @ x + drive + Bw[q] @ w[k]
        last = q
    return np.array(out)


def worst_residuals(A, C, L, N, Bw, Dv, path, w_half, v_half, x0_half, directions):
    """Largest d' r_k over all noise in its bounds, from one simulation per noise sample: (K, d)."""
    K, p, s, n = len(path), len(w_half), len(v_half), A.shape[1]
    zero_w, zero_v, zero_x = np.zeros((K, p)), np.zeros((K, s)), np.zeros(n)
    total = np.zeros((K, len(directions)))

    def spread(w, v, x0):
        return np.abs(observe(A, C, L, N, Bw, Dv, path, w, v, x0) @ directions.T)

    for i in range(n):
        total += spread(zero_w, zero_v, np.eye(n)[i] * x0_half[i])
    for k in range(K):
        for i in range(p):
            w = zero_w.copy()
            w[k, i] = w_half[i]
            total += spread(w, zero_v, zero_x)
        for i in range(s):
            v = zero_v.copy()
            v[k, i] = v_half[i]
            total += spread(zero_w, v, zero_x)
    return total


def admissible_paths(rng, dwell, count, steps):
    """Patterns and random sequences that keep to a dwell time: at it, just above it, and long stays."""
    paths = patterns(3, dwell, steps)
    rng.shuffle(paths)
    return paths[:count // 2] + [tuple(random_path(rng, 3, dwell, steps, spread)) for spread in (1, 2, 30)
                                 for _ in range(count // 6)]
