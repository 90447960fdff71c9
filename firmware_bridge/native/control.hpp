// Cascaded multirotor control: position P -> velocity PID -> attitude P (quaternion) -> rate PID.
//
//   v_sp = v_ff + shaped(P (p_sp - p))         shaped: square-root law beyond the linear range, so that braking
//                                              never needs more than the acceleration limit
//   a_sp = a_ff + P (v_sp - v) + I + D (a_ff - a)
//   thrust vector (fractions of full thrust) = (a_sp - (0, 0, g)) * hover / g, tilt- and size-limited
//   attitude: body z against the thrust vector, body x towards yaw; collective = thrust vector . actual body -z
//   w_sp = attitude error * P + yaw speed        (Brescianini, Hehn, D'Andrea, "Nonlinear quadrocopter attitude
//                                              control", ETH 2013; reduced attitude first, yaw by weight)
//   torque = P (w_sp - w) + I - D dw/dt + FF w_sp     normalised, as the mixer takes it
//
// NED/FRD, SI. Everything runs at the IMU rate. Set-points may jump: velocity, acceleration and yaw
// set-points are slew-limited here for safety (smooth trajectories come from guidance). Integrators stop when their
// demand cannot be met, and are zero on the ground. detmath only; no allocation.
#pragma once

#include "mixer.hpp"
#include "params.hpp"
#include "rotation.hpp"

namespace hil::flight {

enum class SetpointKind : int { Off = 0, Idle = 1, Position = 2, Velocity = 3, Attitude = 4, Rate = 5 };

struct Setpoint {
    SetpointKind kind = SetpointKind::Off;
    Vec3 p, v, a;  // NaN component: that axis is not commanded
    double yaw = 0.0, yawspeed = 0.0;
};

// State of the vehicle for the controller, from the estimator.
struct Motion {
    Vec3 p_N, v_N, a_N;
    Quat q_NF;
    Vec3 w_F;
    bool position_ok = false, velocity_ok = false;
};

struct Demand {
    double roll = 0.0, pitch = 0.0, yaw = 0.0, thrust = 0.0;  // mixer inputs
};

class Controller {
   public:
    explicit Controller(const Params &params) : params_(params) {}

    // Resets integrators, filters and slewed set-points; the next step starts from the vehicle's motion.
    void reset();

    // `on_ground`: integrators stay zero, tilt and yaw are not corrected against the ground.
    // `thrust_limit`: upper limit of the collective (take-off ramp, touch-down).
    Demand step(const Setpoint &sp, const Motion &m, bool on_ground, double thrust_limit, double dt);

    // Takes the part of the demand that the mixer could not produce, for the integrators of the next step.
    void saturated(const Saturation &s) { saturation_ = s; }

    Vec3 velocity_setpoint() const { return v_sp_; }
    Quat attitude_setpoint() const { return q_sp_; }
    double collective() const { return collective_; }
    // True if the pilot or the position loop commands a climb.
    bool wants_up() const { return wants_up_; }
    bool wants_down() const { return wants_down_; }

   private:
    Vec3 position_loop(const Setpoint &sp, const Motion &m, double dt);
    Vec3 velocity_loop(const Setpoint &sp, const Motion &m, Vec3 v_target, bool on_ground, double dt);
    Vec3 attitude_loop(const Motion &m, double yawspeed) const;
    void rate_loop(const Motion &m, bool on_ground, double dt, Demand &out);
    double slew_yaw(const Setpoint &sp, const Motion &m, bool on_ground, double dt);

    const Params &params_;
    bool fresh_ = true;
    Vec3 v_sp_, a_sp_, a_filtered_, integral_;
    Quat q_sp_;
    Vec3 w_sp_, w_filtered_, w_last_, dw_filtered_, rate_integral_;
    double yaw_sp_ = 0.0, yaw_rate_ff_ = 0.0, collective_ = 0.0;
    bool wants_up_ = false, wants_down_ = false;
    Saturation saturation_;
};

}  // namespace hil::flight
