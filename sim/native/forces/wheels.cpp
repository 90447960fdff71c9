// Wheels on level ground: strut and tyre as a spring with damper, rolling resistance, side force, steering and brakes.
//
// Why a force and not MuJoCo's friction: a rolling wheel that holds sideways is neither a sphere that slides nor a hinge
// that costs states of another integrator. As a force it is integrated with the body at order 8 and takes part in free
// flight; MuJoCo's contact remains for hull, skids and belly. The ground is the plane z = ground_m.
//
// Per wheel, r from the centre of mass to the contact point: the lowest point of a disc of the wheel's radius about its
// axle, moved up to the ground; u = v + w x r its velocity in W; e_x the wheel's heading in the plane of the ground, e_y to
// the left of it:
//   d   = ground_m - z of the lowest point                                 compression
//   N   = max(0, k d + c ramp(d) d'),  d' = -u_z,  ramp = min(1, d / 1 mm) load; the ramp makes touch-down continuous
//   F   = f_x e_x + f_y e_y, |F| <= mu N (friction circle: the sum is shortened)
// with the deflections x, y of the contact patch, own states (Dahl's bristle; for a rolling tyre its relaxation length):
//   x'  = (u_x - |u_x| x / z_m) g,    f_x = -N (m_x x / z_m + h x'),   |f_x| <= m_x N,   m_x = min(mu, c_rr + b brake)
//   y'  = (u_y - a y) g,              f_y = -N (mu y / z_m + h y'),   a = |u_x| / s + |u_y| / z_m,  s = C z_m / mu
// so that at rest they are springs that hold without creeping, and in steady rolling
//   f_x = -c_rr N,   f_y = -mu N q / (1 + q),  q = C tan(slip angle) / mu       C N the cornering stiffness [N/rad]
// h = sqrt(mu / (z_m g0)) damps the springs at rest half critically. g = 1 / (1 + rate / 400 per second) bounds the rates
// of x and y (`rate`: |u_x| / z_m or a), which shortens no step of the integrator and changes no steady force. Off the
// ground x and y decay. A wheel has no inertia of its own; a locked one keeps its heading in f_x, f_y. A castering
// wheel has no side force: rolling resistance along both axes.
//
// References: Dahl, A Solid Friction Model, 1968; Pacejka, Tire and Vehicle Dynamics, 3rd ed., 7.1 (relaxation length);
// rolling distance from speed v without air: v^2 / (2 c_rr g).
//
// Commands: steering -1..1 if a wheel steers, brake 0..1 if one brakes. Own states: the steering servo's angle
// (servos.hpp), then x, y of each wheel, integrated with the body.
//
// Limits of a step h while a wheel touches: h <= 1 ms for the kinks of friction, h w <= 0.3, h c / m <= 2, with
// w = sqrt(k / m), m the effective mass there; a step ends where a wheel is about to touch. A touch-down at 10 m/s with
// brake and steering then ends within 1 mm of that with 62 us, after 12 m.

#include <cmath>
#include <stdexcept>
#include <string>

#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include "detmath.hpp"
#include "force_binding.hpp"
#include "rotation.hpp"
#include "servos.hpp"

namespace hil::sim {

namespace {

constexpr int kMaxWheels = 4;
constexpr double kGravity = 9.80665;     // of `h` alone
constexpr double kRamp_m = 1e-3;
constexpr double kFastest_per_s = 400.0; // of x and y
constexpr double kContact_per_s = 1000.0;  // steps on the ground
constexpr double kClear = 1.001;           // reaches from the ground: rotations are a rounding away from exact
constexpr double kOscillationPerStep = 0.3, kDampingPerStep = 2.0;
constexpr double kFlat2 = 0.01;          // of the axle's square above which the wheel lies on its side

struct Wheel {
    double position_m[3];
    double radius_m, stiffness_npm, damping_nspm;
    double friction, rolling, cornering_per_rad, slide_m;
    double steers;  // share of the steering angle
    double brakes;  // friction that the brake adds at command 1
    bool castering;
};

class Wheels : public Force {
  public:
    Wheels(const std::vector<Wheel> &wheels, const std::vector<ServoParams> &steering, double ground_m)
        : steering_(steering), count_(static_cast<int>(wheels.size())), ground_m_(ground_m) {
        for (int i = 0; i < count_; ++i) {
            w_[i] = wheels[static_cast<std::size_t>(i)];
            brakes_ = brakes_ || w_[i].brakes > 0.0;
            hold_[i] = std::sqrt(w_[i].friction / (w_[i].slide_m * kGravity));
            const double *r = w_[i].position_m;
            const double reach = std::sqrt((r[0] * r[0] + r[1] * r[1]) + r[2] * r[2]) + w_[i].radius_m;
            if (reach > reach_m_) reach_m_ = reach;
        }
    }

