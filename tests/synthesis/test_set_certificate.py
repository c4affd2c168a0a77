"""Certificates of error sets: what holds is accepted, each number tampered with is refused, and files keep it all."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.points import point_design, random_plant

from codegen.certify import set_claims
from codegen.designs import Design, read_design
from codegen.errors import CertificateError
from codegen.observers import PointTables


@pytest.fixture(scope="module")
def designs():
    """A set of each kind, all of a TNL observer."""
    plant = random_plant(seed=1, schedule=(0, 0, 1, 2, 2))
    return {"zonotope": point_design(plant, "tnl", order=6),
            "thresholds": point_design(plant, "tnl", tables="dwell", dwell=2, rows=4, stages=3),
            "schedule": point_design(plant, "tnl", tables="schedule", rows=4),
            "blocks": point_design(plant, "tnl", tables="arbitrary", rows=3, order=5),
            "ellipsoid": point_design(plant, "tnl", set="ellipsoid"),
            "box": point_design(plant, "tnl", set="interval"),
            "turned": point_design(plant, "tnl", set="interval", turn=[[1, 0.3, 0], [-0.2, 1, 0.4], [0.1, 0, 0.7]]),
            "ellipsoid_trace": point_design(plant, "tnl", set="ellipsoid", weights="trace")}


def smaller(value, share=0.9):
    """The same numbers, nearer to zero."""
    return (value * value.dtype.type(share)).astype(value.dtype)


ZONOTOPE = {
    "e": lambda t, c: (shape(t, e=smaller(t.shape.e)), c),
    "spread": lambda t, c: (shape(t, spread=smaller(t.shape.spread)), c),
    "rho": lambda t, c: (shape(t, rho=smaller(t.shape.rho)), c),
    "slack": lambda t, c: (shape(t, slack=smaller(t.shape.slack)), c),
    "floor": lambda t, c: (shape(t, floor=t.shape.floor * 0), c),
    "a generator of a step": lambda t, c: (shape(t, F=smaller(t.shape.F, 0.999)), c),
    "a generator of a blind step": lambda t, c: (shape(t, Fb=smaller(t.shape.Fb, 0.999)), c),
    "noise of the residual": lambda t, c: (shape(t, V=smaller(t.shape.V, 0.999)), c),
    "a column left out": lambda t, c: (shape(t, F=t.shape.F[..., 1:]), c),
    "order": lambda t, c: (shape(t, order=2), c),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.999)), c),
    "N": lambda t, c: (replace(t, N=smaller(t.N, 0.999)), c),
    "M": lambda t, c: (replace(t, M=smaller(t.M, 0.999)), c),
    "centre": lambda t, c: (replace(t, d=t.d + np.float32(1e-3)), c),
    "kind": lambda t, c: (replace(t, kind="luenberger"), c),
    "box": lambda t, c: (replace(t, box=smaller(t.box)), c),
    "limit": lambda t, c: (replace(t, limit=smaller(t.limit, 0.1), box=t.box), c),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": [1e-9] * 3}}),
    "hull": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"half": [1e-9] * 3}}),
}
THRESHOLDS = {
    "threshold": lambda t, c: (shape(t, h=smaller(t.shape.h)), c),
    "the last row": lambda t, c: (shape(t, h=rows(t.shape.h, slice(-1, None))), c),
    "the first stage": lambda t, c: (shape(t, h=np.concatenate([smaller(t.shape.h[:1]), t.shape.h[1:]])), c),
    "bounds of x": lambda t, c: (shape(t, hx=smaller(t.shape.hx)), c),
    "anew": lambda t, c: (shape(t, anew=1), c),
    "direction": lambda t, c: (shape(t, directions=-t.shape.directions[::-1]), c),
    "dwell": lambda t, c: (shape(t, dwell=1), c),
    "boxes": lambda t, c: (t, c | {"main": c["main"] | {"boxes": (0.5 * np.array(c["main"]["boxes"])).tolist()}}),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.99)), c),
    "box": lambda t, c: (replace(t, box=t.box * np.float32(1.5)), c),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": [1e-9] * 3}}),
}

SCHEDULE = {
    "the initial box": lambda t, c: (shape(t, h=some(t.shape.h, slice(0, 1), 0.99)), c),
    "anew": lambda t, c: (shape(t, h=some(t.shape.h, slice(4, 5), 0.99)), c),
    "anew, later": lambda t, c: (shape(t, h=some(t.shape.h, slice(13, 14), 0.99)), c),
    "for ever": lambda t, c: (shape(t, h=some(t.shape.h, slice(-1, None), 0.99)), c),
    "bounds of x": lambda t, c: (shape(t, hx=some(t.shape.hx, slice(-2, -1), 0.99)), c),
    "another schedule": lambda t, c: (shape(t, cycle=(0, 0, 2, 1, 1)), c),
    "a longer schedule": lambda t, c: (shape(t, cycle=(0, 0, 1, 2, 2, 2)), c),
    "entry": lambda t, c: (shape(t, entry=(2, 2, 3)), c),
    "rows": lambda t, c: (shape(t, rows=3), c),
    "direction": lambda t, c: (shape(t, directions=-t.shape.directions[::-1]), c),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.99)), c),
    "box": lambda t, c: (replace(t, box=t.box * np.float32(1.5)), c),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": [1e-9] * 3}}),
}
BLOCKS = {name: lambda t, c, name=name: (shape(t, **{name: smaller(getattr(t.shape, name), 0.999)}), c)
          for name in ("rows", "scalars", "noise", "powers", "pushed", "start", "anywhere")} | {
    "limit": lambda t, c: (shape(t, most=t.shape.most * np.float32(1.5)), c),
    "limit below the first errors": lambda t, c: (shape(t, most=smaller(t.shape.most, 0.5)), c),
    "e": lambda t, c: (shape(t, e=smaller(t.shape.e, 0.9)), c),
    "a column left out": lambda t, c: (shape(t, pushed=t.shape.pushed[..., 1:]), c),
    "a shorter block": lambda t, c: (shape(t, powers=t.shape.powers[:, 1:]), c),
    "order": lambda t, c: (shape(t, order=3), c),
    "more generators": lambda t, c: (shape(t, order=50), c),
    "direction": lambda t, c: (shape(t, directions=-t.shape.directions[::-1]), c),
    "wide": lambda t, c: (shape(t, wide=t.shape.wide * np.float32(1e3)), c),
    "C": lambda t, c: (replace(t, C=t.C * np.array([1, 1, 2], np.float32)[:, None, None]), c),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.999)), c),
    "box": lambda t, c: (replace(t, box=t.box * np.float32(1.5)), c),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": [1e-9] * 3}}),
    "hull": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"half": [1e-9] * 3}}),
}

ELLIPSOID = {
    "noise of a step": lambda t, c: (shape(t, H=smaller(t.shape.H, 0.9999)), c),
    "noise of a blind step": lambda t, c: (shape(t, Hb=smaller(t.shape.Hb, 0.9999)), c),
    "noise of the residual": lambda t, c: (shape(t, V=smaller(t.shape.V, 0.9999)), c),
    "not symmetric": lambda t, c: (shape(t, H=t.shape.H + np.triu(np.abs(t.shape.H) * np.float32(1e-6), 1)), c),
    "weight": lambda t, c: (shape(t, g=smaller(t.shape.g, 0.99)), c),
    "weight below one": lambda t, c: (shape(t, gr=smaller(t.shape.gr, 0.1)), c),
    "rounding of a step": lambda t, c: (shape(t, k=smaller(t.shape.k)), c),
    "rounding of the residual": lambda t, c: (shape(t, kr=smaller(t.shape.kr)), c),
    "trace": lambda t, c: (shape(t, weight=smaller(t.shape.weight, 0.25)), c),
    "trace of odd weights": lambda t, c: (shape(t, weight=smaller(t.shape.weight, 0.5)), c),
    "slope": lambda t, c: (shape(t, a=smaller(t.shape.a)), c),
    "offset of a residual": lambda t, c: (shape(t, by=smaller(t.shape.by)), c),
    "spread": lambda t, c: (shape(t, spread=smaller(t.shape.spread)), c),
    "slack": lambda t, c: (shape(t, slack=smaller(t.shape.slack)), c),
    "floor": lambda t, c: (shape(t, floor=t.shape.floor * 0), c),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.999)), c),
    "box": lambda t, c: (replace(t, box=smaller(t.box)), c),
}


TRACE = {
    **{what: ELLIPSOID[what] for what in ("noise of a step", "noise of a blind step", "noise of the residual",
                                          "not symmetric", "rounding of a step", "rounding of the residual",
                                          "trace of odd weights", "spread", "slack", "floor", "L", "box")},
    "trace": lambda t, c: (shape(t, weight=smaller(t.shape.weight, 0.25)), c),
    "trace of residuals": lambda t, c: (shape(t, weight_y=smaller(t.shape.weight_y, 0.25)), c),
    "scale": lambda t, c: (shape(t, scale=smaller(t.shape.scale, 1 - 1e-6)), c),
    "scale of a residual": lambda t, c: (shape(t, scale_y=smaller(t.shape.scale_y, 1 - 1e-6)), c),
    "tangent": lambda t, c: (shape(t, a=t.shape.a[::-1]), c),
    "least number of a root": lambda t, c: (shape(t, least=smaller(t.shape.least)), c),
    "one over the trace": lambda t, c: (shape(t, r=smaller(t.shape.r, 0.5)), c),
    "shrinks more": lambda t, c: (t, c | {"shrink": [0.9 * x for x in c["shrink"]]}),
    "shrinks not": lambda t, c: (t, c | {"shrink": [1.0] * 3}),
    "largest trace": lambda t, c: (t, c | {"trace": 0.99 * c["trace"]}),
    "beyond the roots": lambda t, c: (t, c | {"trace": 2.0**40}),
    "half": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"half": (
        0.99 * np.array(c["steady_box"]["half"])).tolist()}}),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": (
        0.99 * np.array(c["steady_box"]["width"])).tolist()}}),
}
BOX = {
    "size of M": lambda t, c: (shape(t, P=smaller(t.shape.P, 1 - 2**-23)), c),
    "size of A": lambda t, c: (shape(t, Pb=smaller(t.shape.Pb, 1 - 2**-23)), c),
    "size of C": lambda t, c: (shape(t, S=smaller(t.shape.S, 1 - 2**-23)), c),
    "what a step adds": lambda t, c: (shape(t, g=smaller(t.shape.g, 0.99)), c),
    "what a blind step adds": lambda t, c: (shape(t, gb=smaller(t.shape.gb, 0.99)), c),
    "noise of the residual": lambda t, c: (shape(t, rho=smaller(t.shape.rho, 0.99)), c),
    "noise of another gain": lambda t, c: (shape(t, rho=t.shape.rho[:, ::-1]), c),
    "an origin left out": lambda t, c: (shape(t, g=t.shape.g[:, 1:]), c),
    "spread": lambda t, c: (shape(t, spread=smaller(t.shape.spread)), c),
    "L": lambda t, c: (replace(t, L=smaller(t.L, 0.999)), c),
    "N": lambda t, c: (replace(t, N=smaller(t.N, 0.999)), c),
    "box": lambda t, c: (replace(t, box=smaller(t.box)), c),
    "limit": lambda t, c: (replace(t, limit=smaller(t.limit, 0.1)), c),
    "width": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"width": smaller(
        np.array(c["steady_box"]["width"]), 0.999).tolist()}}),
    "half": lambda t, c: (t, c | {"steady_box": c["steady_box"] | {"half": smaller(
        np.array(c["steady_box"]["half"]), 0.999).tolist()}}),
}


def shape(t: PointTables, **changes) -> PointTables:
    """Other numbers in the set's tables."""
    return replace(t, shape=replace(t.shape, **changes))


