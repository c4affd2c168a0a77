"""Small polytopic plants, in discrete and in continuous time."""

#: A discrete plant with an algebraic state, two vertices, disturbance and noise; weights of a state.
DISCRETE = """
format = 1
name = "tank"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "level", range = [-1, 1] }, { name = "flow", range = [-2, 2] }]
u = [{ name = "pump", range = [-1, 1] }]
y = [{ name = "level", range = [-2, 2] }, { name = "flow", range = [-3, 3] }]
w = [{ name = "leak", bounds = [-0.01, 0.01] }]
v = [{ name = "noise", bounds = [-0.02, 0.02] }]
f = [{ name = "level sensor", range = [-1, 1] }]
[initial]
x_lo = [-0.1, -0.2]
x_hi = [0.1, 0.2]
[common]
E = [[1, 0], [0, 0]]
C = [[1, 0], [0, 1]]
Bw = [[1], [0]]
Dv = [[1], [0.5]]
Df = [[1], [0]]
[[vertex]]
A = [[0.7, 0], [1, -1]]
B = [[0.1], [0.5]]
weight = "0.5 - 0.5*level"
[[vertex]]
A = [[0.6, 0.05], [0.9, -1.2]]
B = [[0.12], [0.5]]
weight = "0.5 + 0.5*level"
[[scenario]]
name = "corner"
steps = 300
u = ["sign(sin(0.3*k))"]
w = "corner"
v = "corner"
[[scenario]]
name = "fault"
steps = 200
u = ["0.3*sin(0.1*k)"]
fault = [{ channel = "level sensor", from = 100, to = 120, value = "0.9" }]
"""

CONTINUOUS = DISCRETE
for old, new in (('kind = "discrete"', 'kind = "continuous"'), ("sample_period = 0.1", "sample_period = 0.02"),
                 ("[[0.7, 0], [1, -1]]", "[[-3, 0], [1, -1]]"),
                 ("[[0.6, 0.05], [0.9, -1.2]]", "[[-4, 0.5], [0.9, -1.2]]"),
                 ("[[0.1], [0.5]]", "[[1], [0.5]]"), ("[[0.12], [0.5]]", "[[1.2], [0.5]]")):
    CONTINUOUS = CONTINUOUS.replace(old, new)
