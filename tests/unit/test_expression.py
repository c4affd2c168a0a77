"""Expressions: their values, and that hostile ones are refused quickly."""

import math
import time

import numpy as np
import pytest
import sympy

from codegen.plant.affine import affine
from codegen.plant.expression import ExpressionError, sampled
from codegen.plant.symbolic import symbolic

K = np.arange(5)
T = 0.1 * K

HOSTILE = [
    "__import__('os').system('x')",
    "().__class__.__bases__[0].__subclasses__()",
    "k.real",
    "sin.__globals__",
    "(lambda: 1)()",
    "[k for k in (1, 2)]",
    "{1: 2}",
    "{1, 2}",
    "(1, 2)",
    "k if k > 1 else 0",
    "k and 1",
    "not k",
    "k > 1",
    "sin(k, out=k)",
    "sin(*[k])",
    "eval('1')",
    "open('/etc/passwd')",
    "'text'",
    "f'{k}'",
    "b'x'",
    "True",
    "None",
    "...",
    "1j",
    "k @ k",
    "k // 2",
    "k % 2",
    "k << 9",
    "~k",
    "(k := 1)",
    "k[0]",
    "1e999",
    "9" * 400,
    "1; 2",
    "import os",
    "",
    "   ",
    "k\x00",
    "where(k, 1, 2)",
    "where(k == 1, 1, 2)",
    "sin()",
    "min(1)",
    "sin",
    "yield",
    "await k",
]
SLOW = [
    "9**9**9",
    "9**9**9**9**9",
    "((9**99)**99)**99",
    "(9**9999)*0",
    "10**-9999",
    "exp(exp(exp(exp(9))))",
    "(" * 400 + "1" + ")" * 400,
    "-" * 900 + "1",
    "+".join(["1"] * 400),
    "sin(" * 120 + "1" + ")" * 120,
    "1" + "0" * 2000,
    "1+" * 100000 + "1",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_expression_is_refused_everywhere(text):
    with pytest.raises(ExpressionError):
        sampled(text, {}, K, T)
    with pytest.raises(ExpressionError):
        affine(text, {}, ["k"])
    with pytest.raises(ExpressionError):
        symbolic(text, {"k": sympy.Symbol("k")})


def test_nothing_is_executed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in (
        "open('made', 'w')",
        "__import__('pathlib').Path('made').touch()",
        'exec(\'open("made", "w")\')',
    ):
        for read in (lambda t: sampled(t, {}, K, T), lambda t: affine(t, {}, []), lambda t: symbolic(t, {})):
            with pytest.raises(ExpressionError):
                read(text)
    assert list(tmp_path.iterdir()) == []


def test_expressions_made_to_take_long_are_refused_within_a_second():
    started = time.perf_counter()
    for text in SLOW:
        with pytest.raises(ExpressionError):
            affine(text, {}, [])
        with pytest.raises(ExpressionError):
            symbolic(text, {})
    assert time.perf_counter() - started < 1


def test_huge_powers_of_samples_overflow_and_do_not_hang():
    started = time.perf_counter()
    assert np.isinf(sampled("9**9**9", {}, K, T)).all()
    assert time.perf_counter() - started < 0.1


@pytest.mark.parametrize(
    "text, expected",
    [
        ("1", np.ones(5)),
        ("k", K),
        ("2*sin(0.1*k)", 2 * np.sin(0.1 * K)),
        ("-t**2 + m", -(T**2) + 3),
        ("0.9**k", 0.9**K),
        ("min(k, 2, 3)", np.minimum(K, 2)),
        ("max(k, 2)", np.maximum(K, 2)),
        ("where(1 <= k < 3, 7, -t)", np.where((K >= 1) & (K < 3), 7, -T)),
        ("where(k > 0, 1/k, 0)", [0, 1, 1 / 2, 1 / 3, 1 / 4]),
        ("floor(k/2) + sign(k - 2) + abs(-k)", K // 2 + np.sign(K - 2) + K),
        ("exp(-t)*cos(pi*k)/sqrt(4) + log(1) + tan(0)", np.exp(-T) * np.cos(np.pi * K) / 2),
    ],
)
def test_sampled_values(text, expected):
    values = sampled(text, {"m": 3.0}, K, T)
    assert values.shape == (5,)
    assert values.dtype == np.float64
    np.testing.assert_allclose(values, expected, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize(
    "text", ["0.1", "0.30000000000000004", "1e-300", "123456789.123456789", "5e-324", "2"]
)
def test_a_plain_number_stays_its_float(text):
    assert affine(text, {}, []) == (float(text), ())
    assert affine("-" + text, {}, []) == (-float(text), ())


@pytest.mark.parametrize(
    "text, expected",
    [
        ("0.1 + 0.2", 0.3),  # decimals: exact, then rounded once
        ("-k/m", -3.3 / 0.7),
        ("1 - 0.01*k/m", float(sympy.Rational(1) - sympy.Rational(33, 700))),
        ("2**-3", 0.125),
        ("2**0.5", math.sqrt(2)),
        ("sqrt(2)", math.sqrt(2)),
        ("exp(-0.5)", math.exp(-0.5)),
        ("sin(pi/2)", 1.0),
        ("max(1, k, m)", 3.3),
        ("abs(-2) + sign(-3) + floor(2.7)", 3.0),
    ],
)
def test_constant_entries(text, expected):
    value, slopes = affine(text, {"k": 3.3, "m": 0.7}, [])
    assert value == pytest.approx(expected, rel=2e-16)
    assert slopes == ()


@pytest.mark.parametrize(
    "text, expected",
    [
        ("rho", (0, 1, 0)),
        ("-2 + rho", (-2, 1, 0)),
        ("m*(1 - rho/4) - 2*eta", (2, -0.5, -2)),
        ("(rho + eta)*(1 + 1) - rho", (0, 1, 2)),
        ("rho**1", (0, 1, 0)),
        ("rho - rho", (0, 0, 0)),
    ],
)
def test_entries_affine_in_theta(text, expected):
    constant, slopes = affine(text, {"m": 2.0}, ["rho", "eta"])
    assert (constant, *slopes) == expected


@pytest.mark.parametrize(
    "text", ["rho*rho", "rho*eta", "rho**2", "2**rho", "1/rho", "sin(rho)", "max(rho, 1)"]
)
def test_entries_not_affine_in_theta_are_refused(text):
    with pytest.raises(ExpressionError, match="affine in theta.*Name the product|affine in theta"):
        affine(text, {}, ["rho", "eta"])


@pytest.mark.parametrize(
    "text", ["1/0", "0**-1", "log(0)", "sqrt(-1)", "(-8)**0.5", "1e300*1e300", "exp(1000)"]
)
def test_entries_without_a_finite_value_are_refused(text):
    with pytest.raises(ExpressionError, match="Correct|Reduce"):
        affine(text, {}, [])


def test_symbolic_objects_are_exact_and_differentiable():
    x, k = sympy.symbols("x k")
    value = symbolic("-k/0.1*x + where(x > 1, sin(x), x**2)", {"x": x, "k": k})
    assert value.subs({x: sympy.Rational(1, 2), k: 3}) == sympy.Rational(-59, 4)
    assert sympy.diff(value, x).subs({x: 0}) == -10 * k
