"""Numbers and times as a reader wants them: four digits, rounded to the side that promises less."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal

NONE = "–"
THIN = "\u202f"  # narrow no-break space, between a number and its unit
HARD = "\u00a0"  # no-break space


def number(x: float | None, digits: int = 4, rounding: str = ROUND_HALF_EVEN) -> str:
    """Print a number with at most so many digits.

    Parameters
    ----------
    x : float or None
        None prints as a dash.
    digits : int
    rounding : str
        Of the decimal module.

    Returns
    -------
    text : str
    """
    if x is None or math.isnan(x):
        return NONE
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    if x == 0:
        return "0"
    exact = Decimal(float(x))
    rounded = exact.quantize(Decimal(1).scaleb(exact.adjusted() - digits + 1), rounding=rounding)
    if not -4 <= exact.adjusted() < 7:
        mantissa, exponent = f"{rounded.normalize():E}".split("E")
        return f"{mantissa}e{int(exponent)}".replace("-", "−")
    return f"{rounded.normalize():f}".replace("-", "−")


def at_most(x: float | None, digits: int = 4) -> str:
    """Print an upper bound: rounded up, so that what is printed holds too."""
    return number(x, digits, ROUND_CEILING)


def at_least(x: float | None, digits: int = 3) -> str:
    """Print a lower bound: rounded down, so that what is printed holds too."""
    return number(x, digits, ROUND_FLOOR)


def quantity(text: str, unit: str) -> str:
    """A printed number and its unit, not to be broken."""
    return f"{text}{THIN}{unit}" if unit and text != NONE else text


def interval(lo: float, hi: float, unit: str = "") -> str:
    """A range or bound, not to be broken; a dash where there is none."""
    if math.isinf(lo) and math.isinf(hi):
        return NONE
    return quantity(f"[{number(lo, 6)},{HARD}{number(hi, 6)}]", unit)


def seconds(x: float) -> str:
    """A time with the unit that suits it."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if x * factor >= 1 or unit == "µs":
            break
    return quantity(number(x * factor), unit)


def within(samples: int, period: float) -> str:
    """A guaranteed delay: ``at once``, ``within 2 samples (10 ms)``."""
    return "at once" if samples == 0 else f"within {delay(samples, period)}"


def delay(samples: int | None, period: float) -> str:
    """A detection delay in samples and time."""
    if samples is None:
        return "not found"
    if samples == 0:
        return "at once (same sample)"
    return f"{count(samples, 'sample')} ({milliseconds(samples * period)})"


def milliseconds(x: float) -> str:
    """A time in ms, in s from one second on."""
    return quantity(number(x * 1e3), "ms") if x < 1 else quantity(number(x), "s")


def count(n: int, noun: str) -> str:
    """``3 modes``, ``1 mode``."""
    return f"{integer(n)} {noun}{'' if n == 1 else 's'}"


def integer(n: int) -> str:
    """An integer, its digits in groups of three."""
    return f"{n:,}".replace(",", THIN)


def share(part: float, whole: float) -> str:
    """A percentage, rounded down: 99.99 % is not all."""
    if whole == 0:
        return NONE
    return f"{math.floor(1000 * part / whole) / 10:g}{THIN}%"


def listed(items) -> str:
    """``a, b and c``."""
    items = list(items)
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"
