// Parameters of the flight core: one table for names, defaults, limits, units and meaning.
//
// Names follow PX4 where the meaning is PX4's (docs.px4.io, parameter reference), at most 16 characters as MAVLink
// demands. Defaults fly an X500: 2.06 kg, rotors at (+-0.174, +-0.174) m, T = 8.54858e-6 * (1000 u)^2 N per rotor,
// moment ratio 0.016 m. Another airframe is another set of CA_*, MPC_THR_HOVER and MC_* values; nothing here
// knows mass or inertia, only the hover thrust and the normalised rate gains, as in PX4.
#pragma once

#include <array>
#include <cstddef>

namespace hil::flight {

// Rotor `n`, in the order of RotorParam.
#define HIL_ROTOR_PARAMS(X, n, px, py, km)                                                                          \
    X(CA_ROTOR##n##_PX, px, -10.0, 10.0, "m", "rotor position forward of the centre of mass")                       \
    X(CA_ROTOR##n##_PY, py, -10.0, 10.0, "m", "rotor position to the right of the centre of mass")                  \
    X(CA_ROTOR##n##_PZ, 0.0, -10.0, 10.0, "m", "rotor position below the centre of mass")                           \
    X(CA_ROTOR##n##_AX, 0.0, -100.0, 100.0, "1", "axis of the thrust, forward")                                     \
    X(CA_ROTOR##n##_AY, 0.0, -100.0, 100.0, "1", "axis of the thrust, to the right")                                \
    X(CA_ROTOR##n##_AZ, -1.0, -100.0, 100.0, "1", "axis of the thrust, down")                                       \
    X(CA_ROTOR##n##_CT, 6.5, 0.0, 100.0, "1", "thrust coefficient, in any unit: only ratios between rotors count")  \
    X(CA_ROTOR##n##_KM, km, -1.0, 1.0, "m", "moment per thrust; positive: turns counter-clockwise seen from above")

// X(name, default, minimum, maximum, unit, meaning)
#define HIL_FLIGHT_PARAMS(X)                                                                                        \
    X(EKF_GPS_DELAY, 100.0, 0.0, 220.0, "ms", "age of a GPS fix when it arrives")                                   \
    X(EKF_GPS_P_NOISE, 0.02, 0.001, 10.0, "m", "lower limit of the GPS position noise from eph and epv")            \
    X(EKF_GPS_V_NOISE, 0.10, 0.01, 5.0, "m/s", "GPS velocity noise")                                                \
    X(EKF_GPS_T_NOISE, 0.005, 0.0, 0.1, "s", "uncertainty of EKF_GPS_DELAY: adds speed times this to the noise")    \
    X(EKF_GPS_GATE, 5.0, 1.0, 100.0, "SD", "innovation gate of GPS position and velocity")                          \
    X(EKF_REQ_EPH, 3.0, 0.1, 100.0, "m", "worst horizontal accuracy of a fix that is used")                         \
    X(EKF_REQ_EPV, 5.0, 0.1, 100.0, "m", "worst vertical accuracy of a fix that is used")                           \
    X(EKF_BARO_NOISE, 0.5, 0.01, 15.0, "m", "barometer altitude noise")                                             \
    X(EKF_BARO_DRIFT, 0.02, 0.0, 1.0, "m/sqrt(s)", "random walk of the barometer's offset")                         \
    X(EKF_BARO_GATE, 5.0, 1.0, 100.0, "SD", "innovation gate of the barometer")                                     \
    X(EKF_MAG_DECL, 0.0, -180.0, 180.0, "deg", "magnetic declination, east positive")                               \
    X(EKF_HEAD_NOISE, 0.05, 0.005, 1.0, "rad", "magnetic heading noise")                                            \
    X(EKF_HEAD_GATE, 4.0, 1.0, 100.0, "SD", "innovation gate of the magnetic heading")                              \
    X(EKF_GYR_NOISE, 5.0e-4, 1.0e-6, 0.1, "rad/s/sqrt(Hz)", "gyro noise density")                                   \
    X(EKF_ACC_NOISE, 1.0e-2, 1.0e-5, 1.0, "m/s^2/sqrt(Hz)", "accelerometer noise density")                          \
    X(EKF_GYR_B_NOISE, 2.0e-5, 0.0, 0.01, "rad/s/sqrt(s)", "random walk of the gyro bias")                          \
    X(EKF_ACC_B_NOISE, 3.0e-4, 0.0, 0.01, "m/s^2/sqrt(s)", "random walk of the accelerometer bias")                 \
    X(EKF_ABL_LIM, 0.4, 0.0, 2.0, "m/s^2", "largest accelerometer bias learned")                                    \
    X(EKF_GBL_LIM, 0.15, 0.0, 1.0, "rad/s", "largest gyro bias learned")                                            \
    X(EKF_ALIGN_T, 1.0, 0.1, 30.0, "s", "time at rest that alignment averages over")                                \
    X(EKF_REJECT_T, 5.0, 0.5, 60.0, "s", "time without an accepted sample before the state is reset to the sensor") \
    X(EKF_NOAID_T, 5.0, 0.5, 60.0, "s", "time without GPS after which position is no longer valid")                 \
    X(EKF_GRAVITY, 9.80665, 9.7, 9.9, "m/s^2", "local gravity")                                                     \
    X(MPC_XY_P, 1.3, 0.1, 5.0, "1/s", "horizontal position gain")                                                   \
    X(MPC_Z_P, 1.2, 0.1, 5.0, "1/s", "vertical position gain")                                                      \
    X(MPC_XY_VEL_P_ACC, 3.0, 0.1, 10.0, "1/s", "horizontal velocity gain")                                          \
    X(MPC_XY_VEL_I_ACC, 1.0, 0.0, 10.0, "1/s^2", "horizontal velocity integral gain")                               \
    X(MPC_XY_VEL_D_ACC, 0.1, 0.0, 2.0, "1", "horizontal acceleration damping")                                      \
    X(MPC_Z_VEL_P_ACC, 4.0, 0.1, 15.0, "1/s", "vertical velocity gain")                                             \
    X(MPC_Z_VEL_I_ACC, 2.0, 0.0, 10.0, "1/s^2", "vertical velocity integral gain")                                  \
    X(MPC_Z_VEL_D_ACC, 0.0, 0.0, 2.0, "1", "vertical acceleration damping")                                         \
    X(MPC_XY_VEL_MAX, 12.0, 0.1, 20.0, "m/s", "largest horizontal speed")                                           \
    X(MPC_Z_VEL_MAX_UP, 3.0, 0.1, 8.0, "m/s", "largest climb speed")                                                \
    X(MPC_Z_VEL_MAX_DN, 1.5, 0.1, 4.0, "m/s", "largest descent speed")                                              \
    X(MPC_ACC_HOR_MAX, 5.0, 0.5, 15.0, "m/s^2", "largest horizontal acceleration asked for by a set-point change")  \
    X(MPC_ACC_UP_MAX, 4.0, 0.5, 15.0, "m/s^2", "largest upward acceleration asked for by a set-point change")       \
    X(MPC_ACC_DOWN_MAX, 3.0, 0.5, 15.0, "m/s^2", "largest downward acceleration asked for by a set-point change")   \
    X(MPC_JERK_MAX, 40.0, 1.0, 500.0, "m/s^3", "largest rate of change of the acceleration set-point")              \
    X(MPC_TILTMAX_AIR, 35.0, 5.0, 80.0, "deg", "largest tilt asked for by position control")                        \
    X(MPC_THR_HOVER, 0.591, 0.1, 0.8, "1", "hover thrust, fraction of full thrust (before THR_MDL_FAC)")            \
    X(MPC_THR_MIN, 0.08, 0.01, 0.5, "1", "smallest collective thrust in flight")                                    \
    X(MPC_THR_MAX, 1.0, 0.3, 1.0, "1", "largest collective thrust")                                                 \
    X(MPC_THR_XY_MARG, 0.2, 0.0, 0.5, "1", "thrust kept for horizontal control when climbing needs it all")         \
    X(MPC_TKO_RAMP_T, 1.0, 0.0, 5.0, "s", "time over which the thrust limit rises to its full value at take-off")   \
    X(MPC_YAWRAUTO_MAX, 60.0, 5.0, 360.0, "deg/s", "largest rate of the yaw set-point")                             \
    X(MC_ROLL_P, 6.5, 0.0, 12.0, "1/s", "roll angle gain")                                                          \
    X(MC_PITCH_P, 6.5, 0.0, 12.0, "1/s", "pitch angle gain")                                                        \
    X(MC_YAW_P, 2.8, 0.0, 5.0, "1/s", "yaw angle gain")                                                             \
    X(MC_YAW_WEIGHT, 0.4, 0.0, 1.0, "1", "weight of yaw against roll and pitch")                                    \
    X(MC_ROLLRATE_MAX, 220.0, 10.0, 1800.0, "deg/s", "largest roll rate asked for")                                 \
    X(MC_PITCHRATE_MAX, 220.0, 10.0, 1800.0, "deg/s", "largest pitch rate asked for")                               \
    X(MC_YAWRATE_MAX, 120.0, 10.0, 1800.0, "deg/s", "largest yaw rate asked for")                                   \
    X(MC_ROLLRATE_P, 0.13, 0.0, 0.5, "s/rad", "roll rate gain, normalised torque")                                  \
    X(MC_ROLLRATE_I, 0.2, 0.0, 2.0, "1/rad", "roll rate integral gain")                                             \
    X(MC_ROLLRATE_D, 0.002, 0.0, 0.02, "s^2/rad", "roll rate derivative gain")                                      \
    X(MC_ROLLRATE_FF, 0.0, 0.0, 0.5, "s/rad", "roll rate feed-forward")                                             \
    X(MC_PITCHRATE_P, 0.13, 0.0, 0.6, "s/rad", "pitch rate gain, normalised torque")                                \
    X(MC_PITCHRATE_I, 0.2, 0.0, 2.0, "1/rad", "pitch rate integral gain")                                           \
    X(MC_PITCHRATE_D, 0.002, 0.0, 0.02, "s^2/rad", "pitch rate derivative gain")                                    \
    X(MC_PITCHRATE_FF, 0.0, 0.0, 0.5, "s/rad", "pitch rate feed-forward")                                           \
    X(MC_YAWRATE_P, 0.4, 0.0, 1.5, "s/rad", "yaw rate gain, normalised torque")                                     \
    X(MC_YAWRATE_I, 0.2, 0.0, 2.0, "1/rad", "yaw rate integral gain")                                               \
    X(MC_YAWRATE_D, 0.0, 0.0, 0.1, "s^2/rad", "yaw rate derivative gain")                                           \
    X(MC_YAWRATE_FF, 0.0, 0.0, 0.5, "s/rad", "yaw rate feed-forward")                                               \
    X(MC_RR_INT_LIM, 0.3, 0.0, 1.0, "1", "largest roll rate integrator, normalised torque")                         \
    X(MC_PR_INT_LIM, 0.3, 0.0, 1.0, "1", "largest pitch rate integrator, normalised torque")                        \
    X(MC_YR_INT_LIM, 0.3, 0.0, 1.0, "1", "largest yaw rate integrator, normalised torque")                          \
    X(IMU_GYRO_CUTOFF, 80.0, 5.0, 1000.0, "Hz", "low-pass on the rates the controller sees")                        \
    X(IMU_DGYRO_CUTOFF, 30.0, 5.0, 1000.0, "Hz", "low-pass on the derivative of the rates")                         \
    X(LNDMC_Z_VEL_MAX, 0.25, 0.05, 1.0, "m/s", "vertical speed below which a landing can be detected")              \
    X(LNDMC_XY_VEL_MAX, 1.5, 0.1, 10.0, "m/s", "horizontal speed below which a landing can be detected")            \
    X(LNDMC_ROT_MAX, 20.0, 1.0, 180.0, "deg/s", "rotation rate below which a landing can be detected")              \
    X(LNDMC_TRIG_TIME, 0.5, 0.05, 10.0, "s", "duration of each of the two phases of the land detector")             \
    X(THR_MDL_FAC, 1.0, 0.0, 1.0, "1", "thrust curve T = f u^2 + (1 - f) u that the mixer inverts")                 \
    X(MOT_SPIN_IDLE, 0.10, 0.0, 0.5, "1", "motor command when armed on the ground, and the least one in flight")    \
    X(CA_ROTOR_COUNT, 4.0, 1.0, 8.0, "1", "number of rotors")                                                       \
    HIL_ROTOR_PARAMS(X, 0, 0.174, 0.174, 0.016)                                                                     \
    HIL_ROTOR_PARAMS(X, 1, -0.174, -0.174, 0.016)                                                                   \
    HIL_ROTOR_PARAMS(X, 2, 0.174, -0.174, -0.016)                                                                   \
    HIL_ROTOR_PARAMS(X, 3, -0.174, 0.174, -0.016)                                                                   \
    HIL_ROTOR_PARAMS(X, 4, 0.0, 0.0, 0.0)                                                                           \
    HIL_ROTOR_PARAMS(X, 5, 0.0, 0.0, 0.0)                                                                           \
    HIL_ROTOR_PARAMS(X, 6, 0.0, 0.0, 0.0)                                                                           \
    HIL_ROTOR_PARAMS(X, 7, 0.0, 0.0, 0.0)

enum ParamId : std::size_t {
#define X(name, value, lo, hi, unit, meaning) name,
    HIL_FLIGHT_PARAMS(X)
#undef X
        kParamCount
};

struct ParamInfo {
    const char *name;
    double value, minimum, maximum;
    const char *unit, *meaning;
};

inline constexpr std::array<ParamInfo, kParamCount> kParamTable{{
#define X(name, value, lo, hi, unit, meaning) {#name, value, lo, hi, unit, meaning},
    HIL_FLIGHT_PARAMS(X)
#undef X
}};

using Params = std::array<double, kParamCount>;

// Offsets from CA_ROTORn_PX.
enum RotorParam : std::size_t { kRotorPX, kRotorPY, kRotorPZ, kRotorAX, kRotorAY, kRotorAZ, kRotorCT, kRotorKM, kRotorParams };
static_assert(CA_ROTOR1_PX == CA_ROTOR0_PX + kRotorParams);

inline constexpr std::size_t kMaxRotors = 8;

}  // namespace hil::flight
