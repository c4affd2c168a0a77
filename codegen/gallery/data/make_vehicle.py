"""Print the gallery's plant ``vehicle``, and write the record that it replays.

Run in a checkout: ``python codegen/gallery/data/make_vehicle.py`` rewrites ``vehicle.toml`` and ``rav4_ranges.csv``,
the same bytes every time. The bicycle model [sideslip; yaw rate]' and its lateral acceleration depend on s = 1/speed;
in each range of speeds the sampled matrix is covered for every s by a straight line in one unknown number and a rest
(``codegen.algebra.cover``). The rest is added to disturbance and noise, at the declared ranges.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from flint import arb

from codegen.algebra.cover import sampled_cover

HERE = Path(__file__).parent
#: A recorded car: stiffness over mass and geometry by least squares on the first 40 s; see README.md here.
CAR = {"m": 1680.0, "Iz": 1453.0, "lf": 1.16, "lr": 1.49, "cf": 112829.0, "cr": 146849.0, "lw": 0.4}
PERIOD, SPEEDS = 0.02, (8.5, 12.0, 16.0, 20.0)
#: Sideslip and yaw rate, steering, wind, noise of both sensors, fault, low-pass of the target in Hz.
SIZES = {"x": (0.03, 0.2), "steering": 0.005, "wind": 500.0, "a_y": 0.2, "yaw_rate": 0.01, "fault": 0.01, "target": 1.0}
TRAIN = 2000  # samples for the offsets of the sensors
HEAD = '''# Made by data/make_vehicle.py: the bicycle model of a recorded car, covered for every speed of each range.
format = 1
name   = "vehicle"
title  = "Steering fault of a passenger car, from lateral acceleration and yaw rate"
source = """R. Rajamani, Vehicle Dynamics and Control, 2nd ed., Springer, 2012, chapter 3 (bicycle model); filter \\
problem after A. Farhat, D. Koenig (2016), with the output row corrected. Record and parameters: comma2k19, \\
see data/README.md."""

[time]
kind = "discrete"
sample_period = {period}

[signals]
x = [{{ name = "sideslip", unit = "rad", range = [-{x0}, {x0}] }}, \
{{ name = "yaw_rate", unit = "rad/s", range = [-{x1}, {x1}] }}]
u = [{{ name = "steering", unit = "rad", range = [-{u}, {u}] }}]
y = [{{ name = "a_y", unit = "m/s2", range = [-20, 20] }}, {{ name = "yaw", unit = "rad/s", range = [-1, 1] }}]
w = [{{ name = "wind", unit = "N", bounds = [-{wind}, {wind}] }}, \
{{ name = "rest_sideslip", bounds = [-1, 1] }}, \
{{ name = "rest_yaw", bounds = [-1, 1] }}]
v = [{{ name = "a_y_noise", unit = "m/s2", bounds = [-{a_y}, {a_y}] }}, \
{{ name = "yaw_noise", unit = "rad/s", bounds = [-{yaw}, {yaw}] }}, \
{{ name = "rest_a_y", bounds = [-1, 1] }}]
f = [{{ name = "offset", unit = "rad", range = [-{f}, {f}] }}]
theta = [{{ name = "s", bounds = [-1, 1], measured = false }}]     # place of 1/speed in its range

[initial]
x_lo = [-0.001, -0.01]
x_hi = [0.001, 0.01]
'''
TAIL = '''
[observer]
method = "hinf-filter"
target = {{ num = [{one}], den = [1, -{a}] }}     # low-pass of {target:g} Hz
set_rows = {rows}

[target]
prefix = "vehicle"
real   = "float32"
layout = "table"
alarm  = {{ debounce = [3, 5], latch = true }}

[[scenario]]
name  = "no fault"
steps = 600
mode  = {schedule}
u     = ["{u}*sin(0.02*k)"]
theta = "corner"
w     = "corner"
v     = "corner"

[[scenario]]
name  = "offset of the steering"
steps = 600
mode  = {schedule}
u     = ["{u}*sin(0.02*k)"]
w     = "uniform"
v     = "uniform"
fault = [{{ channel = "offset", from = 200, to = 400, value = "{f}" }}]
'''
RECORD = '''
[[scenario]]
name = "recorded car"
csv  = "data/rav4_ranges.csv"
'''


def bicycle(p: dict) -> tuple[list, list]:
    """Coefficients of s^0, s^1, s^2 of [sideslip; yaw rate]' and lateral acceleration, of [x; steering; wind]."""
    moment = p["cr"] * p["lr"] - p["cf"] * p["lf"]
    stiff, turn = p["cf"] + p["cr"], p["cf"] * p["lf"] ** 2 + p["cr"] * p["lr"] ** 2
    m, Iz = p["m"], p["Iz"]
    motion = [[[0, -1, 0, 0], [moment / Iz, 0, p["cf"] * p["lf"] / Iz, p["lw"] / Iz]],
              [[-stiff / m, 0, p["cf"] / m, 1 / m], [0, -turn / Iz, 0, 0]],
              [[0, moment / m, 0, 0], [0, 0, 0, 0]]]
    outputs = [[[-stiff / m, 0, p["cf"] / m, 1 / m]], [[0, moment / m, 0, 0]]]
    return [np.array(M) for M in motion], [np.array(M) for M in outputs]


def entry(base: float, slope: float) -> str:
    """One entry: a number, or a straight line in s."""
    if slope == 0:
        return repr(float(base))
    return f'"{float(base)!r} {"+" if slope > 0 else "-"} {abs(float(slope))!r}*s"'


