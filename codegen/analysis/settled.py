"""How large the residual bounds of a point observer can be once the bounds of x are as narrow as the certificate says.

Both functions return the largest r_bound of each mode, (N, n_y), and the one a step of mode p later in mode q,
(N, N, n_y). What they start from covers every share that the noise in the estimate may have of the width.
"""

from __future__ import annotations

import numpy as np

from ..observers.ellipsoid_trace import weighted

Array = np.ndarray
#: A trace of the firmware's is at most this over the least one, a root over the exact one (``certify``).
LOSS, LONG = 1.0 + 1.0 / 60.0, 1.001


def of_box(t, cert: dict) -> tuple[Array, Array]:
    """Of an interval set: what the firmware itself computes from the largest half widths."""
    z = t.shape
    half, R = np.array(cert["steady_box"]["half"]), z.R.astype(float)
    most = np.array(cert["steady_box"]["width"]) / 2 - z.spread.astype(float).min(axis=0)
    with np.errstate(divide="ignore"):
        half = half * np.max(np.min(most[:, None] / R, axis=0) / half)  # no b that fits the bounds of x is larger
    S, P, rest = z.S.astype(float), z.P.astype(float), z.rho.astype(float).max(axis=1)
    carried = P @ half + z.g.astype(float).max(axis=1)
    return S @ half + rest, np.einsum("qyx,px->pqy", S, carried) + rest


def of_trace(t, cert: dict) -> tuple[Array, Array]:
    """Of an ellipsoid of least trace, from the largest weighted trace.

    With tau = tr(W X), ``C X C'`` has a weighted trace of at most l tau, l the largest eigenvalue of ``W^-1/2 C' Wy C
    W^-1/2``, and the sum with the noise at most ``LOSS (root(l tau) + root(tau(V)))^2``; so for a step.
    """
    z = t.shape
    w, wy = np.sqrt(z.weight.astype(float)), np.sqrt(z.weight_y.astype(float))
    most = np.array(cert["steady_box"]["width"]) / 2 - z.spread.astype(float).min(axis=0)
    tau = np.sum((w * most) ** 2)
    step = np.array([np.linalg.norm(w[:, None] * M / w, 2) for M in t.M.astype(float)])
    out = np.array([np.linalg.norm(wy[:, None] * C / w, 2) for C in t.C.astype(float)])
    added = np.sqrt([weighted(z.weight.astype(float), H.astype(float)).max() for H in z.H])
    noise = np.sqrt([weighted(z.weight_y.astype(float), V.astype(float)).max() for V in z.V])
    later = np.minimum(np.sqrt(LOSS) * (step * np.sqrt(tau) + added), np.sqrt(tau))
    bound = np.sqrt(LOSS) * (1 + 1e-4) * LONG * z.scale_y.astype(float)
    return (bound * (out * np.sqrt(tau) + noise)[:, None], bound * (later[:, None] * out + noise)[..., None])


#: By the set's name in the certificate.
BOUNDS = {"box": of_box, "ellipsoid_trace": of_trace}