    int count() const { return count_; }
    double load(int i) const { return load_[i]; }
    void set_ground(double ground_m) { ground_m_ = ground_m; }

    int commands() const override { return steering_.count() + (brakes_ ? 1 : 0); }
    bool is_signed(int command) const override { return command < steering_.count(); }
    int states() const override { return steering_.count() + 2 * count_; }
    int integrals() const override { return 2 * count_; }

    void prepare(const StepTimes &times, const Inertia &inertia) override {
        steering_.prepare(times);
        contact_rate_ = kContact_per_s;
        for (int i = 0; i < count_; ++i) {
            const double *r = w_[i].position_m;
            const double r2 = (r[0] * r[0] + r[1] * r[1]) + r[2] * r[2];
            const double light = 1.0 / inertia.mass_kg + r2 / inertia.least_kgm2();  // 1 / effective mass
            const double swing = std::sqrt(w_[i].stiffness_npm * light) / kOscillationPerStep;
            const double damp = w_[i].damping_nspm * light / kDampingPerStep;
            if (swing > contact_rate_) contact_rate_ = swing;
            if (damp > contact_rate_) contact_rate_ = damp;
        }
        for (int hard = 0; hard < kContactKinds; ++hard) contact_s_[hard] = times.contact_s(hard);
    }

    int command(const double *control, double) override {
        const int bad = steering_.command(control);
        if (bad >= 0) return bad;
        if (!brakes_) return -1;
        const double u = control[steering_.count()];
        if (!std::isfinite(u)) return steering_.count();
        brake_ = u < 0.0 ? 0.0 : (u > 1.0 ? 1.0 : u);
        return -1;
    }

    void settle(double *own) const override {
        steering_.settle(own);
        for (int i = 0; i < 2 * count_; ++i) own[steering_.count() + i] = 0.0;
    }

    void begin_tick(const double *own) override {
        steering_.begin_tick(own);
        read(own);
    }
    void end_tick(double *own) override {
        steering_.end_tick(own);
        write(own);
    }
    void integrated(double *values) const override {
        for (int i = 0; i < 2 * count_; ++i) values[i] = patch_[i];
    }
    void set_integrated(const double *values) override {
        for (int i = 0; i < 2 * count_; ++i) patch_[i] = values[i];
    }
    void rates(double *values) const override {
        for (int i = 0; i < 2 * count_; ++i) values[i] = rate_[i];
    }

    double step_rate_per_s(bool classical) const override {
        const double servo = steering_.step_rate_per_s(classical);
        return classical && contact_rate_ > servo ? contact_rate_ : servo;
    }

    double longest_step(const double *s, const double *, double longest_s) const override {
        double step = steering_.longest_step(longest_s);
        const double *v = s + kV, *w = s + kW;
        const double turn = std::sqrt((w[0] * w[0] + w[1] * w[1]) + w[2] * w[2]) * reach_m_;
        const double sink = std::fabs(v[2]) + turn;  // upper bound of the speed of a wheel's lowest point
        if (s[kP + 2] - ground_m_ - reach_m_ > sink * step) return step;
        double R[9];
        rotation_matrix(s + kQ, R);
        for (int i = 0; i < count_; ++i) {
            const double gap = -compression(w_[i], R, s[kP + 2], 0.0, nullptr);
            if (gap <= 0.0) {
                if (step * contact_rate_ > 1.0) step = 1.0 / contact_rate_;
            } else if (gap < sink * step) {
                step = gap / sink;
            }
        }
        return step;
    }

    void at(int level, int node, double t_s) override { steering_.at(level, node, t_s); }
    void end_step(int level, double h_s) override { steering_.end_step(level, h_s); }