def rows(base, slope) -> str:
    """A matrix."""
    return "[" + ", ".join("[" + ", ".join(entry(a, b) for a, b in zip(*pair)) + "]" for pair in zip(base, slope)) + "]"


def mode_text(car: dict, sizes: dict, period: float, low: float, high: float, measured: str) -> str:
    """One range of speeds; ``measured``: "steering_unknown" or "a_y" (one output), or "both"."""
    found = sampled_cover(*bicycle(car), period, arb(1) / high, arb(1) / low)
    reach = np.array([*sizes["x"], sizes["steering"] + sizes["fault"], sizes["wind"]])
    rest = np.nextafter(found.radius @ reach * (1 + 1e-12), np.inf)
    M, S = found.base, found.slope
    zero, unit = np.zeros((1, 1)), np.array([[0.0, 1.0]])
    parts = {"A": (M[:2, :2], S[:2, :2]), "C": (M[2:, :2], S[2:, :2])}
    wind = np.hstack([M[:2, 3:], np.diag(rest[:2])]), np.hstack([S[:2, 3:], np.zeros((2, 2))])
    direct = np.hstack([M[2:, 3:], np.zeros((1, 2))]), np.hstack([S[2:, 3:], np.zeros((1, 2))])
    blind = measured == "steering_unknown"
    noise = [[1.0, 0.0, float(rest[2])]]
    into, onto = (M[:2, 2:3], S[:2, 2:3]), (M[2:, 2:3], S[2:, 2:3])
    if measured == "both":
        parts["C"] = tuple(np.vstack([a, b]) for a, b in zip(parts["C"], (unit, 0 * unit)))
        direct = tuple(np.vstack([a, np.zeros((1, 3))]) for a in direct)
        onto = tuple(np.vstack([a, zero]) for a in onto)
        noise.append([0.0, 1.0, 0.0])
    if blind:
        wind, direct = (tuple(np.hstack(pair) for pair in zip(*sides)) for sides in ((wind, into), (direct, onto)))
    parts |= {} if blind else {"B": into, "D": onto}
    parts |= {"Bw": wind, "Dw": direct, "Bf": into, "Df": onto}
    lines = [f"\n[[mode]]\nname = \"{low:g} to {high:g} mps\""]
    lines += [f"{name:<2} = {rows(*value)}" for name, value in parts.items()]
    return "\n".join([*lines, f"Dv = {noise}"])


def plant_text(car=None, sizes=None, period: float = PERIOD, speeds=SPEEDS, record: bool = True, set_rows: int = 40,
               measured: str = "both") -> str:
    """The plant file.

    Parameters
    ----------
    car, sizes : dict, optional
    period : float
    speeds : sequence of float
    record : bool
        With the recorded scenario.
    set_rows : int
    measured : {"both", "a_y", "steering_unknown"}
        The last: lateral acceleration alone, and the driver's steering is a disturbance.

    Returns
    -------
    str
    """
    car, sizes = car or CAR, sizes or SIZES
    a = float(np.exp(-2 * np.pi * sizes["target"] * period))
    names = [f"{low:g} to {high:g} mps" for low, high in zip(speeds, speeds[1:])]
    schedule = str([[600 * k // len(names), name] for k, name in enumerate(names)]).replace("'", '"')
    head = HEAD.format(period=period, x0=sizes["x"][0], x1=sizes["x"][1], u=sizes["steering"], wind=sizes["wind"],
                       a_y=sizes["a_y"], yaw=sizes["yaw_rate"], f=sizes["fault"])
    if measured != "both":
        head = head.replace(', { name = "yaw", unit = "rad/s", range = [-1, 1] }', "")
    modes = "\n".join(mode_text(car, sizes, period, low, high, measured) for low, high in zip(speeds, speeds[1:]))
    tail = TAIL.format(one=1 - a, a=a, target=sizes["target"], rows=set_rows, schedule=schedule, u=sizes["steering"],
                       f=sizes["fault"])
    text = f"{head}{modes}\n{tail}{RECORD if record else ''}"
    if measured == "steering_unknown":  # one more disturbance in place of the input
        driven = f'[{{ name = "steering", unit = "rad", range = [-{sizes["steering"]}, {sizes["steering"]}] }}]'
        more = driven[1:].replace("range", "bounds")
        text = text.replace(f"u = {driven}\n", "").replace('{ name = "rest_yaw", bounds = [-1, 1] }]',
                                                            '{ name = "rest_yaw", bounds = [-1, 1] }, ' + more)
        text = text.replace(f'u     = ["{sizes["steering"]}*sin(0.02*k)"]\n', "")
    return text


def record_text() -> str:
    """The record with the offsets of its sensors (from its first 40 s) taken off, and the mode of each sample."""
    r = np.genfromtxt(HERE / "rav4.csv", delimiter=",", names=True)
    yaw = r["yaw_rate"] + np.deg2rad(0.44)
    lateral = r["a_y"] - np.mean((r["a_y"] - r["speed"] * yaw)[:TRAIN])
    names = [f"{low:g} to {high:g} mps" for low, high in zip(SPEEDS, SPEEDS[1:])]
    modes = [names[int(np.searchsorted(SPEEDS[1:-1], v))] for v in r["speed"]]
    lines = ["steering,a_y,yaw,mode"]
    lines += [f"{s:.7f},{a:.5f},{w:.6f},{m}" for s, a, w, m in zip(r["steering"], lateral, yaw, modes)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write both files."""
    (HERE.parent / "vehicle.toml").write_text(plant_text(), encoding="utf-8", newline="\n")
    (HERE / "rav4_ranges.csv").write_text(record_text(), encoding="ascii", newline="\n")


if __name__ == "__main__":
    main()
