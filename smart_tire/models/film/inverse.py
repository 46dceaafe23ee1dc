# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True, show_performance_hints=False

"""
Exact inverse of the Duhem operator A(17), ``hysteresis``, on one branch.

With ``c = g + s z0``, ``m = alpha c / a`` and ``r = alpha |y - y0| / a`` the input distance
``x = alpha |u - u0|`` solves ``x - m (1 - exp(-x)) = r``: ``x = r + m + W(-m exp(-(r + m)))`` with
the principal branch of the Lambert W function. Inside the band 0 <= m <= 1 and the solution is
unique. Outside it a branch of the operator is not monotone, and two inputs have the same output.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import copysign, expm1, fabs, sqrt
else:
    from math import copysign, expm1, fabs, sqrt

COMPILED: bool = cython.compiled

MAX_NEWTON_STEPS = 12  # seven suffice, see the tests
STEP_TOLERANCE = 1e-9  # relative, of the input: the next Newton step would be its square
ALPHA, A, B, INPUT, Z, ROWS = range(6)  # of the states of ``advanced``

cython.declare(MAX_STEPS=cython.int, TOLERANCE=cython.double)
MAX_STEPS, TOLERANCE = MAX_NEWTON_STEPS, STEP_TOLERANCE


@cython.ccall
def input_distance(r: cython.double, m: cython.double) -> cython.double:
    """
    Return the solution x >= 0 of ``x - m (1 - exp(-x)) = r`` for r >= 0 and 0 <= m <= 1.

    >>> print(f'{input_distance(0.1, 0.5):.4f} {input_distance(1.0, 1.0):.4f}')
    0.1841 1.8414
    """
    if r == 0.0:
        return 0.0
    linear: cython.double = max(1.0 - m, 0.0)
    # lower bound: root of (1 - m) x + m x^2 / 2 = r, exact for small x
    x: cython.double = max(2.0 * r / (linear + sqrt(linear * linear + 2.0 * m * r)), r)
    decay: cython.double
    step: cython.double
    # convex: after the first step Newton's method converges from above
    for _ in range(MAX_STEPS):
        decay = expm1(-x)
        step = (x + m * decay - r) / (linear - m * decay)
        x = max(x - step, r)
        if not fabs(step) > TOLERANCE * x:
            break
    return x


def advanced(states: cython.double[:, ::1], dy: cython.double[::1]) -> Array:
    """
    Return inputs and z (2, n) of states after their outputs have changed by ``dy`` (n,).

    ``states`` (5, n): alpha, a and b of each operator, and its input and z at the start of the
    branch, inside the band. Raise ValueError where shapes disagree.

    >>> u, z = advanced(np.array([[0.15], [0.54], [0.28], [0.0], [0.0]]), np.ones(1))
    >>> print(u.round(3), z.round(3))
    [3.022] [-0.632]
    """
    n: cython.Py_ssize_t = dy.shape[0]
    if not (states.shape[0] == ROWS and states.shape[1] == n):
        raise ValueError('the shapes of the arrays disagree')
    found = np.empty((2, n))
    if not cython.compiled:  # numbers of numpy are slow
        states, dy = states.tolist(), dy.tolist()
    alpha: cython.double[::1] = states[ALPHA]
    a: cython.double[::1] = states[A]
    b: cython.double[::1] = states[B]
    u: cython.double[::1] = states[INPUT]
    z: cython.double[::1] = states[Z]
    inputs: cython.double[::1] = found[0]
    results: cython.double[::1] = found[1]
    i: cython.Py_ssize_t
    for i in range(n):
        sign: cython.double = copysign(1.0, dy[i])
        reach: cython.double = (a[i] - b[i]) / alpha[i] + sign * z[i]
        scale: cython.double = alpha[i] / a[i]
        x: cython.double = input_distance(scale * fabs(dy[i]), scale * reach)
        inputs[i] = u[i] + sign * x / alpha[i]
        results[i] = z[i] + sign * reach * expm1(-x)
    return found
