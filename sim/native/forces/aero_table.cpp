// Aerodynamics of a whole aircraft by one set of stability derivatives, as they are published for small unmanned aircraft.
//
// After Beard and McLain, Small Unmanned Aircraft: Theory and Practice, 2012, ch. 4 (eq. 4.6 to 4.21). Axes F are those of
// the source: x ahead, y right, z down. a = (u, v, w) is the velocity through the air in F, (p, q, r) the body rates in F,
// d_k the deflection of control k. With V = |a|, U^2 = u^2 + w^2, alpha = atan2(w, u), beta = atan2(v, U), S the area, c the
// chord, b the span:
//   lift        L = rho S / 2 (A V^2 C_L + A V c/2 C_Lq q + E sum C_Ld d_k),   C_L = C_L0 + C_La alpha
//   drag        D = rho S / 2 A (V^2 (C_D0 + C_Da alpha + C_Da2 alpha^2 + k C_L^2 + C_Db beta + C_Db2 beta^2
//                                     + sum C_Dd d_k + C_Dd2 d_k^2) + V c/2 C_Dq q)
//   side        Y = rho S / 2 (A V^2 (C_Y0 + C_Yb beta) + A V b/2 (C_Yp p + C_Yr r) + E sum C_Yd d_k)
//   roll        l = rho S b / 2 (A V^2 (C_l0 + C_lb beta) + V b/2 (C_lp p + A C_lr r) + E sum C_ld d_k)
//   pitch       m = rho S c / 2 (A V^2 (C_m0 + C_ma alpha) + V c/2 C_mq q + E sum C_md d_k)
//   yaw         n = rho S b / 2 (A V^2 (C_n0 + C_nb beta) + V b/2 (A C_np p + C_nr r) + E sum C_nd d_k)
//   force       X = -D cos alpha + L sin alpha,  Y,  Z = -D sin alpha - L cos alpha
// The published drag is one of two: a polynomial in alpha, or C_Dp + C_L^2 / (pi e b^2 / S), which is k. A surface i moves
// the controls: d_k = sum s_ik d_i; a lost surface has no part in it.
//
// Attached flow. Beard and McLain blend lift with sigma(alpha), their eq. 4.10; here A = 1 - sigma fades everything that
// attached flow makes, in alpha and in the same form in beta:
//   A = a(alpha, alpha_0, M) a(beta, beta_0, M),   a(x, x_0, M) = 1 / ((1 + e^(M (x - x_0))) (1 + e^(-M (x + x_0))))
// A is 1 to e^(-M x_0) near the design point, where the equations are as printed, and 0 beyond: flying backwards or
// sideways, where alpha and beta jump, nothing depends on them.
//
// Separated flow, sigma = 1 - A: a flat plate in alpha (their eq. 4.9), the linear derivatives of a sideslip with sin beta
// in the place of beta, and skin friction along the flow. m_s is the plate's pitching moment, N its normal coefficient 2:
//   X = -rho S / 2 sigma C_D0 V u
//   Y = -rho S / 2 sigma (C_D0 - C_Yb) V v
//   Z = -rho S / 2 sigma (C_D0 V w + N w |w|)
//   m = rho S c / 2 sigma m_s w |w|,   n = rho S b / 2 sigma C_nb V v
// |w| is sqrt(w^2 + (0.05 V)^2), which is smooth where w changes its sign. Of the effect of the controls a share remains
// that turns with the direction of the flow: E = A V^2 + sigma s V u. The dampings C_lp, C_mq and C_nr act everywhere.
//
// The whole sphere of alpha and beta is defined, and zero airspeed: every term is V^2 or V times a rate, times a bounded
// function of the direction. In still air the force and its derivative are 0.
//
// `reference_m` is the point for which the moments hold, from the centre of mass: its force has that lever. The flow is that
// at the centre of mass, as in the source.
//
// Limits of a step h: those of the surfaces (servos.hpp), and w h <= 0.4 d (not the classical method): w is the fastest turn
// of the flow in B, the rates across it + g / sqrt(V^2 + V_1^2) + rho S N_max V / (2 m), d the distance of alpha and beta from
// the nearest singularity of A and |w| as functions of complex angles: +-x_0 +- i pi / M, and +-i 0.05 at alpha = 180 degrees.
// V_1 = 0.5 m/s, because the slower the flow, the less its direction matters: the forces are quadratic in V. At V_1 they are
// below 1 % of the weight of an aircraft whose stall speed is above 5 m/s, and gravity leaves V_1 behind in 50 ms.

