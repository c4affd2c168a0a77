"""Own small plants that expose what the gallery does not."""

# No disturbance, no noise, the initial state known, |u| <= 1: the real-number framers are the state itself, so
# nothing but the rounding margin keeps it inside.
SILENT = """
format = 1
name = "silent"
title = "Nothing but rounding"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
switching = { known = true }
[signals]
x = [{ name = "a", range = [-9, 9] }, { name = "b", range = [-9, 9] }, { name = "c", range = [-9, 9] }]
u = [{ name = "u", range = [-1, 1] }]
y = [{ name = "y", range = [-30, 30] }]
[initial]
x_lo = [0.3, -0.7, 0.1]
x_hi = [0.3, -0.7, 0.1]
[common]
C = [[1, 0.3, 0.7]]
[[mode]]
name = "one"
A = [[0.61, 0.17, 0.13], [0.07, 0.51, 0.23], [0.11, 0.03, 0.57]]
B = [[0.37], [-0.43], [0.29]]
[[mode]]
name = "two"
A = [[0.33, 0.27, 0.19], [0.21, 0.41, 0.09], [0.15, 0.23, 0.31]]
B = [[-0.31], [0.77], [0.53]]
"""

# Noise on one side of zero only, a disturbance that never vanishes, a feedthrough.
LOPSIDED = """
format = 1
name = "lopsided"
title = "Noise that only adds"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
[signals]
x = [{ name = "a", range = [-40, 60] }, { name = "b", range = [-40, 60] }]
u = [{ name = "u", range = [-5, 7] }]
y = [{ name = "y1", range = [-150, 150] }, { name = "y2", range = [-150, 150] }]
w = [{ name = "w", bounds = [0.1, 0.7] }]
v = [{ name = "v1", bounds = [0, 3] }, { name = "v2", bounds = [1, 2] }]
[initial]
x_lo = [-1, -2]
x_hi = [2, 1]
[common]
C = [[1, 0.5], [-0.4, 1]]
Dv = [[1, 0], [0, -0.3]]
DIRECT
[[mode]]
name = "one"
A = [[0.7, -0.2], [0.3, 0.5]]
B = [[1], [-0.5]]
Bw = [[1], [0.4]]
[[mode]]
name = "two"
A = [[0.4, 0.3], [-0.25, 0.8]]
B = [[0.3], [0.9]]
Bw = [[-0.6], [1]]
"""
