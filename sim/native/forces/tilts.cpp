// Tilts of rotors: servos that turn the axes of rotors about hinges fixed to the body. Key `tilts` of a vehicle.
//
// Own states: the angle t of each tilt [rad], 0 where the rotors are as the vehicle's file has them, positive by the
// right-hand rule about its axis. Commands: -1..1 of each, linear from the least to the greatest angle; servos.hpp is the
// motion, with its limits and faults.
//
// Of a rotor with the place r_0 and the axis n_0 on a tilt with the axis a through the hinge c, in B, Q = exp(t [a]x):
//   r = c + Q (r_0 - c),   n = Q n_0,   and e1, e2 likewise                     (Rodrigues' formula)
//   dr/dt = t' a x (r - c),   dn/dt = t' a x n
// rotors.hpp has what follows: the flow at the hub, thrust, torque and drag along the moved axis, and the torque
// -s J O dn/dt of the spin that turns. Not in it: mass and inertia of what tilts (the centre of mass stays where it is, and
// a servo's acceleration makes no reaction), and the flapping of blades that a rate of turn brings.
//
// It stands in the list of forces after the rotors, and tells them their poses before any force is added.
//
// Limits of a step, besides those of servos.hpp and of the rotors:   |t'| h <= 0.1 rad
#include <cmath>

#include "detmath.hpp"
#include "force_binding.hpp"
#include "rotation.hpp"
#include "rotors.hpp"
#include "surfaced_force.hpp"

namespace hil::sim {

namespace {

constexpr double kTurnPerStep = 0.1;  // rad

// A rotor on a tilt.
struct Carried {
    Rotors *rotors;
    int rotor, tilt;
    double axis[3], hinge_m[3];  // a, c
    RotorPose neutral;           // at t = 0; place_m from the hinge
};

class Tilts : public SurfacedForce {
  public:
    Tilts(const std::vector<ServoParams> &servos, std::vector<Carried> carried)
        : SurfacedForce(servos), carried_(std::move(carried)) {
        for (Carried &c : carried_) {
            double hinge2 = 0.0, arm2 = 0.0;
            RotorPose start = c.rotors->let_tilt(c.rotor, 0.0);
            for (int j = 0; j < 3; ++j) {
                start.place_m[j] -= c.hinge_m[j];
                hinge2 += c.hinge_m[j] * c.hinge_m[j];
                arm2 += start.place_m[j] * start.place_m[j];
            }
            c.neutral = start;
            c.rotors->let_tilt(c.rotor, std::sqrt(hinge2) + std::sqrt(arm2));
        }
        for (double &angle : seen_rad_) angle = std::nan("");
    }

    void begin_tick(const double *own) override {
        SurfacedForce::begin_tick(own);
        servos_.at_instant(own);
        turn_all(1.0);
    }
    void at(int level, int node, double t_s) override {
        SurfacedForce::at(level, node, t_s);
        turn_all(1.0);
    }
    void at_contact(const double *own, bool hard) override {
        SurfacedForce::at_contact(own, hard);
        turn_all(1.0);
    }
    void at_instant(const double *own) override {
        SurfacedForce::at_instant(own);
        turn_all(1.0);
    }
    void pose(const double *own) override {
        servos_.at_instant(own);
        turn_all(0.0);
    }

    double longest_step(const double *s, const double *wind_W, double longest_s) const override {
        double step = SurfacedForce::longest_step(s, wind_W, longest_s);
        for (int i = 0; i < servos_.count(); ++i) {
            const double rate = std::fabs(servos_.rate(i));
            if (step * rate > kTurnPerStep) step = kTurnPerStep / rate;
        }
        return step;
    }

    void add(const Instant &, Wrench &) const override {}