#include <cmath>

#include "detmath.hpp"
#include "force_binding.hpp"
#include "rotation.hpp"
#include "surfaced_force.hpp"

namespace hil::sim {

namespace {

constexpr double kDensity = 1.225;  // at a density ratio of 1
constexpr double kSmooth = 0.05;
constexpr double kPolePerStep = 0.4;
constexpr double kSlow_mps = 0.5;  // V_1
constexpr int kMaxControls = 8;

struct Control {
    double lift, drag, drag2, side, roll, pitch, yaw;
};

struct AeroTableParams {
    double area_m2, chord_m, span_m;
    double lift0, lift_alpha, lift_q;
    double drag0, drag_alpha, drag_alpha2, drag_lift2, drag_q, drag_beta, drag_beta2;
    double pitch0, pitch_alpha, pitch_q;
    double side0, side_beta, side_p, side_r;
    double roll0, roll_beta, roll_p, roll_r;
    double yaw0, yaw_beta, yaw_p, yaw_r;
    double alpha_0, beta_0, sharpness;  // of A
    double normal, plate_pitch, surface_share;  // in separated flow
    double reference_m[3];                      // in B
    int controls;
    Control control[kMaxControls];
};

class AeroTable : public SurfacedForce {
  public:
    // `share` [surfaces][controls].
    AeroTable(const AeroTableParams &params, const std::vector<ServoParams> &surfaces, const std::vector<double> &share)
        : SurfacedForce(surfaces), p_(params) {
        for (int i = 0; i < servos_.count(); ++i) {
            for (int k = 0; k < p_.controls; ++k) share_[i][k] = share[static_cast<std::size_t>(i * p_.controls + k)];
        }
        edge_alpha_ = det::exp(-p_.sharpness * p_.alpha_0);
        edge_beta_ = det::exp(-p_.sharpness * p_.beta_0);
        for (int j = 0; j < 3; ++j) lever_ = lever_ || p_.reference_m[j] != 0.0;
    }

    void prepare(const StepTimes &times, const Inertia &inertia) override {
        SurfacedForce::prepare(times, inertia);
        const double S = kDensity * p_.area_m2, m = inertia.mass_kg, least = inertia.least_kgm2();
        const double peak = std::fabs(p_.lift0) + std::fabs(p_.lift_alpha) * p_.alpha_0;
        turn_per_m_ = 0.5 * S * ((peak > p_.normal ? peak : p_.normal) + p_.drag0) / m;
        const double chord2 = p_.chord_m * p_.chord_m, span2 = p_.span_m * p_.span_m;
        double most = std::fabs(p_.roll_p) + std::fabs(p_.roll_r);
        const double yaw = std::fabs(p_.yaw_p) + std::fabs(p_.yaw_r);
        if (yaw > most) most = yaw;
        most *= span2;
        const double pitch = std::fabs(p_.pitch_q) * chord2;
        if (pitch > most) most = pitch;
        damping_per_m_ = 0.25 * S * most / least + 0.5 * S * (std::fabs(p_.lift_alpha) + 2.0 * p_.normal) / m;
    }

    double damping_per_s(double airspeed_mps) const override { return damping_per_m_ * airspeed_mps; }

    double longest_step(const double *s, const double *wind_W, double longest_s) const override {
        double step = longest_s;
        const double *w = s + kW;
        double air2 = 0.0;
        for (int j = 0; j < 3; ++j) air2 += (s[kV + j] - wind_W[j]) * (s[kV + j] - wind_W[j]);
        const double V = std::sqrt(air2);
        const double bent = kGravity / std::sqrt(air2 + kSlow_mps * kSlow_mps) + turn_per_m_ * V;
        double turn = std::sqrt((w[0] * w[0] + w[1] * w[1]) + w[2] * w[2]) + bent;
        const double pole = det::kPi / p_.sharpness;
        const double least = pole < kSmooth ? pole : kSmooth;
        if (!(turn * step > kPolePerStep * least)) return step;  // wherever the singularities are
        double R[9], air[3];
        rotation_matrix(s + kQ, R);
        air_velocity(R, s, wind_W, air);
        if (V > 0.0) turn = turn_across(w, air, V) + bent;
        const double across = std::sqrt(air[0] * air[0] + air[2] * air[2]);
        const double alpha = std::fabs(det::atan2(air[2], air[0])), beta = std::fabs(det::atan2(air[1], across));
        const double a = alpha - p_.alpha_0, b = beta - p_.beta_0, back = det::kPi - alpha;
        double distance2 = a * a + pole * pole;
        const double sideways2 = b * b + pole * pole, plate2 = back * back + kSmooth * kSmooth;
        if (sideways2 < distance2) distance2 = sideways2;
        if (plate2 < distance2) distance2 = plate2;
        const double distance = std::sqrt(distance2);
        if (turn * step > kPolePerStep * distance) step = kPolePerStep * distance / turn;
        return step;
    }

