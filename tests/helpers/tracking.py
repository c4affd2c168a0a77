"""The quadrotor's tracking design, and its C driven sample by sample."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from codegen.analysis import closed_loop as loops
from codegen.designs import read_design
from codegen.observers import PolytopicObserver

from .folders import compile_

GENERATED_ROOT = Path(__file__).parents[2] / "generated"

GLUE = """
#include "quadrotor.h"
static quadrotor_state state; static quadrotor_law law;
typedef quadrotor_real real;
void start(void) { quadrotor_init(&state); quadrotor_law_init(&law); }
const void *bytes_of_state(void) { return &state; }
const void *bytes_of_law(void) { return &law; }
unsigned sizes(int which) { return which ? (unsigned)sizeof law : (unsigned)sizeof state; }
int sample(int missing, const real *ref, const real *y, real *numbers, unsigned *words)
{
    quadrotor_in in; quadrotor_out out; int status;
    for (unsigned i = 0U; i < QUADROTOR_NY; i++) { in.y[i] = y[i]; }
    for (unsigned i = 0U; i < QUADROTOR_NU; i++) { in.u[i] = 7; }
    status = missing ? (int)quadrotor_coast(&state, &law, &in, &out)
                     : (int)quadrotor_track(&state, &law, ref, &in, &out);
    for (unsigned i = 0U; i < QUADROTOR_NU; i++) { *numbers++ = in.u[i]; }
    if (status == 0) {
        for (unsigned i = 0U; i < QUADROTOR_NX; i++) { *numbers++ = out.x_hat[i]; }
        for (unsigned i = 0U; i < QUADROTOR_NY; i++) { *numbers++ = out.r[i]; }
        for (unsigned i = 0U; i < QUADROTOR_NREF; i++) { *numbers++ = law.s[i]; }
        words[0] = law.limited; words[1] = out.raw; words[2] = out.latched; words[3] = out.assured;
    }
    return status;
}
"""


@cache
def designed():
    """The committed design."""
    return read_design(GENERATED_ROOT / "quadrotor_tracking")


def observer(tables=None) -> PolytopicObserver:
    """The observer of the design, or of other tables."""
    own = designed().observer
    return PolytopicObserver(own.tables if tables is None else tables, own.supervision)


def closed_loop(plant, unit, ref, seed=0, draw="uniform", fault=None, missing=None):
    """One run with what is drawn."""
    return loops.closed_loop(plant, unit, ref, loops.drawn(plant, len(ref), seed, draw, fault, missing))


class CompiledTracker:
    """The C of a unit as a library: ``step(ref, y)`` answers as ``observers.feedback.Tracker``."""

    def __init__(self, folder, real: str, source: str | None = None):
        if source is not None:
            (folder / "quadrotor.c").write_text(source, encoding="ascii")
        (folder / "glue.c").write_text(GLUE, encoding="ascii")
        compile_(["gcc", "-std=c99", "-ffp-contract=off", "-O2", "-fPIC", "-shared", "quadrotor.c", "glue.c", "-o",
                  "tracker.so"], folder)
        self.dtype = np.dtype(real)
        self.library = ctypes.CDLL(str(folder / "tracker.so"))
        for name in ("bytes_of_state", "bytes_of_law"):
            getattr(self.library, name).restype = ctypes.c_void_p
        self.library.start()

    def memory(self) -> bytes:
        """All bytes of state and law."""
        return b"".join(ctypes.string_at(getattr(self.library, name)(), self.library.sizes(k))
                        for k, name in enumerate(("bytes_of_state", "bytes_of_law")))

    def sample(self, ref, y):
        """Status, numbers (u, x_hat, r, s) and words (limited, raw, latched, assured) of a sample; NaN: missing."""
        ref, y = (np.ascontiguousarray(v, self.dtype) for v in (ref, y))
        numbers, words = np.zeros(3 + 6 + 6 + 3, self.dtype), np.zeros(4, np.uint32)
        status = self.library.sample(int(np.isnan(y).any()), *(v.ctypes.data_as(ctypes.c_void_p)
                                                               for v in (ref, y, numbers, words)))
        return status, numbers, words
