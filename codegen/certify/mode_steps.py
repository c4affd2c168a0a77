"""Do the constants of ``mode-set`` hold a discrete plant? As ``mode_enclosure``, for a mode that changes at samples."""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError
from .mode_enclosure import Enclosure, ball, size

Array = np.ndarray


class Steps(Enclosure):
    """Demands on tables of x+ = A x + B u + Bw w; parameters as ``Enclosure``."""

    def flow(self, q: int) -> Array:
        """[A, B, Bw w at its middle] of one mode."""
        return self.whole[q][:self.n]

    def reached(self, q: int, w: Array, S: Array) -> Array:
        """Bound of |S w|, |w| given."""
        return size(self.times(size(S), w))

    def birth(self, i: int, j: int, base: Array, lost: Array) -> None:
        """A switch falls between two steps: nothing is added, and the step is that of its mode."""
        t = self.t
        for name in ("J", "J_u", "J_shift"):
            if np.any(getattr(t, name)[i, j]):
                raise CertificateError(f'certificate: {name} from mode "{self.names[i]}" to "{self.names[j]}" is not '
                                       "zero, expected that of a plant that switches at samples. Design again.")
        given = np.column_stack([t.J_radius[i, j], t.J_u_radius[i, j], t.J_reach[i, j]])
        self.demand("jump", given, ball(np.zeros(given.shape)))
        at = np.concatenate([self.limit, self.u, ball([1.0])])
        added = ball(given) @ at  # sound to add nothing; what is added is rounded too
        need = self.reached(j, self.w[j], self.S) + lost
        need = need + self.gamma(self.n + self.n_u + 6) * (base + added + ball(t.birth[i, j]))
        self.demand(f'birth from mode "{self.names[i]}" to "{self.names[j]}"', t.birth[i, j], size(need))


def check_enclosure(plant, t) -> list[tuple[str, float, str]]:
    """Check that the true mode is never dropped: every constant of the tables is as wide as it must be.

    Parameters
    ----------
    plant : Plant
        Without parameters.
    t : ModeTables

    Returns
    -------
    list of (str, float, str)
        Per condition: of which constant, what is left of it at least, where.

    Raises
    ------
    CertificateError
        Naming the constant.
    """
    enclosure = (Enclosure if plant.kind == "continuous" else Steps)(plant, t)
    enclosure.check()
    return enclosure.left
