# Types in C of brush_tire.py, and what other compiled modules call.
from libc.math cimport sqrt

from smart_tire.numerics.lanes cimport Lanes

ctypedef fused Number:
    double
    Lanes
    object

ctypedef fused Real:
    double
    object

ctypedef (double, double, double, double, double, double, double) Derivatives

cdef double MIN_SLIP, SQRT_3

cdef Number friction_share(Number inverse, Number fall) noexcept
cdef Number secant(Number t, Number inverse, Number fall) noexcept
cdef Real _share(Real t) noexcept
cpdef double force_over_slip(double slip, double stiffness, double limit) noexcept
cpdef Derivatives force_with_derivatives(
    double s_x, double s_y, double stiffness, double limit, double spread=*) noexcept
