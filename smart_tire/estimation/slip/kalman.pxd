# Types in C of kalman.py, and what other compiled modules call.
cdef double INFINITY, OUTLIER_SIGMAS, MIN_SHARE
cdef int X, Y, YAW, GYRO_BIAS_Z, LN_STIFFNESS, LN_FRICTION, RESISTANCE


cdef class LearnedVariance:
    cdef double _variance, _floor, _time
    cdef readonly double variance

    cpdef void add_square(self, double square, double duration) noexcept


cdef class KalmanFilter:
    cdef readonly object x, P   # array('d') (n,) and array (n, n) ...
    cdef double[::1] _x         # ... and the same memory
    cdef double[:, ::1] _P, _A
    cdef double[:, ::1] _G      # rows: gains of two innovations, the part that is not applied
    cdef readonly list ground   # (3,)
    cdef object _recorder

    cpdef predict(self, next_x, double[:, ::1] F, double[:, ::1] Q)
    cpdef double correct(self, double y, double[::1] h, double variance, double[::1] held,
                         int row=*, double shared=*) except? -1.0
    cpdef double correct_jointly(self, double[::1] y, double[:, ::1] H, double[:, ::1] R,
                                 double[::1] held) except? -1.0
    cpdef (double, double, double) covariance(self, double[:, ::1] H, double[:, ::1] R)
    cpdef void fade_ground(self, double keep) noexcept
    cdef void _propagate(self, double[:, ::1] F, double[:, ::1] Q)
    cdef void _fill_column(self, double[:, ::1] F, Py_ssize_t j) noexcept
    cdef void _project(self, double[::1] h, double[::1] out)
    cdef void _apply(self, double[::1] g, double y, double variance, double[::1] held)
    cdef void _hold_position(self, double[::1] d) noexcept


cdef double _least_variance(double y) noexcept
cdef double _dot(double[::1] a, double[::1] b) noexcept
