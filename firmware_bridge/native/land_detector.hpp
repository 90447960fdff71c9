// Land detector with two phases, as PX4's multicopter land detector:
//
//   contact   a descent is commanded but does not happen for LNDMC_TRIG_TIME: the collective is then lowered to zero
//             within kLetDown seconds; a vehicle that is still in the air starts to fall, which ends the contact
//   landed    after contact, without thrust and neither moving nor turning, for another LNDMC_TRIG_TIME
//
// Leaves `landed` when a climb is commanded, at 0.1 m above the ground or rising at 0.2 m/s with most of the hover thrust
// on. At start, and whenever disarmed, the vehicle counts as landed, as in PX4. Integer time in, no clock.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "params.hpp"
#include "rotation.hpp"

namespace hil::flight {

class LandDetector {
   public:
    explicit LandDetector(const Params &params) : params_(params) {}

    bool landed() const { return landed_; }
    bool contact() const { return contact_; }
    // 1 in flight, falling to 0 while in contact with the ground.
    double thrust_scale() const { return scale_; }

    // Disarmed: on the ground by definition.
    void disarmed() {
        landed_ = true;
        contact_ = false;
        scale_ = 1.0;
        time_ = 0.0;
    }

    void step(bool wants_up, bool wants_down, double v_down_setpoint, Vec3 v_N, double p_down, Vec3 w_F, double collective,
              double dt) {
        constexpr double kDegree = det::kPi / 180.0;
        if (landed_) {
            const bool lifting = wants_up && collective > 0.6 * params_[MPC_THR_HOVER];
            if (!lifting) ground_p_down_ = p_down;
            const bool rising = v_N.z < -0.2 || p_down < ground_p_down_ - 0.1;
            time_ = lifting && rising ? time_ + dt : 0.0;
            if (time_ > 0.05) {
                landed_ = false;
                leave();
            }
            return;
        }
        const double speed = std::sqrt(v_N.x * v_N.x + v_N.y * v_N.y);
        const bool slow = std::fabs(v_N.z) < params_[LNDMC_Z_VEL_MAX] && speed < params_[LNDMC_XY_VEL_MAX];
        if (!contact_) {
            // In the air a vehicle reaches 40 % of a commanded descent speed within 0.2 s; else it is on the ground.
            const bool stopped = wants_down && slow && v_N.z < 0.4 * std::max(v_down_setpoint, 0.15);
            time_ = stopped ? time_ + dt : 0.0;
            if (time_ > params_[LNDMC_TRIG_TIME]) {
                contact_ = true;
                time_ = 0.0;
            }
            return;
        }
        if (!wants_down || v_N.z > std::max(0.4, params_[LNDMC_Z_VEL_MAX]) || speed > params_[LNDMC_XY_VEL_MAX]) {
            leave();
            return;
        }
        scale_ = std::max(0.0, scale_ - dt / kLetDown);
        const bool at_rest = scale_ <= 0.0 && slow && norm(w_F) < params_[LNDMC_ROT_MAX] * kDegree;
        time_ = at_rest ? time_ + dt : 0.0;
        if (time_ > params_[LNDMC_TRIG_TIME]) {
            landed_ = true;
            contact_ = false;
            scale_ = 1.0;
            time_ = 0.0;
            ground_p_down_ = p_down;
        }
    }

   private:
    static constexpr double kLetDown = 0.5;

    void leave() {
        contact_ = false;
        scale_ = 1.0;
        time_ = 0.0;
    }

    const Params &params_;
    bool landed_ = true, contact_ = false;
    double scale_ = 1.0, time_ = 0.0, ground_p_down_ = 0.0;
};

}  // namespace hil::flight
