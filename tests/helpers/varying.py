"""A continuous plant with every kind of parameter, small enough for a design in a second."""

from codegen.plant.load import loads
from codegen.select import choose

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