def some(h, which, share):
    """Some rows of a list smaller."""
    out = h.copy()
    out[which] = smaller(out[which], share)
    return out


def rows(h, which):
    """Some rows of the table smaller."""
    out = h.copy()
    out[:, :, which] = smaller(out[:, :, which])
    return out


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("family", ["zonotope", "thresholds", "schedule", "blocks", "ellipsoid", "box", "turned",
                                    "ellipsoid_trace"])
def test_what_holds_is_accepted(family, real, designs):
    design = designs[family]
    claims = set_claims.check(design.plant.modes, design.observer.tables[real], design.certificate[real])
    assert "no false alarm" in claims[0] and real in claims[0]


@pytest.mark.parametrize("what", ZONOTOPE)
def test_a_zonotope_tampered_with_is_refused(what, designs):
    check(designs["zonotope"], ZONOTOPE[what])


@pytest.mark.parametrize("what", THRESHOLDS)
def test_a_table_tampered_with_is_refused(what, designs):
    check(designs["thresholds"], THRESHOLDS[what])


@pytest.mark.parametrize("what", SCHEDULE)
def test_a_list_tampered_with_is_refused(what, designs):
    check(designs["schedule"], SCHEDULE[what])


@pytest.mark.parametrize("what", BLOCKS)
def test_blocks_tampered_with_are_refused(what, designs):
    check(designs["blocks"], BLOCKS[what])