    void add(const Instant &now, Wrench &out) const override {
        const double u = now.air_B[0], v = -now.air_B[1], w = -now.air_B[2];
        const double p = now.s[kW], q = -now.s[kW + 1], r = -now.s[kW + 2];
        const double U2 = u * u + w * w, V2 = U2 + v * v;
        if (!(V2 > 0.0)) return;
        const double U = std::sqrt(U2), V = std::sqrt(V2);
        const double alpha = det::atan2(w, u), beta = det::atan2(v, U);
        const double cos_alpha = U > 0.0 ? u / U : 1.0, sin_alpha = U > 0.0 ? w / U : 0.0;
        const double A = attached(alpha, edge_alpha_) * attached(beta, edge_beta_), sigma = 1.0 - A;
        const double AV2 = A * V2, AV = A * V, E = AV2 + sigma * p_.surface_share * (V * u);
        const double half_c = 0.5 * p_.chord_m, half_b = 0.5 * p_.span_m;

        Control sum{};
        const double *angle = servos_.angle();
        for (int k = 0; k < p_.controls; ++k) {
            double d = 0.0;
            for (int i = 0; i < servos_.count(); ++i) d += share_[i][k] * servos_.effect(i) * angle[i];
            const Control &c = p_.control[k];
            sum.lift += c.lift * d;
            sum.drag += (c.drag + c.drag2 * d) * d;
            sum.side += c.side * d;
            sum.roll += c.roll * d;
            sum.pitch += c.pitch * d;
            sum.yaw += c.yaw * d;
        }

        const double c_lift = p_.lift0 + p_.lift_alpha * alpha;
        const double c_drag = (p_.drag0 + alpha * (p_.drag_alpha + p_.drag_alpha2 * alpha)) + p_.drag_lift2 * (c_lift * c_lift) +
                              beta * (p_.drag_beta + p_.drag_beta2 * beta) + sum.drag;
        const double lift = AV2 * c_lift + AV * (half_c * p_.lift_q * q) + E * sum.lift;
        const double drag = AV2 * c_drag + AV * (half_c * p_.drag_q * q);
        double X = lift * sin_alpha - drag * cos_alpha;
        double Z = -lift * cos_alpha - drag * sin_alpha;
        double Y = AV2 * (p_.side0 + p_.side_beta * beta) + AV * (half_b * (p_.side_p * p + p_.side_r * r)) + E * sum.side;
        double roll = AV2 * (p_.roll0 + p_.roll_beta * beta) + half_b * (V * (p_.roll_p * p) + AV * (p_.roll_r * r)) + E * sum.roll;
        double pitch = AV2 * (p_.pitch0 + p_.pitch_alpha * alpha) + V * (half_c * p_.pitch_q * q) + E * sum.pitch;
        double yaw = AV2 * (p_.yaw0 + p_.yaw_beta * beta) + half_b * (AV * (p_.yaw_p * p) + V * (p_.yaw_r * r)) + E * sum.yaw;

        const double plate = w * std::sqrt(w * w + (kSmooth * kSmooth) * V2);
        X -= sigma * (p_.drag0 * (V * u));
        Y -= sigma * ((p_.drag0 - p_.side_beta) * (V * v));
        Z -= sigma * (p_.drag0 * (V * w) + p_.normal * plate);
        pitch += sigma * (p_.plate_pitch * plate);
        yaw += sigma * (p_.yaw_beta * (V * v));

        const double half = 0.5 * kDensity * now.density_ratio * p_.area_m2;
        const double f[3] = {half * X, -half * Y, -half * Z};
        double m[3] = {half * p_.span_m * roll, -half * p_.chord_m * pitch, -half * p_.span_m * yaw};
        if (lever_) {
            const double *x = p_.reference_m;
            m[0] += x[1] * f[2] - x[2] * f[1];
            m[1] += x[2] * f[0] - x[0] * f[2];
            m[2] += x[0] * f[1] - x[1] * f[0];
        }
        for (int j = 0; j < 3; ++j) {
            out.force_B[j] += f[j];
            out.torque_B[j] += m[j];
        }
    }

