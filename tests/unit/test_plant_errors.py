"""Every mistake a user can make in a plant file: where, what was found, what was expected, what to do.

A case is a small edit of a valid text and the fragments that its message must hold, in this order.
"""

import pytest

from codegen.errors import PlantError
from codegen.plant.load import loads

VALID = """
format = 1
name   = "cart"
title  = "Cart with a brake"
source = "own example"

[time]
kind = "discrete"
sample_period = 0.01

[signals]
x = [{ name = "position", unit = "m", range = [-5, 5] }, { name = "speed", unit = "m/s", range = [-3, 3] }]
u = [{ name = "force", unit = "N", range = [-20, 20] }]
y = [{ name = "position", unit = "m", range = [-6, 6] }]
w = [{ name = "gust", bounds = [-0.3, 0.3] }]
v = [{ name = "encoder noise", bounds = [-0.01, 0.01] }]
f = [{ name = "encoder", range = [-1, 1] }]
theta = [{ name = "rho", bounds = [0.5, 1] }]

[initial]
x_lo = [-0.1, -0.2]
x_hi = [0.1, 0.2]

[constants]
mass = 2.0

[common]
C  = [[1, 0]]
Dv = [[1]]
Df = [[1]]

[[mode]]
name = "free"
A  = [[1, 0.01], [0, "rho"]]
B  = [[0], ["0.01/mass"]]
Bw = [[0], [0.01]]

[[mode]]
name = "braked"
A  = [[1, 0.01], [0, 0.9]]
B  = [[0], [0.01]]
Bw = [[0], [0.01]]

[switching]
known = true
average_dwell = 0.05
chatter = 2

[observer]
method = "tnl-interval"
lyapunov = "common"

[target]
prefix = "cart"
real   = "float32"
layout = "table"
alarm  = { debounce = [1, 2], latch = true }

[[scenario]]
name  = "encoder fault"
steps = 400
mode  = [[0, "free"], [150, "braked"]]
u     = ["5*sin(0.1*k)"]
w     = "corner"
v     = "uniform"
fault = [{ channel = "encoder", from = 200, to = 260, value = "0.1" }]
"""

BRAKED_A = "A  = [[1, 0.01], [0, 0.9]]"
SCHEDULE = 'mode  = [[0, "free"], [150, "braked"]]'
S = "scenarios.encoder fault"

