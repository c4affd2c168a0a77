"""Every mistake in ``[nonlinear]`` and ``[[vertex]]``: where, what was found, what was expected, what to do.

A case is a small edit of a valid text and the fragments that its message must hold, in this order.
"""

import pytest

from codegen.errors import PlantError
from codegen.plant.load import loads

HEAD = """
format = 1
name = "tank"
[time]
kind = "continuous"
sample_period = 0.1
[signals]
x = [{ name = "level", range = [0.1, 2] }, { name = "flow", range = [0, 3] }]
u = [{ name = "valve", range = [0.2, 1] }]
y = [{ name = "sensor" }]
w = [{ name = "rain", bounds = [0, 0.1] }]
f = [{ name = "leak" }]
theta = [{ name = "rho", bounds = [0.5, 1] }]
[initial]
x_lo = [1, 0]
x_hi = [1, 2]
[constants]
g = 9.81
[common]
C = [[1, 0]]
Bw = [[1], [0]]
Bf = [[1], [0]]
"""
TAIL = """
[[scenario]]
name = "s"
steps = 10
u = ["0.5"]
"""
E = "E = [[1, 0], [0, 0]]\n"
SECTOR = HEAD + "[nonlinear]\n" + E + """
f = ["valve - rho*flow", "flow - valve*sqrt(2*g*level) - 0.1*level"]
A = [[0, "-rho"], [-0.1, 1]]
B = [[1], ["-sqrt(2*g*level)"]]
premise = [{ name = "speed", term = "sqrt(level)", bounds = [0.3, 1.5] }]
""" + TAIL
POINTS = HEAD + "[nonlinear]\n" + E + """
f = ["valve - rho*flow", "flow - valve*sqrt(2*g*level) - 0.1*level"]
point = [
  { name = "low", x = [0.2, 1], u = [0.5], theta = [0.7], weight = "max(1 - level, 0)" },
  { name = "high", x = [2, 1], u = [0.5], theta = [0.7], weight = "level" },
]
""" + TAIL
VERTICES = HEAD.replace("[common]\n", "[common]\n" + E) + """
[[vertex]]
name = "low"
A = [[-1, 0], [0, 1]]
B = [[1], [0]]
offset = [0, 0.5]
weight = "exp(-level)"
[[vertex]]
name = "high"
A = [[-2, 0], [0, "2*g"]]
B = [[1], [0]]
weight = "level*rho"
""" + TAIL
F2 = '"flow - valve*sqrt(2*g*level) - 0.1*level"]'
AB = 'A = [[0, "-rho"], [-0.1, 1]]\nB = [[1], ["-sqrt(2*g*level)"]]\n'
PREMISE = 'premise = [{ name = "speed", term = "sqrt(level)", bounds = [0.3, 1.5] }]\n'
BARE = SECTOR.replace(AB, "").replace(PREMISE, "")