    void at_contact(const double *own, bool) override {
        steering_.at_contact(own);
        read(own);
    }
    void end_contact(double *own, bool hard) override {
        steering_.end_contact(own, hard);
        for (int i = 0; i < 2 * count_; ++i) {
            const double most = w_[i / 2].slide_m;
            const double moved = patch_[i] + contact_s_[hard] * rate_[i];
            patch_[i] = moved > most ? most : (moved < -most ? -most : moved);
        }
        write(own);
    }
    void at_instant(const double *own) override { at_contact(own, false); }

    void add(const Instant &now, Wrench &out) const override {
        const double *R = now.R, *v_W = now.s + kV, *w = now.s + kW;
        if (now.s[kP + 2] - ground_m_ > kClear * reach_m_) {  // no wheel can touch
            for (int i = 0; i < count_; ++i) load_[i] = 0.0;
            for (int i = 0; i < 2 * count_; ++i) rate_[i] = -kFastest_per_s * patch_[i];
            return;
        }
        double w_W[3];
        bool turned = false;
        for (int i = 0; i < count_; ++i) {
            const Wheel &p = w_[i];
            double r[3];  // in W
            const double angle = p.steers == 0.0 ? 0.0 : p.steers * steering_.angle()[0];
            const double d = compression(p, R, now.s[kP + 2], angle, r);
            load_[i] = 0.0;
            if (!(d > 0.0)) {
                rate_[2 * i] = -kFastest_per_s * patch_[2 * i];
                rate_[2 * i + 1] = -kFastest_per_s * patch_[2 * i + 1];
                continue;
            }
            if (!turned) {
                for (int j = 0; j < 3; ++j) w_W[j] = R[3 * j] * w[0] + R[3 * j + 1] * w[1] + R[3 * j + 2] * w[2];
                turned = true;
            }
            const double u[3] = {v_W[0] + (w_W[1] * r[2] - w_W[2] * r[1]), v_W[1] + (w_W[2] * r[0] - w_W[0] * r[2]),
                                 v_W[2] + (w_W[0] * r[1] - w_W[1] * r[0])};
            const double ramp = d < kRamp_m ? d / kRamp_m : 1.0;
            double N = p.stiffness_npm * d - p.damping_nspm * ramp * u[2];
            if (!(N > 0.0)) N = 0.0;
            load_[i] = N;

            const double c = angle == 0.0 ? 1.0 : det::cos(angle), s = angle == 0.0 ? 0.0 : det::sin(angle);
            double ex = R[0] * c + R[1] * s, ey = R[3] * c + R[4] * s;
            const double level = std::sqrt(ex * ex + ey * ey);
            if (level > 0.0) {
                ex /= level;
                ey /= level;
            } else {
                ex = 1.0;
                ey = 0.0;
            }
            const double ux = u[0] * ex + u[1] * ey, uy = u[1] * ex - u[0] * ey;
            const double mu = p.friction, z = p.slide_m, x = patch_[2 * i], y = patch_[2 * i + 1];
            double most_x = p.rolling + p.brakes * brake_;
            if (most_x > mu) most_x = mu;
            const double most_y = p.castering ? most_x : mu;
            const double ax = std::fabs(ux) / z;
            const double ay = p.castering ? std::fabs(uy) / z
                                          : std::fabs(ux) * mu / (p.cornering_per_rad * z) + std::fabs(uy) / z;
            rate_[2 * i] = (ux - ax * x) / (1.0 + ax / kFastest_per_s);
            rate_[2 * i + 1] = (uy - ay * y) / (1.0 + ay / kFastest_per_s);
            double fx = limited(most_x * x / z + hold_[i] * rate_[2 * i], most_x);
            double fy = limited(most_y * y / z + hold_[i] * rate_[2 * i + 1], most_y);
            const double all = std::sqrt(fx * fx + fy * fy);
            if (all > mu) {
                fx *= mu / all;
                fy *= mu / all;
            }
            const double F[3] = {-N * (fx * ex - fy * ey), -N * (fx * ey + fy * ex), N};
            const double M[3] = {r[1] * F[2] - r[2] * F[1], r[2] * F[0] - r[0] * F[2], r[0] * F[1] - r[1] * F[0]};
            for (int j = 0; j < 3; ++j) {
                out.force_B[j] += R[j] * F[0] + R[3 + j] * F[1] + R[6 + j] * F[2];
                out.torque_B[j] += R[j] * M[0] + R[3 + j] * M[1] + R[6 + j] * M[2];
            }
        }
    }