# (old, new, fragments of the message)
EDITS = [
    # the file as a whole
    ("format = 1\n", "", ['"format" is missing', "Add format = 1"]),
    ("format = 1", "format = 2", ["format: is 2", "expected 1", "Write format = 1"]),
    ("format = 1", "format = true", ["format: is true", "expected 1"]),
    ('name   = "cart"', 'name   = "my cart"', ['name: is "my cart"', "expected a letter", "Rename it"]),
    ('title  = "Cart with a brake"', 'title = "*/ int x;"', ["title:", "*/ int x;", "C comment", "Rewrite"]),
    ("[time]", "[tme]", ['unknown key "tme"', 'Did you mean "time"?']),
    ("[switching]", "[vertex]\n[switching]", ["vertices: is one table", "expected a list", "Write [[vertex]]"]),
    ("[switching]", "[[vertex]]\n[switching]", ["vertices: [[mode]] tables are given too", "found 2", "Give one"]),
    ("[switching]", "[nonlinear]\n[switching]", ['nonlinear: the key "f" is missing', "Add it"]),
    ("known = true", "known = tru", ["line 45, column 9", "no TOML", "Invalid value", "Correct the line"]),
    ("[initial]", "[initial", ["line 20", "no TOML", "Correct the line"]),
    ("known = true", "known = true\nknown = true", ["line 46", "Cannot overwrite a value"]),
    # time
    (
        'kind = "discrete"',
        'kind = "discret"',
        ['time.kind: is "discret"', "'discrete' or 'continuous'", "Use"],
    ),
    ("sample_period = 0.01", "sample_period = 0", ["time.sample_period: is 0", "> 0", "Correct"]),
    (
        "sample_period = 0.01",
        'sample_period = "10 ms"',
        ['time.sample_period: is "10 ms"', "expected a number"],
    ),
    ("sample_period = 0.01", "sample_period = nan", ["time.sample_period: is nan", "finite number"]),
    ("sample_period = 0.01", "", ['time: the key "sample_period" is missing', "Add it"]),
    # signals
    (
        "range = [-3, 3]",
        "range = [3, -3]",
        ["signals.x.speed.range", "wrong way round", "[3, -3]", "[-3, 3]"],
    ),
    ("range = [-3, 3]", "range = [3, 3]", ["signals.x.speed.range", "single point 3", "lo < hi", "Widen"]),
    ("range = [-3, 3]", "range = 3", ["signals.x.speed.range", "is 3", "two numbers", "Write [lo, hi]"]),
    ("range = [-3, 3]", "range = [-3, inf]", ["signals.x.speed.range", "holds inf", "finite", "[lo, hi]"]),
    ("range = [-3, 3]", "range = [nan, 3]", ["signals.x.speed.range", "holds nan", "finite"]),
    (
        "range = [-3, 3]",
        "bounds = [-3, 3]",
        ["signals.x.speed", 'unknown key "bounds"', 'Did you mean "range"?'],
    ),
    ("bounds = [-0.3, 0.3]", "range = [-0.3, 0.3]", ["signals.w.gust", '"range"', 'Did you mean "bounds"?']),
    (", bounds = [-0.3, 0.3]", "", ["signals.w.gust", '"bounds" is missing', "Add it"]),
    ('"speed", unit', '"position", unit', ["signals.x", '"position" is used twice', "Rename one"]),
    (
        '"speed", unit',
        '"speed (max)", unit',
        ["signals.x", '"speed (max)" makes no C name', "expected letters"],
    ),
    ('unit = "m/s"', 'unit = "m\\\\s"', ["signals.x.speed.unit", "C comment", "no backslash"]),
    ('name = "rho"', 'name = "k"', ["signals.theta", '"k" has a meaning', "Rename it"]),
    ('name = "rho"', 'name = "mass"', ["signals.theta", '"mass" is a constant already', "Rename one"]),
    (
        'name = "rho"',
        'name = "rho-1"',
        ["signals.theta", '"rho-1" cannot stand in an expression', "Rename it"],
    ),
    # rates, errors of a measurement, bounds of a parameter in one mode
    ('range = [-20, 20] }', 'range = [-20, 20], rate = 0 }', ["signals.u.force.rate: is 0", "> 0"]),
    ("-20, 20] }", '-20, 20], rate = "fast" }', ['signals.u.force.rate: is "fast"', "expected a number"]),
    ('range = [-3, 3] }', 'range = [-3, 3], rate = 1 }', ["signals.x.speed", 'unknown key "rate"']),
    ("bounds = [0.5, 1] }", "bounds = [0.5, 1], rate = -1 }", ["signals.theta.rho.rate: is -1", "> 0"]),
    ("bounds = [0.5, 1] }", "bounds = [0.5, 1], error = -0.1 }", ["signals.theta.rho.error: is -0.1", ">= 0"]),
    ("bounds = [0.5, 1] }", "bounds = [0.5, 1], error = inf }", ["signals.theta.rho.error: is inf", "finite number"]),
    ("bounds = [0.5, 1] }", "bounds = [0.5, 1], error = 0.5 }", ["rho.error: is 0.5, as much as", "0.5", "smaller"]),
    ("0.5, 1] }", "0.5, 1], measured = false, error = 0.1 }", ["rho.error: is 0.1", "not measured", "Leave it"]),
    ("0.5, 1] }", '0.5, 1], measured = "no" }', ['signals.theta.rho.measured: is "no"', "true or false"]),
    (BRAKED_A, BRAKED_A + "\nbounds = { rho = [1, 0.5] }", ["modes.braked.bounds.rho", "wrong way round", "[0.5, 1]"]),
    (BRAKED_A, BRAKED_A + "\nbounds = { roh = [0.5, 1] }", ["modes.braked.bounds", '"roh"', 'Did you mean "rho"?']),
    (BRAKED_A, BRAKED_A + "\nbounds = { rho = 1 }", ["modes.braked.bounds.rho", "two numbers", "[lo, hi]"]),
    ("mass = 2.0", "mass = 2.0\nsin = 1.0", ["constants", '"sin" has a meaning', "Rename it"]),
    ("mass = 2.0", 'mass = "heavy"', ["constants.mass", '"heavy"', "expected a number"]),
    # initial box
    ("x_lo = [-0.1, -0.2]", "x_lo = [-0.1]", ["initial.x_lo: has 1 numbers, expected 2", "position, speed"]),
    ("x_lo = [-0.1, -0.2]", "x_lo = [-0.1, 0.3]", ["box of speed", "wrong way round", "0.3", "0.2", "Swap"]),
    (
        "x_hi = [0.1, 0.2]",
        "x_hi = [9, 0.2]",
        ["box of position leaves its range", "[-0.1, 9]", "[-5, 5]", "Shrink"],
    ),
    ("x_hi = [0.1, 0.2]", 'x_hi = [0.1, "0.2"]', ["initial.x_hi.#2", '"0.2"', "expected a number"]),
    # matrices
    (
        BRAKED_A,
        "A = [[1, 0.01, 0], [0, 0.9, 0]]",
        ["modes.braked.A is 2x3, expected 2x2 (x has 2 signals). Give 2 rows of 2."],
    ),
    (
        "C  = [[1, 0]]",
        "C  = [[1]]",
        ["common.C is 1x1, expected 1x2 (y has 1 signal, x has 2). Give 1 row of 2."],
    ),
    ("C  = [[1, 0]]\n", "", ["modes.free.C is missing", "expected 1x2", "Add it to the mode or to [common]"]),
    ("Dv = [[1]]\n", "", ["modes.free.Dv is missing", "expected 1x1", "v has 1", "Add it"]),
    ("Df = [[1]]\n", "", ["modes.free: Bf and Df are both missing", "f has 1 signal", "Give Bf"]),
    (BRAKED_A, "A = [1, 0]", ["modes.braked.A", "plain list", "row 1", "[[...], [...]]"]),
    (
        BRAKED_A,
        "A = [[1, 0], [1]]",
        ["modes.braked.A", "ragged", "row 2 has 1", "row 1 has 2", "equally long"],
    ),
    (BRAKED_A, "A = [[1, nan], [0, 1]]", ["modes.braked.A", "holds nan at row 1, column 2", "finite"]),
    (
        BRAKED_A,
        "A = [[1, true], [0, 1]]",
        ["modes.braked.A", "holds true at row 1, column 2", "finite number"],
    ),
    (
        BRAKED_A,
        'A = [[1, "0.01*masse"], [0, 1]]',
        ["modes.braked.A: row 1, column 2", '"masse"', "mass, pi, rho"],
    ),
    (BRAKED_A, 'A = [[1, "rho*rho"], [0, 1]]', ["modes.braked.A: row 1, column 2", "affine in theta"]),
    (BRAKED_A, 'A = [[1, "1/0"], [0, 1]]', ["modes.braked.A: row 1, column 2", "divides by zero", "Correct"]),
    (BRAKED_A, 'A = [[1, "1 2"], [0, 1]]', ["row 1, column 2", '"1 2" is no expression', "expected e.g."]),
    (
        BRAKED_A,
        BRAKED_A + "\nE = [[1, 0], [0, 0]]",
        ["modes.braked.E", "no descriptor plant", "found E other than the identity", "Leave E out, or give [[vertex]]"],
    ),
    (BRAKED_A, BRAKED_A + "\nBv = [[1]]", ["modes.braked", 'unknown key "Bv"', "known: E, A, B"]),
    (
        BRAKED_A,
        BRAKED_A + "\nbounds = { gst = [0, 1] }",
        ["modes.braked.bounds", '"gst"', 'Did you mean "gust"?'],
    ),
    (
        BRAKED_A,
        BRAKED_A + "\nbounds = { gust = [1, 0] }",
        ["modes.braked.bounds.gust", "wrong way round", "[0, 1]"],
    ),
    ('name = "braked"', "", ["modes.#2", '"name" is missing', "Add it"]),
    ('name = "braked"', 'name = "free"', ["modes", '"free" is used twice', "Rename one"]),
    # switching, observer, target
    ("chatter = 2", "minimum_dwell = 0.1", ["switching", "average_dwell and minimum_dwell", "Give one"]),
    (
        "average_dwell",
        "minimum_dwell",
        ["switching.chatter: is 2", "expected 1 with minimum_dwell", "Leave it out"],
    ),
    ("average_dwell = 0.05", "", ["switching.chatter: is 2", "no average_dwell", "Add average_dwell"]),
    ("chatter = 2", "chatter = 0.5", ["switching.chatter: is 0.5", ">= 1"]),
    ("average_dwell = 0.05", "average_dwell = -1", ["switching.average_dwell: is -1", "> 0"]),
    ("average_dwell = 0.05", "average_dwell = 1e9", ["switching.average_dwell: is 1e+09 s, 1e+11 samples",
                                                     "at most 100000", "State a shorter one"]),
    ("known = true", "known = false\nlate = true", ["switching.late: is true", "nobody tells", "Leave one"]),
    ("known = true", 'known = true\nlate = "yes"', ['switching.late: is "yes"', "true or false"]),
    ("known = true", 'known = "yes"', ['switching.known: is "yes"', "true or false"]),
    ('method = "tnl-interval"', "method = 3", ["observer.method: is 3", "expected a string", "quotes"]),
    (
        'prefix = "cart"',
        'prefix = "my-cart"',
        ['target.prefix: "my-cart" is no C identifier', "another name"],
    ),
    ('prefix = "cart"', 'prefix = "double"', ['"double" is a word of C or C++', "another name"]),
    ('prefix = "cart"', 'prefix = "_cart"', ['"_cart" is reserved', "underscore"]),
    ('prefix = "cart"', f'prefix = "{"c" * 25}"', ["target.prefix", "found 25", "at most 24"]),
    ('real   = "float32"', 'real   = "float16"', ['target.real: is "float16"', "'float32' or 'float64'"]),
    ('layout = "table"', 'layout = "fast"', ['target.layout: is "fast"', "'literal', 'table' or 'loop'"]),
    (
        "debounce = [1, 2]",
        "debounce = [3, 2]",
        ["target.alarm.debounce: is [3, 2]", "1 <= m <= n <= 32", "[2, 3]"],
    ),
    ("layout = ", "recover = 0\nlayout = ", ["target.recover: is 0", ">= 1"]),
    # scenarios
    ("steps = 400", "step = 400", [S, 'unknown key "step"', 'Did you mean "steps"?']),
    ("steps = 400", "steps = 400.5", [f"{S}.steps: is 400.5", "whole number"]),
    ("steps = 400", "", [f"{S}.steps: is missing", "steps, duration or csv", "Add"]),
    ("steps = 400", "steps = 400\nduration = 4.0", [f"{S}.steps", "both given", "Give one"]),
    (SCHEDULE, "", [f"{S}.mode: is missing", "several modes", "Add"]),
    (SCHEDULE, 'mode = [[0, "free"], [9, "braken"]]', [f"{S}.mode", '"braken"', 'Did you mean "braked"?']),
    (SCHEDULE, 'mode = [[1, "free"]]', [f"{S}.mode: starts at sample 1", "expected 0", "Add"]),
    (SCHEDULE, 'mode = [[0, "free"], [0, "braked"]]', [f"{S}.mode: sample 0 comes after sample 0", "Sort"]),
    (
        SCHEDULE,
        'mode = [[0, "free"], [400, "braked"]]',
        [f"{S}.mode: sample 400 is past the end", "400", "Remove"],
    ),
    (SCHEDULE, 'mode = ["free"]', [f"{S}.mode", 'holds "free"', "expected [sample, mode name]", "Write"]),
    (SCHEDULE, 'mode = { every = 0, order = ["free"] }', [f"{S}.mode", "every >= 1", "Write"]),
    ('u     = ["5*sin(0.1*k)"]', "", [f"{S}.u: is missing", "u has 1 signal", "Add one expression"]),
    ('u     = ["5*sin(0.1*k)"]', 'u = ["1", "2"]', [f"{S}.u: has 2 expressions, expected 1", "force"]),
    (
        "5*sin(0.1*k)",
        "5*sinus(0.1*k)",
        [f"{S}.u.force", 'function "sinus" is not known', "sin, cos", "Use one"],
    ),
    ("5*sin(0.1*k)", "5*sin(0.1*x)", [f"{S}.u.force", 'name "x" is not known', "mass, k, t, pi"]),
    ("5*sin(0.1*k)", "k^2", [f"{S}.u.force", '"^" is not allowed', "Write **"]),
    (
        'w     = "corner"',
        'w     = "corners"',
        [f"{S}.w", '"corners"', '"uniform", "corner" or a list', "Write"],
    ),
    ('channel = "encoder"', 'channel = "encode"', [f"{S}.fault", '"encode"', 'Did you mean "encoder"?']),
    (
        "from = 200, to = 260",
        "from = 260, to = 200",
        [f"{S}.fault.encoder: from 260 to 200", "from < to <= 400"],
    ),
    (
        "from = 200, to = 260",
        "from = 200, to = 401",
        [f"{S}.fault.encoder: from 200 to 401", "<= 400", "Correct"],
    ),
    ("from = 200", "form = 200", [f"{S}.fault.encoder", 'unknown key "form"', 'Did you mean "from"?']),
    ('value = "0.1"', "value = 0.1", [f"{S}.fault.encoder.value: is 0.1", "expected a string", "quotes"]),
    ("steps = 400", 'csv = "no.csv"', [f"{S}.csv", 'no file "no.csv"', "relative to the plant file"]),
]


