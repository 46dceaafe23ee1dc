# Types in C of tire_forces.py, and what other compiled modules call.
cdef double INFINITY, SLIP_FLOOR, MIN_RESISTED_SPEED, MIN_LOAD
cdef int V_X, V_Y, GYRO_BIAS_Z, ACCEL_BIAS_X, ACCEL_BIAS_Y, SLIP_VEL_L, LN_STIFFNESS, LN_FRICTION
cdef int RESISTANCE, LATERAL_SHARE, LN_LATERAL, COM_X, COM_Y, IMU_X, IMU_Y


cdef class TireForces:
    cdef readonly double[:, ::1] H
    cdef double[:, ::1] _P
    cdef readonly double rolling[4]
    cdef double _wheel_x[4]
    cdef double _wheel_y[4]
    cdef double _x_imu, _y_imu, _mass
    cdef object _robot
    cdef double _level[4]  # N, loads at rest ...
    cdef double _by_x[4]   # kg, ... and their derivatives by acceleration
    cdef double _by_y[4]
    cdef double _scale     # of derivatives in the Jacobian
    cdef int _x_row        # of the Jacobian, of forces along x ...
    cdef int _y_row        # ... and along y
    cdef double _stiffness, _friction, _resistance, _share, _lateral_ratio, _com_x, _com_y

    cpdef (double, double) roll(self, double[::1] x, double W, residual)
    cpdef list loads(self, double[::1] x, double force_x, double force_y)
    cpdef list tractions(self, double[::1] x, double W, loads)
    cpdef (double, double) center_arm(self, double[::1] x) noexcept
    cpdef (double, double) balance(self, double[::1] x, double W, double yaw_accel,
                                   double force_x, double force_y) noexcept
    cdef (double, double) _arms(self, int i, double[::1] x) noexcept
    cdef double _load(self, int i, double a_x, double a_y) noexcept
    cdef (double, double) _add_tread(self, int i, double[::1] x, double W, double load) noexcept
    cdef (double, double) _add_drag(self, int i, double[::1] x, double W, double load) noexcept
    cdef void _add_velocity(self, double x_by_u, double y_by_u, double x_by_v, double y_by_v,
                            double arm_x, double arm_y, double W) noexcept
    cdef void _add(self, int row, double x, double y) noexcept
