"""Certificate of ``mode-set``: the true mode is never dropped, and by when every wrong one is.

Stored are the delays per pair of modes and the widths behind them; ``check`` meets each anew: programs that surely have
no solution, by witnesses in rational numbers, and constants that hold the plant, in ball arithmetic.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from fractions import Fraction

import numpy as np

from ..errors import CertificateError
from . import mode_witness
from .claims import digest
from .mode_claims import Claims, ModeDelays
from .mode_faults import label, surely_found
from .mode_steps import check_enclosure

Array = np.ndarray


def dwell_samples(plant) -> int:
    """Whole samples that every mode lasts at least; 0 where the plant file does not say."""
    s = plant.switching
    if s.average_dwell is None or s.chatter != 1:
        return 0
    dwell, period = (Fraction(repr(float(x))) for x in (s.average_dwell, plant.sample_period))  # 0.3 is 3 x 0.1
    return int(dwell / period)


def square(n_modes: int, values: dict) -> list[list[int]]:
    """Numbers per pair of modes as rows; 0 on the diagonal."""
    return [[int(values.get((i, j), 0)) for j in range(n_modes)] for i in range(n_modes)]


def prove(plant, t, horizon: int, oldest: int | None = None, widths: Array | None = None,
          restart: bool = False, asked: int | list[dict] = 1) -> tuple:
    """Certify tables, with the oldest age that they have or the least that will do.

    Parameters
    ----------
    plant : Plant
    t : ModeTables
    horizon : int
        Samples after which modes count as not to be told apart.
    oldest : int or None
        Search the oldest age up to this; None: keep that of the tables.
    widths : ndarray (n_x,) or None
        Where to begin the search for the widths, such as those of the other number type.
    restart : bool
        What holds after an alarm or a reset is certified too; it takes more ages.
    asked : int or list of dict
        Samples within which faults have to be found at the latest (0: none is promised to be), or promises to look for,
        such as those of the other number type.

    Returns
    -------
    tables : ModeTables
    certificate : dict
        ``check`` accepts it.

    Raises
    ------
    CertificateError
    """
    check_enclosure(plant, t)
    claims = Claims(t, plant.limits("x"), plant.limits("u"), dwell_samples(plant), horizon,
                    names=tuple(m.name for m in plant.modes))
    if oldest is None:
        found = claims.delays(restart, widths)
    else:
        found, ages = claims.sized(oldest, widths, restart)
        t = replace(t, ages=ages)
    if found.start is None:
        raise CertificateError(f"certificate: from power-up some modes are not told apart within {horizon} samples. "
                               "State a smaller initial box, or a longer dwell time.")
    n = plant.n_modes
    cert = {"kind": "mode", "dwell": dwell_samples(plant), "ages": t.ages, "horizon": horizon,
            "old": square(n, found.old), "identified": square(n, found.identified), "quiet": found.quiet,
            "start": found.start, "worst": found.worst, "widths": found.widths.tolist(),
            **({"restart": found.restart, "calm": found.calm} if restart else {}),
            **({"switches": "at samples"} if plant.kind == "discrete" else {})}
    kept: dict = {}
    proved(plant, t, cert, kept)
    faults = found_faults(plant, t, cert, asked, kept)
    names = [s.name for s in plant.f]
    sizes = {label(names.index(f["channel"]), f["within"]): f["size"] for f in faults}
    return t, cert | ({"faults": faults} if faults else {}) | {
        "witnesses": mode_witness.stated(kept, found.widths, sizes)}


def claims_on(plant, t, cert: dict, kept: dict | None = None) -> Claims:
    """What computes the delays of a certificate."""
    return Claims(t, plant.limits("x"), plant.limits("u"), cert["dwell"], cert["horizon"], kept)


#: Tables of framers that an estimator drives: no delay rests on them.
FRAMERS = ("told", "S_rounded", "xi_room")
#: Delays by what they follow from: a folder's design is proved more than once in one run.
_KNOWN: dict[str, ModeDelays] = {}
#: Samples within which a fault may be found that are looked at, besides the most that are asked for.
SAMPLES = (1, 3)
#: Faults that are surely found, alike.
_FOUND: dict[str, list] = {}


def found_faults(plant, t, cert: dict, asked: int | list[dict], kept: dict | None = None) -> list[dict]:
    """Steps of faults that leave no mode possible, anew from the widths of a certificate (``mode_faults``).

    Parameters
    ----------
    plant, t, cert, kept
        As of ``proved``.
    asked : int or list of dict
        As of ``prove``.

    Returns
    -------
    list of dict
    """
    claims, own = claims_on(plant, t, cert, kept), {k: v for k, v in t.to_dict().items() if k not in FRAMERS}
    if isinstance(asked, int):
        samples = [n for n in SAMPLES if n < asked] + [asked] * (asked > 0)
        asked = [(f.name, n, np.inf) for f in plant.f for n in samples]
        better = True
    else:
        asked, better = [(f["channel"], f["within"], f.get("upto", np.inf)) for f in asked], False
    acting = [[getattr(m, n).tolist() for n in ("Df", "Bf", "A")] for m in plant.modes], [
        [f.name, f.lo, f.hi] for f in plant.f]
    key = digest(own, [cert["widths"], cert["quiet"], cert["dwell"], asked, better], [side.tolist() for side in (
        *claims.x, *claims.u)], acting)
    if key not in _FOUND or kept is not None:
        if len(_FOUND) >= 32:
            _FOUND.clear()
        _FOUND[key] = surely_found(plant, claims, np.array(cert["widths"]), cert["quiet"], asked, better)
    return _FOUND[key]


def proved(plant, t, cert: dict, kept: dict | None = None) -> ModeDelays:
    """The delays anew, from the widths of a certificate.

    Parameters
    ----------
    plant : Plant
    t : ModeTables
    cert : dict
    kept : dict or None
        Takes the multipliers behind them (``mode_witness``).

    Returns
    -------
    ModeDelays

    Raises
    ------
    CertificateError
    """
    claims = claims_on(plant, t, cert, kept)
    rests = [*(cert[name] for name in ("widths", "old", "dwell", "horizon")), "restart" in cert]
    own = {name: value for name, value in t.to_dict().items() if name not in FRAMERS}
    key = digest(own, rests, [side.tolist() for side in (*claims.x, *claims.u)])
    if key not in _KNOWN or kept is not None:
        old = {(i, j): cert["old"][i][j] - 1 for i, j in claims.pairs}
        found = claims.again(np.array(cert["widths"]), old, "restart" in cert)
        if len(_KNOWN) >= 32:
            _KNOWN.clear()
        _KNOWN[key] = found
    return _KNOWN[key]


def check(plant, t, cert: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the constant or the pair of modes.
    """
    check_enclosure(plant, t)
    if t.ages != cert["ages"] or cert["dwell"] > dwell_samples(plant):
        raise CertificateError(f"certificate: for {cert['ages']} ages and a dwell time of {cert['dwell']} samples, the "
                               f"tables have {t.ages} and the plant {dwell_samples(plant)}.")
    found = proved(plant, t, cert)
    for name, fresh in (("old", found.old), ("identified", found.identified)):
        for (i, j), samples in fresh.items():
            if cert[name][i][j] < samples:
                raise CertificateError(f"certificate: {name} of the switch from {plant.modes[i].name} to "
                                       f"{plant.modes[j].name} is {cert[name][i][j]} samples, only {samples} proved.")
    single = {"quiet": found.quiet, "start": found.start, "worst": found.worst}
    single |= {"restart": found.restart, "calm": found.calm} if "restart" in cert else {}
    for name, fresh in single.items():
        if fresh is None or cert[name] is None or cert[name] < fresh:
            raise CertificateError(f"certificate: {name} is {cert[name]} samples, only {fresh} proved.")
    if cert.get("faults"):
        fresh = {(f["channel"], f["within"]): f for f in found_faults(plant, t, cert, cert["faults"])}
        for f in cert["faults"]:
            of = fresh.get((f["channel"], f["within"]), {"size": np.inf, "after": 0})
            if f["size"] < of["size"] or f["after"] < of["after"] or f.get("upto", np.inf) > of.get("upto", np.inf):
                raise CertificateError(f"certificate: the fault {f['channel']} is claimed to be found from "
                                       f"{f['size']:.6g} on, only {of['size']:.6g} is proved.")
    return sentences(plant, t, cert)


