"""Numbers read back as the same bits; sums, names and comments are what C and a careless plant file need."""

import ctypes
import struct

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from codegen.emit import cprint
from codegen.errors import EmitError

LIBC = ctypes.CDLL(None)
LIBC.strtof.restype = ctypes.c_float  # rounds once, from decimal to float, as a compiler does
LIBC.strtof.argtypes = [ctypes.c_char_p, ctypes.c_void_p]


def bits32(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


@given(st.integers(0, 2**32 - 1))
@example(0)
@example(0x80000000)  # -0.0
@example(1)  # smallest subnormal
@example(0x007FFFFF)
@example(0x7F7FFFFF)
@example(0x3F800000)
def test_every_finite_float32_reads_back(bits):
    value = np.uint32(bits).view(np.float32)
    if not np.isfinite(value):
        with pytest.raises(EmitError):
            cprint.literal(value, "float32")
        return
    text = cprint.literal(value, "float32")
    assert text.endswith("F") and ("." in text or "e" in text)
    assert bits32(LIBC.strtof(text[:-1].encode(), None)) == bits


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_float64_reads_back(value):
    text = cprint.literal(value, "float64")
    assert ("." in text or "e" in text) and struct.pack("<d", float(text)) == struct.pack("<d", value)


def test_shortest_digits():
    assert cprint.literal(np.float32(0.1), "float32") == "0.1F"
    assert cprint.literal(1.0, "float32") == "1.0F"
    assert cprint.literal(-0.0, "float32") == "-0.0F"
    assert cprint.literal(0.1, "float64") == "0.1"
    assert cprint.literal(2.0**-149, "float32") == "1e-45F"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_no_literal_for_what_is_no_number(value, real):
    with pytest.raises(EmitError, match="has none"):
        cprint.literal(value, real)


@pytest.mark.parametrize("value", [0.1, 1e300, 2.0**-150])
def test_a_number_that_float32_does_not_have_is_refused(value):
    with pytest.raises(EmitError, match="no float32"):
        cprint.literal(value, "float32")


def test_products_and_sums():
    terms = [t for c, v in ((-1.0, "a"), (0.0, "b"), (1.0, "c"), (-0.5, "d"), (2.0, "e"))
             for t in cprint.product(c, v, "float32")]
    assert cprint.sum_lines(terms, "float32") == ("-a + c - (0.5F * d) + (2.0F * e)",)
    assert cprint.sum_lines(terms, "float32", width=10) == ("-a", "+ c", "- (0.5F * d)", "+ (2.0F * e)")
    assert cprint.count_operations(terms) == (2, 3)
    assert cprint.sum_lines([], "float64") == ("0.0",)
    assert cprint.constant(-0.25, "float32") == [("-", "0.25F")]


@given(st.text())
@example("*/ evil(); /*")
@example("/*/")
@example("**//**//")
@example("?\\?/\n/")
def test_comments_cannot_be_left(text):
    safe = cprint.comment(text)
    assert safe.isascii() and "\n" not in safe
    assert "*/" not in safe and "/*" not in safe and "??" not in safe and "\\" not in safe


def test_units_stay_readable():
    assert cprint.comment("m/s² at 20 °C, 3 µA, 5 Ω, é") == "m/s^2 at 20 degC, 3 uA, 5 Ohm, e"
    assert cprint.comment("https://example.org/x") == "https://example.org/x"


@given(st.lists(st.text()))
def test_macro_names_are_unique_and_c(names):
    stems = cprint.macro_names(names, reserved=["CROSSED"])
    assert len(set(stems)) == len(names) and "CROSSED" not in stems
    assert all(("A_" + s).isidentifier() and s.isascii() and s.upper() == s for s in stems)


@pytest.mark.parametrize("prefix", ["", "1a", "_a", "a-b", "a b", "ä", "a" * 29, "../x", "a\n"])
def test_bad_prefix(prefix):
    with pytest.raises(EmitError, match="target.prefix"):
        cprint.check_prefix(prefix)
