"""A continuous plant with every kind of parameter, small enough for a design in a second."""

import numpy as np

from codegen.plant.load import loads
from codegen.selection.select import choose

HEATER = """
format = 1
name = "heater"
title = "Heated tank"
source = "own example"
[time]
kind = "continuous"
sample_period = 0.02
[signals]
x = [{ name = "water", unit = "K", range = [-20, 20] }, { name = "wall", unit = "K", range = [-20, 20] }]
u = [{ name = "power", unit = "W", range = [-5, 5], rate = 2 }, { name = "inlet", unit = "K", range = [-5, 5] }]
y = [{ name = "thermometer", unit = "K", range = [-30, 30] }]
w = [{ name = "draught", bounds = [-0.1, 0.1] }]
v = [{ name = "noise", unit = "K", bounds = [-0.1, 0.1] }]
f = [{ name = "drift", unit = "K", range = [-5, 5] }, { name = "leak", unit = "W", range = [-5, 5] }]
theta = [
  { name = "flow", unit = "kg/s", bounds = [0.5, 1.5], rate = 0.5, error = 0.02 },
  { name = "loss", unit = "1/s", bounds = [0.1, 0.3], measured = false },
]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[common]
C = [[1, 0]]
Dv = [[1]]
B = [[0.5, "0.2*flow"], [0, 0]]
Bw = [[1], [0]]
Bf = [[0, 1], [0, 0]]
Df = [[1, 0]]
[[mode]]
name = "open"
A = [["-1 - flow", 0.5], [0.4, "-0.5 - loss"]]
[[mode]]
name = "shut"
A = [["-0.5 - flow", 0.5], [0.4, "-0.6 - loss"]]
bounds = { flow = [0.5, 0.8] }
[[scenario]]
name = "drift"
steps = 400
mode = { every = 80, order = ["open", "shut"] }
u = ["2*sin(0.5*t)", "1"]
theta = "uniform"
fault = [{ channel = "drift", from = 300, to = 330, value = "4" }]
"""
HELD = HEATER.replace(", rate = 2 }", " }").replace('bounds = { flow = [0.5, 0.8] }\n', "")


def heater_design(text=HEATER, method="lpv-interval", **options):
    """The design with the narrowest bounds."""
    return choose(loads(text), method, {"criterion": "width", "contraction": 0.01, **options}, lambda line: None)

# Dense coordinates with signs of every kind, in two modes and with gains of its own: R (A - L C) R^-1 > 0 in both.
CHANGED = """
format = 1
name = "changed"
title = "Three states in other coordinates"
source = "own example"
[time]
kind = "discrete"
sample_period = 1
[signals]
x = [{ name = "a", range = [-60, 60] }, { name = "b", range = [-80, 40] }, { name = "c", range = [-60, 60] }]
u = [{ name = "u", range = [-5, 7] }]
y = [{ name = "ya", range = [-150, 150] }, { name = "yb", range = [-150, 150] }]
w = [{ name = "w", bounds = [-0.1, 0.3] }]
v = [{ name = "v", bounds = [-0.2, 0.2] }]
f = [{ name = "drift", range = [-50, 50] }]
theta = [{ name = "g", bounds = [-0.01, 0.01], measured = false }]
[initial]
x_lo = [-1, -1, -1]
x_hi = [1, 1, 1]
[common]
C = [[1, 0, 0], [0, 1, 0]]
Dv = [[1], [-1]]
Df = [[1], [0]]
Bw = [[1], [-1], [0.5]]
B = [["1 + g"], [0.5], [-1]]
[[mode]]
name = "one"
A = AONE
[[mode]]
name = "two"
A = ATWO
[observer]
method = "component-interval"
coordinates = "change"
gains = { R = [[1, -1, 0.5], [0.25, 1, -0.5], [0.5, 0.25, 1]], L = LBOTH }
"""


def changed_text() -> str:
    """The plant text: A = R^-1 M R + L C with chosen M > 0, L and R."""
    R, C = np.array([[1, -1, 0.5], [0.25, 1, -0.5], [0.5, 0.25, 1]]), np.eye(2, 3)
    M = np.array([[[0.3, 0.1, 0.05], [0.2, 0.25, 0.1], [0.1, 0.05, 0.4]],
                  [[0.1, 0.3, 0.1], [0.05, 0.2, 0.2], [0.3, 0.02, 0.1]]])
    L = np.array([[[0.4, -0.3], [0.2, 0.5], [-0.1, 0.2]], [[0.1, 0.2], [-0.3, 0.3], [0.2, -0.4]]])
    A = np.linalg.inv(R) @ M @ R + L @ C

    def unsure(matrix):
        rows = [[f'"{x!r} + g"' if (i, j) in ((0, 1), (2, 2)) else repr(float(x)) for j, x in enumerate(row)]
                for i, row in enumerate(matrix.tolist())]
        return "[" + ", ".join("[" + ", ".join(row) + "]" for row in rows) + "]"
    return CHANGED.replace("AONE", unsure(A[0])).replace("ATWO", unsure(A[1])).replace("LBOTH", repr(L.tolist()))


def changed_design():
    """The design with the gains of the plant."""
    plant = loads(changed_text())
    return choose(plant, plant.method, plant.options, lambda line: None)