@pytest.mark.parametrize("what", ELLIPSOID)
def test_an_ellipsoid_tampered_with_is_refused(what, designs):
    check(designs["ellipsoid"], ELLIPSOID[what])


TURNED = BOX | {
    "coordinates": lambda t, c: (shape(t, T=t.shape.T[::-1].copy()), c),
    "no inverse": lambda t, c: (shape(t, T=t.shape.T * 0), c),
    "size of the coordinates": lambda t, c: (shape(t, R=smaller(t.shape.R, 1 - 2**-23)), c),
    "size of their inverse": lambda t, c: (shape(t, Z=smaller(t.shape.Z, 1 - 2**-23)), c),
}


@pytest.mark.parametrize("what", BOX)
def test_a_box_tampered_with_is_refused(what, designs):
    check(designs["box"], BOX[what])


@pytest.mark.parametrize("what", TURNED)
def test_a_turned_box_tampered_with_is_refused(what, designs):
    check(designs["turned"], TURNED[what])


@pytest.mark.parametrize("what", TRACE)
def test_an_ellipsoid_of_least_trace_tampered_with_is_refused(what, designs):
    check(designs["ellipsoid_trace"], TRACE[what])


def check(design: Design, tamper) -> None:
    """The certificate no longer holds for the changed numbers."""
    t, cert = tamper(design.observer.tables["float32"], design.certificate["float32"])
    with pytest.raises(CertificateError, match=r"certificate: |tables: "):
        set_claims.check(design.plant.modes, t, cert)