def sentences(plant, t, cert: dict) -> list[str]:
    """What a certificate says."""
    T, names = plant.sample_period, [m.name for m in plant.modes]

    def time(samples: int) -> str:
        return f"{samples} samples ({samples * T:.4g} s)" if samples != 1 else f"1 sample ({T:.4g} s)"

    after = [] if "restart" not in cert else [
        "after a reset, and after an alarm from the second sample without one on, mode is right after "
        f"{time(cert['restart'])} at the latest, and after {time(cert['calm'])} all that is said of switches holds "
        "again, if neither a switch nor a fault comes before that"]
    seen = [_seen(plant, f, time) for f in cert.get("faults", ())]
    pairs = [(i, j) for i in range(len(names)) for j in range(len(names)) if i != j]
    anywhere = "at any instant" if plant.kind == "continuous" else (
        "at any sample (a mode that acts from a sample on is in the set at the next one)")
    each = "; ".join(f'"{names[i]}" to "{names[j]}" {cert["old"][i][j]} and {cert["identified"][i][j]}'
                     for i, j in pairs)
    return [
        "the true mode is in mode_set and x_lo <= x <= x_hi at every sample while no fault acts, so that no alarm is "
        f"false, through switches too, which may fall {anywhere}, {time(t.ages + 1)} apart at least; all "
        f"rounding is included ({t.real}, with or without fused multiply-add)",
        f"a switch is identified within {time(cert['worst'])}: from then to the next switch mode is the true one, "
        f"where switches are {time(cert['dwell'])} apart at least and no measurement is missing",
        f"samples after which the old mode is out of mode_set, and after which mode is right: {each}",
        f"from power-up within the initial box mode is right after {time(cert['start'])} at the latest, if the first "
        f"switch is {time(cert['dwell'])} later or more",
        f"a wrong mode that is taken up while the mode stays is out of mode_set within {time(cert['quiet'])}; the "
        f"oldest age {t.ages} is beyond that", *after, *seen,
    ]


def _seen(plant, f: dict, time) -> str:
    """What is promised of a fault."""
    size = f"{_six(f['size'], ROUND_CEILING)} or more"
    size += f" and {_six(f['upto'], ROUND_FLOOR)} or less" if "upto" in f else ""
    lasts = " it lasts that long," if f["within"] > 1 else ""
    moves = plant.acts_on_state(f["channel"])
    inside = " x stays within its range," if moves else ""
    at = " at a sample," if moves and plant.kind == "continuous" else ""  # not for a part of a period before it
    return (f'a step of the fault "{f["channel"]}" of {size}, either way, leaves no mode possible within '
            f"{time(f['within'])} of its first one, if{lasts} it begins{at} {time(f['after'])} or more after power-up "
            f"and the last switch, no alarm came before, the mode stays,{inside} and measurements are neither missing "
            "nor refused")


def _six(x: float, rounding: str) -> str:
    """Six digits, rounded so that what is said holds."""
    return f"{float(Context(prec=6, rounding=rounding).create_decimal_from_float(x)):.6g}"