  private:
    // `moving`: 1, or 0 for tilts at rest.
    void turn_all(double moving) {
        bool turned_any = false, changed[kMaxSurfaces];
        for (int i = 0; i < servos_.count(); ++i) {
            const double angle = servos_.angle()[i], rate = moving * servos_.rate(i);
            changed[i] = !(angle == seen_rad_[i] && rate == seen_radps_[i]);
            if (!changed[i]) continue;
            turned_any = true;
            seen_rad_[i] = angle;
            seen_radps_[i] = rate;
            cosine_[i] = det::cos(angle);
            sine_[i] = det::sin(angle);
        }
        if (!turned_any) return;
        for (const Carried &c : carried_) {
            if (!changed[c.tilt]) continue;
            const double *a = c.axis, rate = seen_radps_[c.tilt];
            RotorPose out;
            out.tilt_rate_radps = rate;
            turned(c, c.neutral.place_m, out.place_m);
            turned(c, c.neutral.axis, out.axis);
            for (int k = 0; k < 2; ++k) turned(c, c.neutral.plane[k], out.plane[k]);
            cross(a, out.place_m, out.place_rate_mps);
            cross(a, out.axis, out.axis_rate_per_s);
            for (int j = 0; j < 3; ++j) {
                out.place_m[j] += c.hinge_m[j];
                out.place_rate_mps[j] *= rate;
                out.axis_rate_per_s[j] *= rate;
            }
            c.rotors->turn(c.rotor, out);
        }
    }

    // Q v = v cos t + a x v sin t + a (a . v) (1 - cos t)
    void turned(const Carried &c, const double *v, double *out) const {
        const double *a = c.axis, cosine = cosine_[c.tilt], sine = sine_[c.tilt];
        double aside[3];
        cross(a, v, aside);
        const double along = ((a[0] * v[0] + a[1] * v[1]) + a[2] * v[2]) * (1.0 - cosine);
        for (int j = 0; j < 3; ++j) out[j] = (v[j] * cosine + aside[j] * sine) + a[j] * along;
    }

    std::vector<Carried> carried_;
    double cosine_[kMaxSurfaces] = {}, sine_[kMaxSurfaces] = {};
    double seen_rad_[kMaxSurfaces], seen_radps_[kMaxSurfaces];  // for which the rotors are posed; NaN: none yet
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Tilts, SurfacedForce>(m, "Tilts", "Tilts of rotors; see forces/tilts.cpp. Own states: their angles [rad].")
        .def(
            "__init__",
            [](Tilts *self, const std::vector<std::array<double, 4>> &servos, const std::vector<Rotors *> &rotors,
               const std::vector<int> &rotor, const std::vector<int> &tilt, const std::vector<::Vec3> &axis,
               const std::vector<::Vec3> &hinge_m) {
                const std::size_t n = rotors.size();
                if (servos.size() > kMaxSurfaces || rotor.size() != n || tilt.size() != n || axis.size() != n ||
                    hinge_m.size() != n) {
                    throw std::invalid_argument("up to 16 tilts; each rotor needs index, tilt, axis and hinge");
                }
                std::vector<ServoParams> params;
                for (const auto &s : servos) {
                    const double neutral = 0.5 * (s[0] + s[1]);
                    params.push_back({s[0] - neutral, s[1] - neutral, s[2], s[3], neutral});
                }
                std::vector<Carried> carried;
                for (std::size_t i = 0; i < n; ++i) {
                    if (rotors[i]->attached) throw std::invalid_argument("tilts are made before the body of their rotors");
                    if (rotor[i] < 0 || rotor[i] >= rotors[i]->commands() || tilt[i] < 0 ||
                        tilt[i] >= static_cast<int>(servos.size())) {
                        throw std::invalid_argument("a rotor or a tilt does not exist");
                    }
                    Carried c{rotors[i], rotor[i], tilt[i], {}, {}, {}};
                    for (int j = 0; j < 3; ++j) {
                        c.axis[j] = axis[i][j];
                        c.hinge_m[j] = hinge_m[i][j];
                    }
                    carried.push_back(c);
                }
                new (self) Tilts(params, std::move(carried));
            },
            nb::kw_only(), "servos"_a, "rotors"_a, "rotor"_a, "tilt"_a, "axis"_a, "hinge_m"_a,
            "servos: greatest and least angle [rad], rate [rad/s] (0: no limit), time constant [s]. Of each rotor that tilts: its force, "
            "which must be on the same body, its index there, its tilt, the tilt's axis and hinge. Make it before the body.");
}};

}  // namespace

}  // namespace hil::sim