# (text, old, new, fragments of the message)
EDITS = [
    # what goes together
    (SECTOR, "[[scenario]]", "[[vertex]]\nA = [[1]]\n[[scenario]]",
     ["nonlinear: [[vertex]] tables are given too", "Give"]),
    (SECTOR, "[[scenario]]", '[[mode]]\nname = "a"\n[[scenario]]',
     ["nonlinear: [[mode]] tables", "found 1", "Give one"]),
    (VERTICES, "[[scenario]]", '[[mode]]\nname = "a"\n[[scenario]]',
     ["vertices: [[mode]] tables", "found 1", "Give one"]),
    (VERTICES, "[[scenario]]", "[switching]\nminimum_dwell = 1\n[[scenario]]",
     ["vertices: has no modes", "found [switching]",
                                                                              "Remove [switching]"]),
    (SECTOR, "[common]", "[common]\n" + E,
     ["common.E: is given beside [nonlinear]", "found both", "in [nonlinear] only"]),
    (SECTOR, "[common]", "[common]\nA = [[1, 0], [0, 1]]", ["common.A: is given beside [nonlinear]", "Give it in"]),
    (VERTICES, 'steps = 10', 'steps = 10\nmode = [[0, "low"]]', ["scenarios.s.mode: unknown mode", "none is declared"]),
    (VERTICES, "Bf = [[1], [0]]\n", "", ["common: Bf and Df are both missing", "f has 1 signal", "Give Bf"]),
    (SECTOR, "Bf = [[1], [0]]\n", "", ["common: Bf and Df are both missing", "f has 1 signal", "Give Bf"]),
    # names and ranges
    (SECTOR, 'name = "level", ', 'name = "the level", ', ["signals.x", '"the level" cannot stand in an expression']),
    (SECTOR, 'name = "valve", ', 'name = "level", ', ["signals.u", '"level" is a signal already', "Rename one"]),
    (SECTOR, 'name = "valve", ', 'name = "t", ', ["signals.u", '"t" has a meaning', "Rename it"]),
    (SECTOR, 'name = "flow", ', 'name = "g", ', ["signals.x", '"g" is a constant already', "Rename one"]),
    (SECTOR, '"level", range = [0.1, 2]', '"level"',
     ["signals.x.level: has no range", "expected one, nonlinear", "Add"]),
    (VERTICES, '"level", range = [0.1, 2]', '"level"', ["signals.x.level: has no range", "vertices.low.weight", "Add"]),
    # matrices
    (SECTOR, "E = [[1, 0], [0, 0]]", "E = [[1, 0]]", ["nonlinear.E is 1x2, expected 2x2", "Give 2 rows of 2"]),
    (VERTICES, "E = [[1, 0], [0, 0]]", "E = [[1, 0]]", ["common.E is 1x2, expected 2x2", "Give 2 rows of 2"]),
    (SECTOR, "E = [[1, 0], [0, 0]]", 'E = [[1, 0], [0, "rho"]]',
     ["nonlinear.E: row 2, column 2", '"rho" is not known']),
    (SECTOR, "C = [[1, 0]]", 'C = [["rho", 0]]', ["common.C: row 1, column 1", '"rho" is not known', "known: g, pi"]),
    (SECTOR, "C = [[1, 0]]\n", "", ["common.C is missing", "expected 1x2", "Add it to [common]"]),
    (SECTOR, "Bw = [[1], [0]]\n", "", ["common.Bw is missing", "expected 2x1", "w has 1", "Add it to [common]"]),
    (VERTICES, "Bw = [[1], [0]]\n", "", ["vertices.low.Bw is missing", "expected 2x1", "Add it to the vertex or to"]),
    (VERTICES, "A = [[-1, 0], [0, 1]]\n", "", ["vertices.low.A is missing", "expected 2x2", "Add it to the vertex"]),
    (VERTICES, "A = [[-1, 0], [0, 1]]", "A = [[-1, 0]]", ["vertices.low.A is 1x2, expected 2x2", "Give 2 rows"]),
    (VERTICES, "A = [[-1, 0], [0, 1]]", "A = [-1, 0]", ["vertices.low.A", "plain list", "[[...], [...]]"]),
    (VERTICES, '"2*g"', '"2*level"', ["vertices.high.A: row 2, column 2", '"level" is not known', "known: g, pi"]),
    (VERTICES, "offset = [0, 0.5]", "offset = [0]", ["vertices.low.offset: has 1 entries, expected 2", "level, flow"]),
    (VERTICES, "offset = [0, 0.5]", "C = [[1, 0]]",
     ["vertices.low.C: is the same at all vertices", "found one", "Move it"]),
    (VERTICES, "offset = [0, 0.5]", "E = [[1]]",
     ["vertices.low.E: is the same at all vertices", "Move it to [common]"]),
    (VERTICES, "offset = [0, 0.5]", "ofset = [0, 0.5]",
     ["vertices.low", 'unknown key "ofset"', 'Did you mean "offset"?']),
    (VERTICES, 'name = "high"', 'name = "low"', ["vertices", '"low" is used twice', "Rename one"]),
    # weights
    (VERTICES, '"exp(-level)"', '"exp(-levl)"', ["vertices.low.weight", '"levl" is not known', "Use one of these"]),
    (VERTICES, '"exp(-level)"', '"exp(-level"', ["vertices.low.weight", "is no expression", "Correct it"]),
    (VERTICES, '"exp(-level)"', "1.0", ["vertices.low.weight: is 1.0", "expected a string", "quotes"]),
    (VERTICES, '"exp(-level)"', '"1 - level"', ["vertices.low.weight: is -1 somewhere", "expected at least 0", "max"]),
    (VERTICES, '"exp(-level)"', '"1/(level - 1)"', ["vertices.low.weight: has no bounds", "divides by zero", "Narrow"]),
    (VERTICES, '"exp(-level)"', '"log(level - 1)"', ["vertices.low.weight: has no bounds", "logarithm", "Narrow"]),
    (VERTICES, '"exp(-level)"', '"where(level < 1, 1, 0)"', ["vertices.low.weight: piecewise cannot stand here",
                                                             "without jumps", "Rewrite it"]),
    (VERTICES, '"exp(-level)"', '"max(rho, cos(sqrt(-1)))"', ["vertices.low.weight", "no real value", "Correct it"]),
    (VERTICES, '"exp(-level)"', '"max(rho, sqrt(-1))"', ["vertices.low.weight", "no real value", "Correct it"]),
    (VERTICES, '"exp(-level)"', '"2**level"',
     ["vertices.low.weight: an exponent varies", "expected numbers", "exp(...)"]),
    (VERTICES, '"exp(-level)"', '"sqrt(tan(3))"',
     ["vertices.low.weight: holds a number with no real value", "Correct"]),
    (VERTICES, '"exp(-level)"', '"level*tan(level)"', ["vertices.low.weight: has no bounds", "Narrow"]),
    (VERTICES, '"exp(-level)"', '"sign(level)"', ["vertices.low.weight: sign cannot stand here", "Rewrite it"]),
    (VERTICES.replace('"level*rho"', '"max(level - 1.5, 0)"'), '"exp(-level)"', '"max(1 - level, 0)"',
     ["vertices: all weights are zero together", "expected a sum above 0", "Let neighbours overlap"]),
    # equations
    (SECTOR, '"valve - rho*flow", ', "", ["nonlinear.f: has 1 entries, expected 2", "level, flow"]),
    (SECTOR, '"valve - rho*flow", ', "3, ", ["nonlinear.f.#1: is 3", "expected a string", "quotes"]),
    (SECTOR, 'f = ["valve', 'g = ["valve', ['nonlinear: the key "f" is missing', "Add it"]),
    (SECTOR, 'f = ["valve', 'points = []\nf = ["valve', ["nonlinear", 'unknown key "points"', 'Did you mean "point"?']),
    (SECTOR, '"valve - rho*flow"', '"valve - rho*flw"', ["nonlinear.f.#1", '"flw" is not known', "level, flow, valve"]),
    (SECTOR, '"valve - rho*flow"', '"valve - abs(flow)"',
     ["nonlinear.f.#1: abs cannot stand here", "smooth", "Rewrite"]),
    (SECTOR, '"valve - rho*flow"', '"max(valve, flow)"', ["nonlinear.f.#1: max cannot stand here", "smooth", "sqrt"]),
    (SECTOR, '"valve - rho*flow"', '"valve/0"', ["nonlinear.f.#1", "divides by zero", "Correct"]),
    (SECTOR, '"valve - rho*flow"', '"valve - 2*flow"',
     ["nonlinear.A.#1: row 1 of A x + B u differs from f by flow*rho - 2*flow",
                                                        "expected a constant", "Correct the row"]),
    (SECTOR, "B = [[1], [", "B = [[1, 1], [0, ", ["nonlinear.B is 2x2, expected 2x1", "Give 2 rows of 1"]),
    (SECTOR, 'B = [[1], ["-sqrt(2*g*level)"]]\n', "", ["nonlinear.B is missing", "expected 2x1", "leave A and B out"]),
    (SECTOR, '"-sqrt(2*g*level)"', '"-sqrt(level"', ["nonlinear.B: row 2, column 1", "is no expression"]),
    (SECTOR, '"-sqrt(2*g*level)"', '"-sqrt(levl)"', ["nonlinear.B: row 2, column 1", '"levl" is not known']),
    (BARE, F2, '"flow - exp(level*flow)"]',
     ["nonlinear.f.#2: the term exp(flow*level) is no multiple", "expected a product",
                                             "Give the factors"]),
    (BARE, F2, '"(level + flow + valve + 1)**40"]', ["nonlinear.f.#2", "12341 terms when multiplied out",
                                                     "expected at most 1000", "Simplify it"]),
    (BARE, F2, '"' + "*".join(f"(level + {k})" for k in range(30)) + '"]',
     ["nonlinear.f.#2", "terms when multiplied out"]),
    (BARE, F2, '"flow - level*log(level - 1)"]', ["nonlinear.premise.z", "log(level - 1) has no bounds", "Narrow"]),
    (BARE, F2, '"flow - flow/(level - 1)"]', ["nonlinear.premise.z", "has no bounds", "divides by zero", "Narrow"]),
    (BARE, F2, '"flow*(level + level**2 + level**3 + sqrt(level) + exp(level) + sin(level) + cos(level))"]',
     ["nonlinear.f: 8 terms vary", "expected at most 6, 64 vertices", "Name products"]),
    (SECTOR, "bounds = [0.3, 1.5]", "bounds = [0.3, 1.4]", ["nonlinear.premise.speed.bounds: is [0.3, 1.4]",
                                                            "reaches [0.316", "1.414", "Widen"]),
    (SECTOR, "bounds = [0.3, 1.5]", "bounds = [1.5, 0.3]", ["nonlinear.premise.speed.bounds", "wrong way round"]),
    (SECTOR, '"sqrt(level)"', '"log(level)"',
     ["nonlinear.premise.speed: the term log(level) is in no entry", "Correct"]),
    (SECTOR, '"sqrt(level)"', '"2"',
     ["nonlinear.premise.speed.term: is the constant 2", "expected a term that varies"]),
    (SECTOR, '"sqrt(level)"', '"sqrt(lvl)"', ["nonlinear.premise.speed.term", '"lvl" is not known']),
    (SECTOR, PREMISE, PREMISE.replace("]\n", ', { name = "speed", term = "rho" }]\n'),
     ["nonlinear.premise", '"speed" is used twice', "Rename"]),
    (SECTOR, 'term = "sqrt(level)"', 'trm = "sqrt(level)"',
     ["nonlinear.premise.speed", 'unknown key "trm"', '"term"?']),
    (BARE.replace("0.1*level", "0.1*level*level*level"), F2.replace("0.1*level", "0.1*level*level*level"),
     F2.replace("0.1*level", "0.1*level*level*level") + '\npremise = [{ name = "z", term = "level" }]',
     ["nonlinear.f: the factor", "is not affine in the premise z", "Name the whole term"]),
    # points
    (POINTS, "x = [0.2, 1]", "x = [0.2]", ["nonlinear.point.low.x: has 1 entries, expected 2", "level, flow"]),
    (POINTS, "u = [0.5], theta", "u = [], theta", ["nonlinear.point.low.u: has 0 entries, expected 1", "valve"]),
    (POINTS, "theta = [0.7], weight", "weight", ["nonlinear.point.low.theta: has 0 entries, expected 1", "rho"]),
    (POINTS, ', weight = "level"', "", ["nonlinear.point.high", '"weight" is missing', "Add it"]),
    (POINTS, '"level" }', '"1 - rho" }', ["nonlinear.point: all weights are zero together", "Let neighbours overlap"]),
    (POINTS, '"max(1 - level, 0)"', '"0.5 - level"', ["nonlinear.point.low.weight: is -1.5 somewhere", "at least 0"]),
    (POINTS, "x = [0.2, 1]", "x = [0, 1]",
     ["nonlinear.point.low: f or its slope has no value there", "Move the point"]),
    (POINTS, '"high", x', '"low", x', ["nonlinear.point", '"low" is used twice', "Rename one"]),
    (POINTS, "point = [", PREMISE + "point = [",
     ["nonlinear.point: A, B, known or premise are given too", "Remove one"]),
]


@pytest.mark.parametrize("text, vertices", [(SECTOR, 4), (BARE, 4), (POINTS, 2), (VERTICES, 2)])
def test_the_unedited_texts_are_valid(text, vertices):
    plant = loads(text)
    assert plant.modes == () and len(plant.polytope.vertices) == vertices


@pytest.mark.parametrize("text, old, new, fragments", EDITS, ids=[f"{i}: {e[2][:30]!r}" for i, e in enumerate(EDITS)])
def test_a_mistake_is_told_in_one_line(text, old, new, fragments):
    assert text.count(old) >= 1, "the edit does not apply"
    with pytest.raises(PlantError) as caught:
        loads(text.replace(old, new, 1), "tank.toml")
    message = str(caught.value)
    assert message.startswith("tank.toml: ") and "\n" not in message and message[-1] in ".?)"
    position = 0
    for fragment in fragments:
        assert fragment in message[position:], message
        position = message.index(fragment, position) + len(fragment)
