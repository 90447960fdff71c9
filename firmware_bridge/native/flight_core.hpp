// The mock autopilot's hot loop: estimator, controller, mixer and land detector behind one step per IMU sample.
//
// Contract: NED/FRD, SI, doubles; time in integer microseconds, advancing. `state` and `controls` belong to the core
// and are rewritten by every step (state also by the update_* calls). No allocation after construction, no clock, no
// randomness, detmath only: the same sequence of calls gives the same bytes on every machine.
//
// Order within a tick, as messages arrive: update_gps / update_baro / update_mag for new samples, and step() for the
// IMU sample; step() predicts, controls and mixes, so a sample fused after it acts in the next tick.
#pragma once

#include <cstdint>

#include "control.hpp"
#include "ekf.hpp"
#include "land_detector.hpp"
#include "mixer.hpp"
#include "params.hpp"

namespace hil::flight {

inline constexpr int kStateSize = 64, kControlSize = 16;

struct StateField {
    const char *name;
    int offset, size;
};

// Layout of `state`. Flags are 0.0 or 1.0.
inline constexpr StateField kStateFields[] = {
    {"t_us", 0, 1},
    {"p_NF", 1, 3},             // m, local NED from the origin
    {"v_NF_N", 4, 3},           // m/s
    {"q_NF", 7, 4},             // w x y z, body FRD to NED
    {"w_NF_F", 11, 3},          // rad/s, bias-corrected
    {"gyro_bias", 14, 3},       // rad/s
    {"accel_bias", 17, 3},      // m/s^2
    {"a_NF_N", 20, 3},          // m/s^2, gravity removed
    {"origin", 23, 3},          // latitude deg, longitude deg, altitude m; NaN until set
    {"std_p", 26, 3},           // m
    {"std_v", 29, 3},           // m/s
    {"std_att", 32, 3},         // rad, about the body axes
    {"test_ratios", 35, 4},     // gps position, gps velocity, baro, mag; > 1 was rejected
    {"attitude_ok", 39, 1},
    {"velocity_ok", 40, 1},
    {"position_ok", 41, 1},
    {"tilt_aligned", 42, 1},
    {"yaw_aligned", 43, 1},
    {"resets", 44, 1},          // count of state resets
    {"rejected", 45, 5},        // count of samples: imu, gps, baro, mag; and fusions skipped for numerical reasons
    {"rejected_setpoints", 50, 1},
    {"euler", 51, 3},           // roll, pitch, yaw, rad
    {"euler_sp", 54, 3},        // roll, pitch, yaw set-point, rad
    {"thrust_sp", 57, 1},       // collective, fraction of full thrust
    {"landed", 58, 1},
    {"ground_contact", 59, 1},
    {"baro_offset", 60, 1},     // m, barometer minus GPS altitude
    {"nis_gps", 61, 2},         // normalised innovation squared of position and of velocity, 3 degrees of freedom each
    {"saturation", 63, 1},      // share of roll and pitch that the mixer produced, 0..1
};

class FlightCore {
   public:
    // `rotors` false: an estimator alone, whose vehicle is flown by another controller: all commands stay 0, the
    // CA_ROTOR parameters have no meaning, and `set_landed` tells whether the vehicle is on the ground.
    explicit FlightCore(const Params &params, bool rotors = true);
    FlightCore(const FlightCore &) = delete;
    FlightCore &operator=(const FlightCore &) = delete;

    // Sets an entry of kParamTable; the caller checks its limits. False, and nothing changed, if the rotors could no
    // longer produce roll, pitch, yaw and thrust.
    bool set_param(std::size_t index, double value);
    double param(std::size_t index) const { return params_[index]; }

    void step(std::int64_t t_us, Vec3 gyro_F, Vec3 force_F);
    void update_gps(const GpsFix &fix);
    void update_baro(std::int64_t t_us, double altitude_m);
    void update_mag(std::int64_t t_us, Vec3 field_F_gauss);
    // Only without rotors: on the ground the estimator may take a vehicle without GPS as being at rest.
    void set_landed(bool landed) { told_landed_ = landed; }
    // False, and the old set-point stays, if a component is infinite or too large.
    bool set_setpoint(const Setpoint &setpoint);

    double *state() { return state_; }
    double *controls() { return controls_; }
    bool landed() const { return rotors_ ? land_.landed() : told_landed_; }
    const Ekf &ekf() const { return ekf_; }
    const LocalTangentPlane &plane() const { return ekf_.plane(); }

   private:
    void control(double dt);
    void publish_estimate();
    void publish_control();

    const bool rotors_;
    bool told_landed_ = true;
    Params params_;
    Ekf ekf_;
    Controller controller_;
    LandDetector land_;
    Mixer mixer_;
    bool mixer_ok_ = false;
    Setpoint setpoint_;
    std::int64_t t_us_ = -1, rejected_setpoints_ = 0;
    double ramp_s_ = 0.0;
    double saturation_ = 1.0;
    double state_[kStateSize] = {}, controls_[kControlSize] = {};
};

}  // namespace hil::flight
