"""The independent checker of delays: multipliers that prove them are enough; others, or shorter delays, are not."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from helpers.checker import checker_of
from helpers.kept import KEPT, family_of
from helpers.small_modes import exact_course, plant, tables

from codegen.certify.mode_certificate import claims_on
from codegen.certify.mode_claims import Claims
from codegen.certify.mode_delay import Story
from codegen.certify.mode_faults import FaultCourse, label
from codegen.certify.mode_witness import stated
from codegen.designs import read_design
from codegen.observers.mode_set import ModeSet
from codegen.plant.bounded import bounded

FOLDERS = [f for f in KEPT if family_of(f) in ("mode", "driven")]
TWO = next(f for f in FOLDERS if family_of(f) == "driven")  # modes: the quickest


checker = checker_of("delays", "story", "hidden")


def data_of(folder):
    data = json.loads((folder / "design.json").read_text())
    return data, [s["range"] for s in __import__("tomllib").loads(data["plant"]["toml"])["signals"]["x"]]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_every_committed_design_brings_its_multipliers(folder):
    """Small enough to keep, and of every kind of story; what they prove is checked with the folder."""
    data, _ = data_of(folder)
    for cert in data["certificate"].values():
        names = cert["witnesses"]
        faults = {f"{label(0, f['within'])}{sign}" for sign in "+-" for f in cert["faults"]}
        assert {name.split()[0] for name in names} == {"settled", "begun", "early"} | faults
        assert sum(map(len, names.values())) < 80_000 and all(v.split() for v in names.values())


def refuses(checker, change, words, folder=TWO):
    data, ranges = data_of(folder)
    data = copy.deepcopy(data)
    change(data["certificate"]["float32"], data["tables"]["float32"], data)
    with pytest.raises(SystemExit, match=f"refused: .*({words})"):
        checker["delays"].check(data, "float32", ranges)


def scaled(key, factor):
    def change(cert, t, data):
        def each(value):
            return [each(v) for v in value] if isinstance(value, list) else value * factor
        t[key] = each(t[key])
    return change


def shorter(key):
    def change(cert, t, data):
        whole = isinstance(cert[key], list)
        cert[key] = [[max(k - 1, 0) for k in row] for row in cert[key]] if whole else cert[key] - 1
    return change


def told(key, factor):
    return lambda cert, t, data: cert["faults"][0].__setitem__(key, cert["faults"][0][key] * factor)


def put(key, value):
    return lambda cert, t, data: cert.__setitem__(key, value)


FALSE = {
    "old mode": (shorter("old"), "delay of the old mode"), "decision": (shorter("identified"), "delay of the decision"),
    "worst": (shorter("worst"), "delay of the decision"), "start": (shorter("start"), "from power-up"),
    "quiet": (shorter("quiet"), "grow as old"), "widths": (
        lambda cert, t, data: cert.__setitem__("widths", [0.5 * w for w in cert["widths"]]), "wide in row"),
    "ages": (lambda cert, t, data: (cert.__setitem__("ages", 2), t.__setitem__("ages", 2)), "come of age|grow as old"),
    "dwell time": (put("dwell", 21), "dwell time"),
    "size of a fault": (told("size", 0.98), "may live with a fault"), "after": (told("after", 0.5), "is found"),
    "too soon": (told("within", 0), "is found"),
    "fault of other rows": (lambda cert, t, data: data["plant"].__setitem__("toml", data["plant"]["toml"].replace(
        "Df = [[1]]", "Df = [[0.9]]")), "may live with a fault"),
    "multipliers of a fault": (lambda cert, t, data: cert["witnesses"].pop(next(
        n for n in cert["witnesses"] if n.startswith("fault0-"))), "nothing bounds the fault"),
    "plant that stays for less": (lambda cert, t, data: data["plant"].__setitem__("toml", data["plant"]["toml"].replace(
        "minimum_dwell = 1 ", "minimum_dwell = 0.9 ")), "dwell time"),
    "more noise": (scaled("v_hi", 30), "may live|wide"), "more disturbance": (scaled("reach", 40), "may live|wide"),
    "modes alike": (lambda cert, t, data: t["Gamma"].__setitem__(1, t["Gamma"][0]), "may live|wide"),
    "births": (scaled("birth", 300), "may live|wide"), "a wider start": (scaled("start_hi", 4), "may live|wide"),
}


@pytest.mark.parametrize("name", FALSE)
def test_refuses_what_is_not_proved(name, checker):
    data, ranges = data_of(TWO)
    assert checker["delays"].check(data, "float32", ranges) == "delays hold, faults of the sizes told are found"
    refuses(checker, *FALSE[name])


def test_refuses_other_multipliers(checker):
    """None left out, none of another story, none changed by much or negative; none of a row that is not there."""
    data, _ = data_of(TWO)
    names = list(data["certificate"]["float32"]["witnesses"])
    dead = [n for n in names if n.split()[-1].lstrip("-").isdigit() and " hi " not in n and " lo " not in n]
    bounds = [n for n in names if n not in dead]

    def other(name, value):
        return lambda cert, t, data: cert["witnesses"].__setitem__(name, value(cert["witnesses"]))

    def word(words, at, change):
        words = words.split()
        return " ".join([*words[:at], change(words[at]), *words[at + 1:]])

    for name in (dead[0], dead[-1], bounds[0]):
        refuses(checker, lambda cert, t, data, n=name: cert["witnesses"].pop(n), "nothing refutes|nothing bounds")
        refuses(checker, other(name, lambda w, n=name: word(w[n], 2, lambda x: f"-{x}")), "negative multiplier")
        refuses(checker, other(name, lambda w, n=name: f"{w[n]} 999 1"), "multiplier of no row")
        refuses(checker, other(name, lambda w, n=name: word(w[n], 4, lambda x: f"{x}000")), "may live|wide in row")
    refuses(checker, other(dead[0], lambda w: w[dead[1]]), "may live")


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_rows_are_those_of_the_proof(real, checker):
    """Both state the same rows in the same order: with any multipliers both sums are the same but for their rooms."""
    design, rng = read_design(TWO), np.random.default_rng(1)
    t, cert = design.observer.tables[real], design.certificate[real]
    p, widths = bounded(design.plant), np.array(cert["widths"])
    own = Claims(t, p.limits("x"), p.limits("u"), cert["dwell"], cert["horizon"]).course(widths)
    F, exact = checker["delays"].F, checker["delays"].exact
    other = checker["story"].Stories(t.to_dict(), list(zip(*(x.tolist() for x in p.limits("x")))),
                                     exact(widths.tolist()))
    for story in (Story(0, 1, 0), Story(0, 1, 1, -1), Story(1, 0, 0, 1), Story(0, 0, 1, None, 1, "start"),
                  Story(1, 1, 1, 0, 0, "start"), Story(0, 0, 1, 0)):
        first = min(0, story.born or 0)
        program, _ = own.told(story, first, 2)
        given = (story.old, story.new, story.wrong, story.born, story.parent, story.begin)
        blocks = other.program(given, first, 2)
        assert sum(len(right) for _, right in blocks[0]) == len(program.rows)
        for at in rng.choice(len(program.rows), 25, replace=False):
            y = np.eye(1, len(program.rows), int(at))[0]
            mine, theirs = float(program.exactly(y, {})), float(other.bound(blocks, [(int(at), F(1))]))
            assert abs(mine - theirs) <= 2e-5 * (1 + abs(mine)), (story, at)


def test_rows_with_a_fault_are_those_of_the_proof(checker):
    design, rng = read_design(TWO), np.random.default_rng(2)
    t, cert, p = design.observer.tables["float32"], design.certificate["float32"], bounded(design.plant)
    claims, widths = claims_on(p, t, cert), np.array(cert["widths"])
    own = FaultCourse(claims, widths, -np.ones(1), np.array([0.2, -0.1]), np.zeros(2), 0.5)
    F, exact = checker["delays"].F, checker["delays"].exact
    other = checker["hidden"].FaultStories(t.to_dict(), list(zip(*(x.tolist() for x in p.limits("x")))),
                                           exact(widths.tolist()), exact([-1.0]), exact([0.2, -0.1]), 0, F(1, 2))
    for story in (Story(0, 0, 0), Story(1, 1, 0, -2), Story(0, 0, 1, 0)):
        first = min(-1, story.born or -1)
        program, _ = own.told(story, first, 1)
        given = (story.old, story.new, story.wrong, story.born, story.parent, story.begin)
        blocks, at_f = other.program(given, first, 1), int(program.fault[0])
        assert sum(len(right) for _, right in blocks[0]) == len(program.rows)
        for at in rng.choice(len(program.rows), 40, replace=False):
            y = np.eye(1, len(program.rows), int(at))[0]
            mine = float(program.exactly(y, {at_f: 1.0}))
            theirs = float(other.bound(blocks, [(int(at), F(1))], {other.at: F(1)}))
            assert abs(mine - theirs) <= 2e-5 * (1 + abs(mine)), (story, at)


@pytest.mark.parametrize("spoil", [None, "birth", "reach", "Gamma", "v_hi"])
def test_rows_hold_what_the_estimator_does(spoil, checker):
    """True courses with a switch inside a period, and boxes as they are calculated, meet every row; others do not."""
    p, t, ages = plant(), tables("one input", 3, "float32"), 3
    data, worst, seen = t.to_dict(), 0.0, 0
    if spoil:
        data[spoil] = (0.3 * np.array(data[spoil])).tolist()
    F, part, ranges = checker["delays"].F, checker["story"], list(zip(*(x.tolist() for x in p.limits("x"))))
    for seed in range(6):
        run, estimator = exact_course(p, 12, 30, seed), ModeSet(t)
        state, boxes = estimator.start(), []
        for u, y in zip(run.u.astype("float32"), run.y.astype("float32")):
            now = estimator.cut(state, estimator.seen(u, y))
            boxes.append((now.lo.astype(float), now.hi.astype(float), now.alive, estimator.seen(u, y)))
            estimator.step(state, u, y)
        q = [int(m) for m in run.q]
        for k in (k for k in range(2, 24) if q[k] != q[k + 1] and q[k - 2] == q[k]):
            for age, wrong, born in ((ages, q[k], None), (0, q[k + 1], 0)):
                mode = q[k] if born is None else wrong
                if not (boxes[k][2][q[k], ages] and boxes[k + 1][2][mode, age if born is not None else ages]):
                    continue
                story = (q[k], q[k + 1], wrong, born, None, "settled")
                widths = [F(float(b - a)) for a, b in zip(*(boxes[k][s][q[k], ages] for s in (0, 1)))]
                stories = part.Stories(data, ranges, widths)
                program, z, c = stories.program(story, 0, 1), [], None
                for i, at in ((k, (q[k], ages)), (k + 1, (mode, ages if born is None else 0))):
                    xi = [sum((F(float(s)) * F(float(v.mid())) for s, v in zip(row, run.x[i])), F(0)) for row in t.S]
                    u, lo, hi = ([F(float(v)) for v in row] for row in (run.u[i].astype("float32"), boxes[i][0][at],
                                                                         boxes[i][1][at]))
                    y = [F(float(v)) for v in boxes[i][3]]
                    if c is None:
                        c = y + [(a + b) / 2 for a, b in zip(lo, hi)][len(y):]
                    else:
                        moved = part.total(part.times(stories.t["Phi"][q[k + 1]], c), part.times(
                            stories.t["Gamma"][q[k + 1]], z[2:2 + len(u)]), stories.t["shift"][q[k + 1]])
                        c = y + moved[len(y):]
                    z += [*xi, *u, *y, *lo, *hi, *c]
                for terms, rights in program[0]:
                    for r, right in enumerate(rights):
                        left = sum((x * z[at + j] for M, at in terms for j, x in enumerate(M[r])), F(0))
                        worst = max(worst, float(left - right))
                assert all(a <= b <= c for a, b, c in zip(program[1], z, program[2])) or spoil
                seen += 1
    assert seen >= 6
    assert worst <= 1e-12 if spoil is None else worst > 1e-6, worst


def test_multipliers_keep_few_digits():
    """A dead story is written with whole numbers of few digits; a bound loses hardly anything."""
    design = read_design(TWO)
    t, cert, p, kept = design.observer.tables["float64"], design.certificate["float64"], bounded(design.plant), {}
    claims = Claims(t, p.limits("x"), p.limits("u"), cert["dwell"], cert["horizon"], kept)
    claims.again(np.array(cert["widths"]), {}, False)
    words = stated(kept, np.array(cert["widths"]))
    assert set(words) <= set(kept) and len(words) >= 20
    for name, text in words.items():
        numbers = [int(w) for w in text.split()[2::2]]
        assert all(0 < n < (2**17 if kept[name][2] is None else 2**54) for n in numbers)


@pytest.mark.parametrize("offset", [0.0, 5.0, -5.0])
def test_measurements_of_a_story_reach_as_far_as_those_of_the_plant(offset, checker):
    """Noise of one sign too: were some of them left out, what is proved would not hold where they are met."""
    data, ranges = data_of(TWO)
    t = data["tables"]["float32"]
    t = t | {key: [offset + v for v in t[key]] for key in ("v_lo", "v_hi")}
    stories = checker["story"].Stories(t, ranges, checker["delays"].exact(data["certificate"]["float32"]["widths"]))
    _, lo, hi, _ = stories.program((0, 0, 1, 0, None, "settled"), 0, 1)
    y, p = len(t["S"]) + len(t["u_lo"]), len(t["v_lo"])
    assert all(a <= b + c for a, b, c in zip(lo[y:y + p], t["wide_lo"], t["v_lo"], strict=False))
    assert all(a >= b + c for a, b, c in zip(hi[y:y + p], t["wide_hi"], t["v_hi"], strict=False))