def test_the_unedited_text_is_valid():
    plant = loads(VALID)
    assert plant.n_modes == 2
    assert plant.options == {"lyapunov": "common"}


@pytest.mark.parametrize(
    "old, new, fragments", EDITS, ids=[f"{i}: {e[1][:30]!r}" for i, e in enumerate(EDITS)]
)
def test_a_mistake_is_told_in_one_line(old, new, fragments):
    assert VALID.count(old) >= 1, "the edit does not apply"
    with pytest.raises(PlantError) as caught:
        loads(VALID.replace(old, new, 1), "cart.toml")
    message = str(caught.value)
    assert message.startswith("cart.toml: ")
    assert "\n" not in message
    position = 0
    for fragment in fragments:
        assert fragment in message[position:], message
        position = message.index(fragment, position) + len(fragment)


def test_the_table_is_long_enough():
    assert len(EDITS) >= 45


def test_further_mistakes_are_counted():
    text = VALID.replace("sample_period = 0.01", "sample_period = 0").replace("known = true", "known = 1")
    with pytest.raises(PlantError, match=r"time\.sample_period.*\(and 1 more\)$"):
        loads(text)


def test_a_missing_matrix_of_the_disturbance_is_named():
    with pytest.raises(PlantError, match=r"modes\.free\.Bw is missing .*w has 1\)\. Add it"):
        loads(VALID.replace("Bw = [[0], [0.01]]\n", ""))
