"""What the certificate accepts is true, and what it must refuse it refuses, by the exact conditions alone."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact import GALLERY

from codegen.certify import claims
from codegen.certify.claims import check, check_monitor, check_ranges, prove
from codegen.certify.exact import inverse, rational
from codegen.certify.freeze import limits, with_offsets
from codegen.designs import read_design, recheck
from codegen.errors import CertificateError, ResiduaError
from codegen.plant.load import load

SIDES = ("hi", "lo")
KINDS = {"linf": {"criterion": "linf", "lambda": 0.3}, "width": {"criterion": "width", "contraction": 0.3}}


@pytest.fixture
def design(workshop, request):
    return pick(workshop, request.param)


def pick(workshop, name):
    """A gallery design "plant method", or "width"/"linf": the small example designed by that criterion."""
    if name in KINDS:
        return workshop.text(f"zammali {name}", load("zammali_fd").text, "interval", **KINDS[name])
    return workshop.gallery(*name.split())


ALL = [" ".join(g) for g in GALLERY] + list(KINDS)
designs = pytest.mark.parametrize("design", ALL, indirect=True)


def altered(design, real="float32", tables=None, cert=None, supervision=None):
    """A design with other numbers; its digest is made anew when it is saved."""
    observer = type(design.observer)({**design.observer.tables, real: tables or design.observer.tables[real]},
                                     supervision or design.observer.supervision)
    return replace(design, observer=observer,
                   certificate={**design.certificate, real: cert or design.certificate[real]})


def only(design, real):
    """The design in one number type."""
    observer = type(design.observer)({real: design.observer.tables[real]}, design.observer.supervision)
    kept = {name: {real: getattr(design, name)[real]} for name in ("certificate", "proved", "detection")}
    return replace(design, observer=observer, **kept)


def verify(design):
    """Everything that is checked of a design: the certificate, its ranges, its dwell monitor."""
    recheck(design)
    for real, t in design.observer.tables.items():
        check_ranges(limits(design.plant), t)
        check_monitor(design.observer.supervision, design.certificate[real])


@designs
def test_certificate_holds_after_a_round_trip(design, tmp_path):
    again = read_design(design.save(tmp_path / "design.json"))
    verify(again)
    assert recheck(again) == again.proved
    assert again.digest == design.digest
    for real, t in design.observer.tables.items():
        for name in t.__dataclass_fields__:
            assert np.array_equal(getattr(t, name), getattr(again.observer.tables[real], name)), name


# -- tampering: one constant, one part in a thousand ------------------------------------------------
def nudged(t, name, share, sign=0):
    """The table with the largest entry of a constant changed by a share of itself (sign: towards +1 or -1)."""
    value = np.array(getattr(t, name))
    if not np.any(value):
        return None
    index = np.unravel_index(np.argmax(np.abs(value)), value.shape)
    old = value[index]
    value[index] = old * (1 + share) if sign == 0 else old + sign * share * abs(old)
    assert value[index] != old
    return replace(t, **{name: value})


#: Constant -> direction in which the claim becomes false (0: either).
TABLE = {**{k + s: 0 for k in ("M_", "G_", "L_", "N_") for s in SIDES}, "A": 0, "B": 0, "C": 0, "D": 0,
         "d_hi": -1, "d_lo": +1, "a_hi": -1, "a_lo": +1, "c_hi": -1, "c_lo": +1,
         "x_lo": +1, "x_hi": -1, "x0_lo": +1, "x0_hi": -1, "box": -1}


@designs
def test_changed_table_is_refused(design, tmp_path):
    """Digest recomputed, so only the exact conditions speak. Names every constant that was let through."""
    let_through, tried = [], 0
    for real in design.observer.tables:
        t = design.observer.tables[real]
        for name, sign in TABLE.items():
            for share in (1e-3, -1e-3) if sign == 0 else (1e-3,):
                changed = nudged(t, name, share, sign)
                if changed is None:
                    continue
                tried += 1
                bad = read_design(only(altered(design, real, changed), real).save(tmp_path / "design.json"))
                try:
                    verify(bad)
                    let_through.append((real, name, share))
                except CertificateError:
                    pass
    assert not let_through
    assert tried > 40


@designs
def test_every_offset_and_box_is_needed(design):
    """Not only the largest: each single offset, moved inward by half a per cent of itself, is refused.

    Margins are tabulated a thousandth larger than need be (``freeze.sound_offset``), and where the disturbance
    lies on one side of zero the margin may be several times what remains of the offset.
    """
    modes, t = design.plant.modes, design.observer.tables["float32"]
    for name in ("d", "a", "c"):
        for side, sign in (("hi", -1), ("lo", +1)):
            value = getattr(t, f"{name}_{side}")
            for index in np.ndindex(value.shape):
                moved = np.array(value)
                moved[index] += sign * 5e-3 * abs(moved[index])
                if moved[index] == value[index]:
                    continue  # an offset of exactly zero
                with pytest.raises(CertificateError, match=rf"offset {name}_{side}\[{index[1]}\]"):
                    check(modes, replace(t, **{f"{name}_{side}": moved}), design.certificate["float32"])


def scaled(value, share):
    """A nested list with its largest entry changed."""
    array = np.array(value, dtype=float)
    index = np.unravel_index(np.argmax(np.abs(array)), array.shape)
    array[index] *= 1 + share
    return array.tolist()


#: Certificate field -> (kind or None, share) of a change that makes the claim false.
CERT = {"mu": [-1e-3], "lam": [1e-3, -1e-3], "level": [-1e-3], "rho": [-1e-3], "P_hi": [1e-3, -1e-3],
        "P_lo": [1e-3, -1e-3], "a": [1e-3], "p": [1e-3, -1e-3]}


@pytest.mark.parametrize("design", ["linf", "width", "relay interval"], indirect=True)
def test_changed_certificate_is_refused(design, tmp_path):
    cert, tried = design.certificate["float32"], 0
    for name, shares in CERT.items():
        for share in shares if name in cert else ():
            value = scaled(cert[name], share)
            bad = altered(design, cert={**cert, name: value if np.ndim(value) else float(value)})
            bad = read_design(bad.save(tmp_path / "design.json"))
            with pytest.raises(CertificateError):
                verify(bad)
            tried += 1
    assert tried >= 4


@designs
def test_smaller_box_is_refused(design):
    cert = design.certificate["float32"]
    if not cert["steady_box"]:
        assert cert["kind"] == "linf" and cert["rho"] > 1
        return
    for side in SIDES:
        for i in range(design.plant.n_x):
            z = {s: list(cert["steady_box"][s]) for s in SIDES}
            z[side][i] *= 1 - 1e-3 if cert["kind"] != "linf" else 0.9
            with pytest.raises(CertificateError, match="the error box is left"):
                check(design.plant.modes, design.observer.tables["float32"], {**cert, "steady_box": z})


def test_shorter_dwell_time_is_refused(workshop):
    """In the certificate (by the exact factor) and in the firmware's monitor (by comparison with the certificate)."""
    design = workshop.gallery("relay", "interval")
    modes, t, cert, s = (design.plant.modes, design.observer.tables["float32"], design.certificate["float32"],
                         design.observer.supervision)
    for change in ({"dwell_add": cert["dwell_add"] - 1}, {"dwell_drain": cert["dwell_drain"] + 1},
                   {"chatter": cert["chatter"] * 1.001}, {"chatter": cert["chatter"] + 1}):
        with pytest.raises(CertificateError, match="claimed, only|too short"):
            check(modes, t, {**cert, **change})
    check_monitor(s, cert)
    check_monitor(replace(s, dwell_add=s.dwell_add + 1), cert)  # slower than asked is fine
    for change in ({"dwell_add": s.dwell_add - 1}, {"dwell_drain": s.dwell_drain + 1},
                   {"dwell_limit": s.dwell_limit + 1}, {"dwell_add": 0, "dwell_drain": 0, "dwell_limit": 0}):
        with pytest.raises(CertificateError, match="dwell monitor"):
            check_monitor(replace(s, **change), cert)