    double full_scale(int i) const override {
        return i < steering_.count() ? steering_.full_scale(i) : w_[(i - steering_.count()) / 2].slide_m;
    }
    void repair() override { steering_.repair(); }

  private:
    static double limited(double f, double most) { return f > most ? most : (f < -most ? -most : f); }

    void read(const double *own) {
        for (int i = 0; i < 2 * count_; ++i) patch_[i] = own[steering_.count() + i];
    }
    void write(double *own) const {
        for (int i = 0; i < 2 * count_; ++i) own[steering_.count() + i] = patch_[i];
    }

    // How far a wheel's lowest point is below the ground; `r` [3], if given, the contact point from the centre of mass in W.
    double compression(const Wheel &p, const double *R, double height_m, double angle, double *r) const {
        const double *b = p.position_m;
        const double s = angle == 0.0 ? 0.0 : det::sin(angle), c = angle == 0.0 ? 1.0 : det::cos(angle);
        double axle[3];  // direction of the axle, in W
        for (int j = 0; j < 3; ++j) axle[j] = -R[3 * j] * s + R[3 * j + 1] * c;
        const double upright2 = 1.0 - axle[2] * axle[2];
        double down[3] = {0.0, 0.0, -1.0};
        if (upright2 > kFlat2) {
            const double scale = 1.0 / std::sqrt(upright2);
            down[0] = axle[2] * axle[0] * scale;
            down[1] = axle[2] * axle[1] * scale;
            down[2] = (axle[2] * axle[2] - 1.0) * scale;
        }
        const double z = (R[6] * b[0] + R[7] * b[1] + R[8] * b[2]) + p.radius_m * down[2];
        if (r) {
            for (int j = 0; j < 2; ++j) r[j] = (R[3 * j] * b[0] + R[3 * j + 1] * b[1] + R[3 * j + 2] * b[2]) + p.radius_m * down[j];
            r[2] = ground_m_ - height_m;
        }
        return ground_m_ - (height_m + z);
    }

    Servos steering_;
    int count_;
    double ground_m_;
    bool brakes_ = false;
    Wheel w_[kMaxWheels] = {};
    double hold_[kMaxWheels] = {};  // h of the equations
    double reach_m_ = 0.0, contact_rate_ = 0.0, contact_s_[kContactKinds] = {}, brake_ = 0.0;
    double patch_[2 * kMaxWheels] = {};
    mutable double rate_[2 * kMaxWheels] = {}, load_[kMaxWheels] = {};
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Wheels, Force>(m, "Wheels", "Wheels on level ground; see forces/wheels.cpp.")
        .def(
            "__init__",
            [](Wheels *self, const std::vector<std::array<double, 12>> &wheels, const std::vector<bool> &castering,
               const std::vector<std::array<double, 4>> &steering, double ground_m) {
                if (wheels.empty() || wheels.size() > kMaxWheels || castering.size() != wheels.size() || steering.size() > 1) {
                    throw std::invalid_argument("1 to 4 wheels, with castering for each, and at most one steering servo");
                }
                std::vector<Wheel> all;
                for (std::size_t i = 0; i < wheels.size(); ++i) {
                    const auto &a = wheels[i];
                    all.push_back({{a[0], a[1], a[2]}, a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], castering[i]});
                }
                std::vector<ServoParams> servos;
                for (const auto &s : steering) servos.push_back({s[0], s[1], s[2], s[3]});
                new (self) Wheels(all, servos, ground_m);
            },
            nb::kw_only(), "wheels"_a, "castering"_a, "steering"_a, "ground_m"_a,
            "wheels: position [m] x, y, z in B, radius [m], stiffness [N/m], damping [N s/m], friction, rolling resistance, "
            "cornering stiffness over load [1/rad], deflection at which the patch slides [m], share of the steering angle, "
            "friction of the brake at command 1. steering: deflection at command 1 and -1 [rad], rate [rad/s] (0: no limit), "
            "time constant [s].")
        .def("set_ground", &Wheels::set_ground, "ground_m"_a, "Set the height of the ground, z in W [m].")
        .def_prop_ro("loads_n", [](const Wheels &self) {
            std::vector<double> loads;
            for (int i = 0; i < self.count(); ++i) loads.push_back(self.load(i));
            return loads;
        }, "Load of each wheel when the force was last computed [N]; 0: it does not touch.");
}};

}  // namespace

}  // namespace hil::sim
