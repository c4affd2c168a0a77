"""Observers that solve the algebraic equations themselves, with constants that mean nothing; two pivots or one."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from codegen.designs import Design
from codegen.observers import DescriptorObserver, DescriptorTables, Supervision
from codegen.selection.polytopic_tables import limited, tables_of
from codegen.synthesis.descriptor_gains import StandardGains

from .descriptors import plant


def tables(uneven: bool, real: str) -> DescriptorTables:
    """Of the shape of the contact force."""
    p, rng = plant("disc_contact"), np.random.default_rng(5)
    h, n, m, y = 2, p.n_x, p.n_u, p.n_y
    F, G, K = rng.uniform(-0.3, 0.3, (h, n, n)), rng.uniform(-1, 1, (h, n, m)), rng.uniform(-0.1, 0.1, (h, n, y))
    F[:, 2:], G[:, 2:], K[:, 2:] = np.eye(n)[2:], 0.0, 0.0
    gains = StandardGains(*(M.astype(real).astype(float) for M in (np.zeros((n, y)), F, G, K, p.polytope.C)))
    base = limited(p, tables_of(p, gains, np.eye(y), real), np.eye(n), -0.1 * np.ones(n))
    P, Q = rng.uniform(-1, 1, (h, 2, n)), rng.uniform(-1, 1, (h, 2, m))
    P[:, :, 2:], P[:, 0, 0] = 0.0, 0.25  # a factor that both vertices share
    base = replace(base, h=np.array([[0.4, 0.9], [0.2, 0.5], [0.1, 0.3]], real), shift=1)
    return DescriptorTables(**{f.name: getattr(base, f.name) for f in fields(base)}, P=P.astype(real),
                            Q=Q.astype(real), pivot=np.array([1.0, 0.3 if uneven else 1.0], real), algebraic=(2, 3))


def stand_in(uneven: bool, *reals: str) -> Design:
    """A design of each of these types; of float32 where none is named."""
    reals, p = reals or ("float32",), plant("disc_contact")
    p = replace(p, target=replace(p.target, prefix="obs", real=reals[0]))
    observer = DescriptorObserver({r: tables(uneven, r) for r in reals}, Supervision(debounce=(2, 3), recover=4))
    return Design(p, "descriptor-direct", observer, {r: {"kind": "polytopic"} for r in reals},
                  {r: ["nothing: constants of a test"] for r in reals}, {r: [] for r in reals})