# -- tampering: the digest -------------------------------------------------------------------------
def leaves(value, path=()):
    """Paths of all numbers, texts and flags in a JSON value."""
    if isinstance(value, dict):
        for k, v in value.items():
            yield from leaves(v, (*path, k))
    elif isinstance(value, list):
        for i, v in enumerate(value):
            yield from leaves(v, (*path, i))
    else:
        yield path, value


def put(data, path, value):
    for step in path[:-1]:
        data = data[step]
    data[path[-1]] = value


def other(value):
    """Another value of the same type; a float becomes its neighbour in float32, the coarser type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return float(np.nextafter(np.float32(value), np.float32(np.inf)))
    return "something else" if value is None or value == "" else value[:-1] + chr(ord(value[-1]) ^ 1)


COVERED = ("tables", "certificate", "supervision", "plant", "method", "family")


@pytest.mark.parametrize("design", ["linf", "relay interval"], indirect=True)
def test_any_change_is_refused_by_the_digest(design, tmp_path):
    """Every leaf under the keys that the digest covers (text of the plant file: one letter)."""
    text = design.to_json()
    data = json.loads(text)
    paths = [(p, v) for p, v in leaves(data) if p[0] in COVERED]
    rng = np.random.default_rng(0)
    sample = rng.permutation(len(paths))[:150]
    # All of the small tables, and some of the large ones.
    chosen = [paths[i] for i in sample] + [(p, v) for p, v in paths if p[0] in ("supervision", "method", "family")]
    file = tmp_path / "design.json"
    for path, value in chosen:
        if path == ("plant", "name"):
            continue  # a repetition; the name that counts is in the text
        changed = json.loads(text)
        put(changed, path, other(value))
        file.write_text(json.dumps(changed))
        with pytest.raises(ResiduaError) as caught:
            read_design(file)
        assert isinstance(caught.value, CertificateError) or path[0] == "plant", (path, caught.value)
    file.write_text(text)
    read_design(file)


# -- one negative test per message -----------------------------------------------------------------
def box_refusal(design):
    """A table whose second state cannot settle: the box design has nothing to offer."""
    plant, t = design.plant, design.observer.tables["float32"]
    M = np.array(t.M_hi)
    M[:, 1, 1] = 1.5
    return prove(plant.modes, with_offsets(plant.modes, replace(t, M_hi=M, M_lo=M)), {"kind": "box"})


def with_cert(**changes):
    def act(design):
        return check(design.plant.modes, design.observer.tables["float32"],
                     {**design.certificate["float32"], **changes})
    return act


def with_table(make):
    def act(design):
        t = design.observer.tables["float32"]
        return check(design.plant.modes, replace(t, **make(t)), design.certificate["float32"])
    return act


def negative(t):
    M = np.array(t.M_hi)
    M[0, 0, 0] = -1e-7
    return {"M_hi": M}


def inflated(design):
    """Offsets made for a box that the framers can leave."""
    plant, t = design.plant, design.observer.tables["float32"]
    small = with_offsets(plant.modes, replace(t, box=np.maximum(np.abs(t.x_lo), np.abs(t.x_hi)), clamp=False))
    return check(plant.modes, small, design.certificate["float32"])


def prove_linf(**changes):
    def act(design):
        cert = design.certificate["float32"]
        return prove(design.plant.modes, design.observer.tables["float32"], {**cert, **changes})
    return act


def jump(design):
    cert = design.certificate["float32"]
    return with_cert(rho=float(np.sqrt(cert["rho"])))(design)


def other_coordinates(cert=None, **changes):
    """Parts of the change of coordinates, or of its certificate, scaled."""
    def act(design):
        t = design.observer.tables["float32"]
        change = replace(t.change, **{k: getattr(t.change, k) * np.float32(v) for k, v in changes.items()})
        return check(design.plant.observed.modes, replace(t, change=change),
                     {**design.certificate["float32"], **(cert or {})})
    return act


def mixed(**changes):
    """The certificate of a table whose entries take the opposite bound, changed."""
    def act(design):
        return check(design.plant.observed.modes, design.observer.tables["float32"],
                     {**design.certificate["float32"], **changes})
    return act


MESSAGES = [
    (r"the error boxes of both framers differ, expected equal ones", "lamouchi component-interval",
     mixed(steady_box={"hi": [9.0, 9.0], "lo": [8.0, 8.0], "width": [17.0, 17.0]})),
    (r"follows each framer's error by itself, but entries of T A - L C take", "lamouchi component-interval",
     mixed(kind="linf", lam=0.1, mu=1.0, rho=1.0)),
    (r"no level mu satisfies the Lyapunov inequality", "linf", prove_linf(lam=0.97)),
    (r"no box holds the framer errors of all modes", "linf", box_refusal),
    (r"level 0\.001 claimed, only \d", "linf", with_cert(level=0.001)),
    (r"width 0\.001 claimed, only \d", "width", with_cert(level=0.001)),
    (r"a box design without its box", "zammali_fd interval", with_cert(steady_box=None)),
    (r"kind 'magic' \(found\), expected linf, width, box or none", "linf", with_cert(kind="magic")),
    (r"negative entry -1e-07 at \(0, 0\) in mode \"1\" \(hi framer\)", "linf", with_table(negative)),
    (r"offset d_hi\[0\] in mode \"1\" is too small by", "linf", with_table(lambda t: {"d_hi": 0 * t.d_hi})),
    (r"the state box does not contain the declared ranges", "linf", with_table(lambda t: {"box": t.box / 1000})),
    (r"the framers can leave the state box", "press tnl-interval", inflated),
    (r"x0 box \[-0\.05.*, 0\.1.*\] of state 0 does not contain the declared \[-0\.1, 0\.1\]", "linf",
     lambda d: check_ranges(limits(d.plant), replace(d.observer.tables["float32"],
                                                     x0_lo=d.observer.tables["float32"].x0_lo / 2))),
    (r"the dwell monitor \(switch \+0, sample -0, limit 0\) admits faster switching", "relay interval",
     lambda d: check_monitor(replace(d.observer.supervision, dwell_add=0, dwell_drain=0, dwell_limit=0),
                             d.certificate["float32"])),
    (r"lambda is 1\.5 \(found\), expected 0 < lambda < 1", "linf", with_cert(lam=1.5)),
    (r"P_hi has an entry below 1", "linf", with_cert(P_hi=[[0.5, 1, 1]] * 3)),
    (r"the Lyapunov inequality fails in mode \"1\" \(hi framer, leading minor \d+ of 11\)", "linf", with_cert(mu=1e-3)),
    (r"jump from \"a to b\" to \"b to a\": P grows by 2\.\d+ at state 1, claimed at most 1\.\d+", "relay interval",
     jump),
    (r"average dwell time 1/1 samples is too short for jump factor 2\.\d+ and decay 0\.\d", "relay interval",
     with_cert(dwell_add=1)),
    (r"the copositive function needs p > 0 and 0 < a < 1", "width", with_cert(a=1.0)),
    (r"p' M <= \(1 - a\) p' fails in mode \"1\", state \d, by", "width", with_cert(a=0.5)),
    (r"the error box is left in mode \"1\" at state \d by", "zammali_fd interval",
     with_cert(steady_box={"hi": [1e-3] * 3, "lo": [1e-3] * 3})),
    (r"the range of z does not contain what Z makes of", "lamouchi_coordinates component-interval",
     other_coordinates(z_hi=0.999)),
    (r"the widths of x are less than what the box of z", "lamouchi_coordinates component-interval",
     other_coordinates({"x_width": [1.0, 1.0]})),
    (r"the change of coordinates has no inverse", "linf", lambda d: inverse(rational(np.ones((2, 2))))),
    (r"a constant is nan \(found\), expected a finite number", "linf", with_table(lambda t: {"C": t.C * np.nan})),
]


@pytest.mark.parametrize(("message", "name", "act"), MESSAGES, ids=[m[0][:40] for m in MESSAGES])
def test_refusal_says_what_is_wrong(workshop, message, name, act):
    with pytest.raises(CertificateError, match=message):
        act(pick(workshop, name))


#: What point observers and their sets refuse is tested beside them (test_set_certificate and others).
OF_FRAMERS = ("claims.py", "containment.py", "criteria.py", "dwell.py", "error_model.py", "exact.py", "freeze.py",
              "rounding.py", "variation.py")


def test_every_refusal_has_its_negative_test():
    folder = Path(claims.__file__).parent
    raised = sum(len(re.findall(r"raise CertificateError\(", f.read_text())) for f in folder.glob("*.py")
                 if f.name in OF_FRAMERS)
    assert raised == len(MESSAGES)
