"""What a user would pick instead: each file prints one rival's code for a case, as that rival's user would write it.

``sources(case)`` returns file name -> text; the code defines ``<rival>_step`` on the structs of bench.h and is
generated or written here at run time, nothing of it is kept. ``NEEDS`` names the Python module, ``HEADER`` the C++
header that the rival cannot do without.
"""

from __future__ import annotations

from . import casadi_mx, casadi_sx, eigen, loop_fixed, loop_generic, symforce_cpp, sympy_c

RIVALS = {rival.__name__.rpartition(".")[2]: rival
          for rival in (casadi_sx, casadi_mx, eigen, loop_fixed, loop_generic, symforce_cpp, sympy_c)}