@pytest.mark.parametrize("weights", ["fixed", "trace"])
def test_squares_that_overflow_are_refused(weights):
    """Ranges of 5e11: in float32 the membership test would meet infinity minus infinity, and alarm; boxes hold them."""
    plant, f = random_plant(seed=8), 1e11
    wide = {v: tuple(replace(s, lo=s.lo * f, hi=s.hi * f) for s in getattr(plant, v)) for v in "xy"}
    modes = tuple(replace(m, **{k: getattr(m, k) * f for k in ("B", "Bw", "Dv", "Bf", "Df")}) for m in plant.modes)
    plant = replace(plant, modes=modes, x0_lo=plant.x0_lo * f, x0_hi=plant.x0_hi * f, **wide)
    with pytest.raises(CertificateError, match="not finite in float32. Use float64"):
        point_design(plant, "tnl", set="ellipsoid", weights=weights)
    assert point_design(plant, "tnl", set="interval").certificate["float32"]["steady_box"]


@pytest.mark.parametrize("change", [{"D": np.ones((2, 1))}, {"C": np.ones((2, 3))}])
def test_a_gain_on_the_new_output_asks_for_a_plain_output(change, designs):
    """N y+ would hold the new input, or the C of another mode: refused although every number is in order."""
    design = designs["zonotope"]
    modes = [design.plant.modes[0], replace(design.plant.modes[1], **change), design.plant.modes[2]]
    with pytest.raises(CertificateError, match="beside a gain N"):
        set_claims.check(modes, design.observer.tables["float32"], design.certificate["float32"])


@pytest.mark.parametrize("family", ["zonotope", "thresholds", "schedule", "blocks", "ellipsoid", "box", "turned",
                                    "ellipsoid_trace"])
def test_design_json_keeps_every_number(family, designs, tmp_path):
    """Tables and family come back as they were written."""
    from helpers.points import TOML

    made = designs[family]
    plant = replace(made.plant, text=TOML)
    back = read_design(replace(made, plant=plant).save(tmp_path / "design.json"))
    assert type(back.observer) is type(made.observer)
    for real, t in made.observer.tables.items():
        assert back.observer.tables[real].to_dict() == t.to_dict()
        assert back.observer.tables[real].M.dtype == t.dtype