  private:
    static constexpr double kGravity = 9.81;

    // a(x), `edge` = e^(-M x_0).
    double attached(double x, double edge) const {
        const double e = det::exp(p_.sharpness * x);
        return 1.0 / ((1.0 + e * edge) * (1.0 + edge / e));
    }

    AeroTableParams p_;
    double share_[kMaxSurfaces][kMaxControls] = {};
    double edge_alpha_, edge_beta_;
    double turn_per_m_ = 0.0, damping_per_m_ = 0.0;
    bool lever_ = false;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<AeroTable, SurfacedForce>(m, "AeroTable", "Aircraft by stability derivatives; see forces/aero_table.cpp.")
        .def(
            "__init__",
            [](AeroTable *self, double area_m2, double chord_m, double span_m, const std::vector<double> &lift,
               const std::vector<double> &drag, const std::vector<double> &pitch, const std::vector<double> &side,
               const std::vector<double> &roll, const std::vector<double> &yaw,
               const std::vector<std::array<double, 7>> &controls, const std::vector<std::array<double, 4>> &surfaces,
               const std::vector<double> &share, ::Vec3 attached, ::Vec3 separated, ::Vec3 reference_m) {
                if (lift.size() != 3 || drag.size() != 7 || pitch.size() != 3 || side.size() != 4 || roll.size() != 4 ||
                    yaw.size() != 4) {
                    throw std::invalid_argument("lift, drag, pitch, side, roll, yaw need 3, 7, 3, 4, 4, 4 derivatives");
                }
                if (controls.size() > kMaxControls || surfaces.size() > kMaxSurfaces ||
                    share.size() != controls.size() * surfaces.size()) {
                    throw std::invalid_argument("at most 8 controls and 16 surfaces, with a share for each pair");
                }
                AeroTableParams p{area_m2,  chord_m,  span_m,   lift[0],  lift[1], lift[2], drag[0], drag[1],
                                  drag[2],  drag[3],  drag[4],  drag[5],  drag[6], pitch[0], pitch[1], pitch[2],
                                  side[0],  side[1],  side[2],  side[3],  roll[0], roll[1], roll[2], roll[3],
                                  yaw[0],   yaw[1],   yaw[2],   yaw[3],   attached[0], attached[1], attached[2],
                                  separated[0], separated[1], separated[2],
                                  {reference_m[0], reference_m[1], reference_m[2]},
                                  static_cast<int>(controls.size()), {}};
                for (std::size_t k = 0; k < controls.size(); ++k) {
                    const auto &c = controls[k];
                    p.control[k] = {c[0], c[1], c[2], c[3], c[4], c[5], c[6]};
                }
                std::vector<ServoParams> servos;
                for (const auto &s : surfaces) servos.push_back({s[0], s[1], s[2], s[3]});
                new (self) AeroTable(p, servos, share);
            },
            nb::kw_only(), "area_m2"_a, "chord_m"_a, "span_m"_a, "lift"_a, "drag"_a, "pitch"_a, "side"_a, "roll"_a,
            "yaw"_a, "controls"_a, "surfaces"_a, "share"_a, "attached"_a, "separated"_a, "reference_m"_a,
            "lift, pitch: at zero, by alpha, by q. drag: at zero, by alpha, alpha^2, lift^2, q, beta, beta^2. side, roll, yaw: "
            "at zero, by beta, p, r. controls: lift, drag, drag by the square, side, roll, pitch, yaw of each. surfaces: "
            "deflection at command 1 and -1 [rad], rate [rad/s] (0: no limit), time constant [s]. share: of each control in "
            "each surface, surface by surface. attached: alpha_0, beta_0 [rad], M. separated: normal, pitch, share of the "
            "controls.");
}};

}  // namespace

}  // namespace hil::sim
