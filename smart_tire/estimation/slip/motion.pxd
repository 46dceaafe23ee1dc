# Types in C of motion.py, and what other compiled modules call.
cdef double NAN, GRAVITY, SLIP_CORRELATION_TIME, SLOPE_LENGTH, MIN_SLIP_SPEED
cdef double MAX_SAMPLE_GAP
cdef int X, Y, YAW, ROLL, PITCH, V_X, V_Y, GYRO_BIAS_Z, ACCEL_BIAS_X, ACCEL_BIAS_Y, SLIP_VEL_L
cdef int SLIP_VEL_R, TRAVEL_L, ICR_X, ICR_L, ICR_R, IMU_X, IMU_Y

cpdef double slip_speed(double left, double right) noexcept
cpdef double wheel_slip_ratio(double rolling, double ground, double standstill_speed) noexcept
cpdef void fill_covariances(double[:, :] P, double W, double x_imu, double y_imu, double[::1] pose,
                            double[::1] twist) noexcept


cdef class RollingHistory:
    cdef object _points
    cdef tuple _last

    cpdef add_step(self, double time, double dt, double left, double right)


cdef class MotionModel:
    cdef double _arms[2]     # m, v_x of the sides by the yaw rate, nominal
    cdef double _x_imu, _y_imu
    cdef double _gyro_walk   # (rad/s)^2 per s, of the gyro bias
    cdef double _accel_walk  # (m/s2)^2 per s
    cdef readonly double[:, ::1] F, Q

    cpdef double arm(self, double[::1] x, int side) noexcept
    cpdef double rolling_rate(self, double[::1] x, double W, int side) noexcept
    cpdef (double, double) steady_force(self, double[::1] x, double W) noexcept
    cpdef extrapolate(self, x, imu, double dt)
    cpdef predict(self, x, step, noise)
    cpdef wheel_slips(self, double[::1] x, double[:, :] P, double W, residual, hidden,
                      double standstill_speed)
    cdef double _slip_sigma(self, double[::1] x, double[:, :] P, double W, int side) noexcept
    cdef double _move(self, double[::1] x, double[::1] moved, double W, double force_x,
                      double force_y, double dt) noexcept
    cdef void _predict_slope(self, double[::1] x, double[::1] moved, double W, double dt,
                             double way, int row, double sigma) noexcept
    cdef void _predict_slip(self, double[::1] x, double[::1] moved, double begin_rate,
                            double end_rate, double W, double dt, noise)
