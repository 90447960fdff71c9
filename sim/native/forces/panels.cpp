#include "panels.hpp"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <tuple>

#include <nanobind/stl/tuple.h>

#include "force_binding.hpp"
#include "lifting_lines.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kHalfDensity = 0.5 * 1.225;  // kg/m3
constexpr double kGroundReachSpans = 4.0;     // height of the end of the ground effect
constexpr double kTurnPerStep = 0.05;           // rad of the flow at a panel
constexpr double kTurnByRates = 0.04;           // the same by the rates at the start of a step
constexpr double kSpeedUp_mps2 = 20.0, kCalm2 = 0.09, kEndless = 1e300;
constexpr double kSlipstream_mps = 30.0;  // that the bound of the damping allows for, for the classical method
constexpr double kDampingPerStep = 2.0;
constexpr double kFast_mps = 3.0;         // speed of a panel at which its turn counts in full

void set(PanelLanes::Lane (&lanes)[3], int at, const double *value) {
    for (int j = 0; j < 3; ++j) lanes[j][at] = value[j];
}

// A lane without a panel.
void clear(PanelLanes &l, int at) {
    l.x[0][at] = l.y[1][at] = l.z[2][at] = 1.0;
    l.stall_width8[at] = l.shift_cosine[at] = 1.0;
}

}  // namespace

Panels::Panels(const std::vector<PanelParams> &panels, const std::vector<ServoParams> &surfaces, double ground_span_m)
    : SurfacedForce(surfaces), kernel_(panel_kernel()) {
    PanelLanes &l = lanes_;
    for (int at = 0; at < kPanelLanes; ++at) clear(l, at);
    int lifting = 0, plates = 0;
    for (const PanelParams &p : panels) (p.wing >= 0 ? lifting : plates) += 1;
    l.lifting = (lifting + 3) / 4 * 4;
    l.lanes = l.lifting + (plates + 3) / 4 * 4;
    if (l.lifting > kLiftingLanes || l.lanes > kPanelLanes) {
        throw std::invalid_argument("up to 40 panels of wings, and 24 of bodies; these are " + std::to_string(lifting) +
                                    " and " + std::to_string(plates));
    }
    lifting = plates = 0;
    std::vector<LiftingLine> lines;
    for (const PanelParams &p : panels) {
        const int at = p.wing >= 0 ? lifting++ : l.lifting + plates++;
        lane_.push_back(at);
        for (const PanelFlap &flap : p.flaps) flaps_.push_back({at, flap.surface, flap.angle, flap.moment});
        double y[3], z[3], x[3], middle[3], seen[3];
        double width2 = 0.0;
        for (int j = 0; j < 3; ++j) {
            y[j] = p.left_m[j] - p.right_m[j];
            width2 += y[j] * y[j];
            middle[j] = p.quarter_m[j] - p.ahead_m[j];
            seen[j] = p.wing >= 0 ? p.quarter_m[j] - 2.0 * p.ahead_m[j] : middle[j];
        }
        const double width = std::sqrt(width2);
        if (!(width > 0.0)) throw std::invalid_argument("a panel has no width");
        for (int j = 0; j < 3; ++j) y[j] /= width;
        cross(p.ahead_m, y, z);
        const double size = std::sqrt(dot(z, z));
        if (!(size > 0.0)) throw std::invalid_argument("a panel has no area");
        for (int j = 0; j < 3; ++j) z[j] /= size;
        cross(y, z, x);
        const double chord = 4.0 * dot(p.ahead_m, x);
        set(l.x, at, x);
        set(l.y, at, y);
        set(l.z, at, z);
        set(l.middle, at, middle);
        set(l.seen, at, seen);
        l.area[at] = width * chord;
        l.chord[at] = chord;
        l.drag[at] = p.drag;
        l.plate[at] = p.plate;
        if (p.wing < 0) continue;
        set(l.ahead, at, p.ahead_m);
        l.slope[at] = p.lift_slope_per_rad;
        l.zero_lift[at] = p.zero_lift_rad;
        l.stall_middle[at] = p.stall_middle;
        const double h2 = p.stall_half_width * p.stall_half_width, h4 = h2 * h2;
        l.stall_width8[at] = h4 * h4;
        l.drag_of_lift[at] = p.drag_of_lift;
        l.moment[at] = p.moment;
        LiftingLine line{};
        for (int j = 0; j < 3; ++j) {
            line.left_m[j] = p.left_m[j];
            line.right_m[j] = p.right_m[j];
            line.quarter_m[j] = p.quarter_m[j];
            line.seen_m[j] = seen[j];
            line.normal[j] = z[j];
        }
        line.chord_m = chord;
        line.slope_per_rad = p.lift_slope_per_rad;
        line.wing = p.wing;
        line.sheet = p.sheet;
        lines.push_back(line);
    }
    std::vector<double> w, tilting;
    influence(lines, w, tilting);
    const std::size_t n = lines.size();
    for (std::size_t i = 0; i < n; ++i) {
        double own = 0.0;
        for (std::size_t j = 0; j < n; ++j) {
            l.influence[j][i] = w[i * n + j];
            l.tilting[j][i] = tilting[i * n + j];
            if (lines[i].wing == lines[j].wing) own += w[i * n + j];
        }
        l.reduced[i] = 1.0 - own;
    }
    l.ground_per_m = ground_span_m > 0.0 ? 16.0 / ground_span_m : 0.0;
    ground_reach_m_ = kGroundReachSpans * ground_span_m;
    l.ground_fade_per_m2 = ground_span_m > 0.0 ? 1.0 / (ground_reach_m_ * ground_reach_m_) : 0.0;
    double reach2 = 0.0;
    for (int at : lane_) {
        const double r[3] = {l.middle[0][at], l.middle[1][at], l.middle[2][at]};
        if (dot(r, r) > reach2) reach2 = dot(r, r);
    }
    reach_m_ = std::sqrt(reach2);
    ground_reach_m_ += reach_m_;
}

void Panels::prepare(const StepTimes &times, const Inertia &inertia) {
    SurfacedForce::prepare(times, inertia);
    damping_per_m_ = 0.0;
    classical_ = times.classical;
    const double least = inertia.least_kgm2();
    for (int at : lane_) {
        const double r[3] = {lanes_.middle[0][at], lanes_.middle[1][at], lanes_.middle[2][at]};
        const double slope = lanes_.slope[at] + 2.0 * lanes_.plate[at] + lanes_.drag[at];
        arm_m_[at] = std::sqrt(dot(r, r));
        per_m_[at] = kHalfDensity * lanes_.area[at] * slope * (1.0 / inertia.mass_kg + dot(r, r) / least);
        damping_per_m_ += per_m_[at];
    }
}

double Panels::damping_per_s(double airspeed_mps) const {
    return classical_ ? damping_per_m_ * (airspeed_mps + kSlipstream_mps) : 0.0;
}

double Panels::longest_step(const double *s, const double *wind_W, double longest_s) const {
    const double step = SurfacedForce::longest_step(s, wind_W, longest_s);
    double R[9], air[3];
    rotation_matrix(s + kQ, R);
    air_velocity(R, s, wind_W, air);
    const double *w = s + kW;
    const double turn = std::sqrt(dot(w, w)), ahead = std::fabs(air[0]) - turn * reach_m_;
    const double room = kTurnPerStep - turn * step;
    if (ahead > 0.0 && room * ahead > kSpeedUp_mps2 * step) return step;  // every panel is fast enough
    double least2 = kEndless;
    for (int at : lane_) {
        const double r[3] = {lanes_.seen[0][at], lanes_.seen[1][at], lanes_.seen[2][at]};
        double u[3];
        point_velocity(air, w, r, u);
        const double along = (u[0] * lanes_.x[0][at] + u[1] * lanes_.x[1][at]) + u[2] * lanes_.x[2][at];
        const double through = (u[0] * lanes_.z[0][at] + u[1] * lanes_.z[1][at]) + u[2] * lanes_.z[2][at];
        const double speed2 = along * along + through * through;
        if (speed2 < least2) least2 = speed2;
    }
    const double limit = kTurnPerStep / (turn + kSpeedUp_mps2 / std::sqrt(least2 + kCalm2));
    return limit < step ? limit : step;
}

// How much longer a step may be for a panel in slow air, whose force is as V^2 and whose error, of order 9 in the turn.
double slower(double speed_mps) {
    const double slow = kFast_mps / speed_mps;
    return std::sqrt(std::sqrt(std::sqrt(1.0 + slow * slow)));
}

double Panels::longest_step_by_rates(const double *s, const double *ds, double longest_s) const {
    const PanelLanes &l = lanes_;
    const double turn = std::sqrt(dot(s + kW, s + kW));
    const double speed_up = std::sqrt(dot(ds + kV, ds + kV)) + 0.5 * wash_rate_mps2_;
    const double spin_up = std::sqrt(dot(ds + kW, ds + kW));
    double damping_per_s = 0.0;
    for (int at : lane_) {
        const double along = l.along[at], through = l.through[at];
        const double speed = std::sqrt(along * along + through * through + kCalm2);
        const double rate = turn + ((speed_up + std::fabs(l.stirred[at])) + spin_up * arm_m_[at]) / speed;
        if (longest_s * rate > kTurnByRates) {
            const double limit = kTurnByRates * slower(speed) / rate;
            if (limit < longest_s) longest_s = limit;
        }
        damping_per_s += per_m_[at] * speed;
    }
    if (longest_s * damping_per_s > kDampingPerStep) longest_s = kDampingPerStep / damping_per_s;
    return longest_s;
}

void Panels::deflect(const double *angle, bool healthy) const {
    bool moved = false;
    for (int i = 0; i < servos_.count(); ++i) {
        const double d = healthy ? angle[i] : servos_.effect(i) * angle[i];
        moved = moved || d != seen_rad_[i];
        seen_rad_[i] = d;
    }
    if (!moved) return;
    lanes_.bent = true;
    for (const Flap &flap : flaps_) lanes_.bend[flap.lane] = lanes_.flap_moment[flap.lane] = 0.0;
    for (const Flap &flap : flaps_) {
        const double d = seen_rad_[flap.surface];
        lanes_.bend[flap.lane] += flap.angle * d;
        lanes_.flap_moment[flap.lane] += flap.moment * d;
    }
}

void Panels::add(const Instant &now, Wrench &out) const {
    PanelLanes &l = lanes_;
    deflect(servos_.angle(), false);
    for (int j = 0; j < 3; ++j) {
        l.air_B[j] = now.air_B[j];
        l.w[j] = now.s[kW + j];
        l.up_B[j] = now.R[6 + j];
    }
    l.height_m = now.s[kP + 2];
    l.near_ground = l.ground_per_m > 0.0 && l.height_m < ground_reach_m_;
    l.half_density = kHalfDensity * now.density_ratio;
    l.slipstreams = now.slipstreams;
    wash_rate_mps2_ = 0.0;
    if (now.slipstreams) {
        for (int i = 0; i < now.slipstreams->count; ++i) {
            const double rate = now.slipstreams->of[i].rate_mps2;
            if (rate > wash_rate_mps2_) wash_rate_mps2_ = rate;
        }
    }
    kernel_.loads(l);
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] += l.all_force[j];
        out.torque_B[j] += l.all_torque[j];
    }
}

void Panels::wrench_of(const double air_B[3], const double w[3], const double *deflection_rad, double density_ratio,
                       Wrench &out) const {
    PanelLanes &l = lanes_;
    deflect(deflection_rad, true);
    for (int j = 0; j < 3; ++j) {
        l.air_B[j] = air_B[j];
        l.w[j] = w[j];
        l.up_B[j] = j == 2 ? 1.0 : 0.0;
    }
    l.near_ground = false;
    l.half_density = kHalfDensity * density_ratio;
    l.slipstreams = nullptr;
    kernel_.loads(l);
    for (int j = 0; j < 3; ++j) {
        out.force_B[j] += l.all_force[j];
        out.torque_B[j] += l.all_torque[j];
    }
}

namespace {

void copy(const ::Vec3 &from, double (&to)[3]) {
    for (int j = 0; j < 3; ++j) to[j] = from[j];
}

nb::tuple of_lanes(const Panels &self, const PanelLanes::Lane &values) {
    nb::list out;
    for (int k = 0; k < self.count(); ++k) out.append(values[self.lane(k)]);
    return nb::tuple(out);
}

nb::tuple of_lanes(const Panels &self, const PanelLanes::Lane (&values)[3]) {
    nb::list out;
    for (int k = 0; k < self.count(); ++k) {
        const int at = self.lane(k);
        out.append(nb::make_tuple(values[0][at], values[1][at], values[2][at]));
    }
    return nb::tuple(out);
}

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<PanelParams>(m, "Panel", "One panel; see PanelParams in forces/panels.hpp.")
        .def(
            "__init__",
            [](PanelParams *self, const ::Vec3 &left_m, const ::Vec3 &right_m, const ::Vec3 &quarter_m,
               const ::Vec3 &ahead_m, int wing, int sheet,
               double lift_slope_per_rad, double zero_lift_rad, double stall_middle, double stall_half_width, double drag,
               double drag_of_lift, double moment, double plate,
               const std::vector<std::tuple<int, double, double>> &flaps) {
                if (wing >= 0 && (!(lift_slope_per_rad > 0.0) || !(stall_half_width > 0.0))) {
                    throw std::invalid_argument("a section needs a lift slope and a width of its stall above 0");
                }
                PanelParams p{};
                copy(left_m, p.left_m);
                copy(right_m, p.right_m);
                copy(quarter_m, p.quarter_m);
                copy(ahead_m, p.ahead_m);
                p.wing = wing;
                p.sheet = sheet < 0 ? wing : sheet;
                p.lift_slope_per_rad = lift_slope_per_rad;
                p.zero_lift_rad = zero_lift_rad;
                p.stall_middle = stall_middle;
                p.stall_half_width = stall_half_width;
                p.drag = drag;
                p.drag_of_lift = drag_of_lift;
                p.moment = moment;
                p.plate = plate;
                for (const auto &[surface, angle, change] : flaps) p.flaps.push_back({surface, angle, change});
                new (self) PanelParams(p);
            },
            nb::kw_only(), "left_m"_a, "right_m"_a, "quarter_m"_a, "ahead_m"_a, "wing"_a, "sheet"_a = -1, "lift_slope_per_rad"_a = 0.0,
            "zero_lift_rad"_a = 0.0, "stall_middle"_a = 0.0, "stall_half_width"_a = 1.0, "drag"_a = 0.0,
            "drag_of_lift"_a = 0.0, "moment"_a = 0.0, "plate"_a = 0.0,
            "flaps"_a = std::vector<std::tuple<int, double, double>>{},
            "flaps: index of a surface, and its effect on the angle of zero lift and on C_m, per radian.");

    nb::class_<Panels, SurfacedForce>(m, "Panels", "Wings, tails and bodies by panels; see forces/panels.hpp.")
        .def(
            "__init__",
            [](Panels *self, const std::vector<PanelParams> &panels,
               const std::vector<std::array<double, 4>> &surfaces, double ground_span_m) {
                for (const PanelParams &p : panels) {
                    for (const PanelFlap &flap : p.flaps) {
                        if (flap.surface < 0 || flap.surface >= static_cast<int>(surfaces.size())) {
                            throw std::invalid_argument("a panel's surface does not exist");
                        }
                    }
                }
                std::vector<ServoParams> servos;
                for (const auto &s : surfaces) servos.push_back({s[0], s[1], s[2], s[3]});
                new (self) Panels(panels, servos, ground_span_m);
            },
            nb::kw_only(), "panels"_a, "surfaces"_a, "ground_span_m"_a,
            "surfaces: deflection at command 1 and -1 [rad], rate [rad/s] (0: no limit), time constant [s]. ground_span_m: "
            "greatest span of a wing, for the ground effect; 0 without it.")
        .def_prop_ro("count", &Panels::count)
        .def(
            "wrench",
            [](const Panels &self, const ::Vec3 &air_B_mps, const ::Vec3 &w_radps,
               const std::vector<double> &deflection_rad, double density_ratio) {
                if (static_cast<int>(deflection_rad.size()) != self.commands()) {
                    throw std::invalid_argument("one deflection per surface is needed");
                }
                Wrench out{};
                self.wrench_of(air_B_mps.data(), w_radps.data(), deflection_rad.data(), density_ratio, out);
                return nb::make_tuple(nb::make_tuple(out.force_B[0], out.force_B[1], out.force_B[2]),
                                      nb::make_tuple(out.torque_B[0], out.torque_B[1], out.torque_B[2]));
            },
            "air_B_mps"_a, "w_radps"_a, "deflection_rad"_a, "density_ratio"_a = 1.0,
            "Return force [N] and torque about the centre of mass [N m] in B, away from the ground, without slipstreams. "
            "air_B_mps: velocity through the air.")
        .def_prop_ro("area_m2", [](const Panels &self) { return of_lanes(self, self.lanes().area); })
        .def_prop_ro("normal", [](const Panels &self) { return of_lanes(self, self.lanes().z); })
        .def_prop_ro("middle_m", [](const Panels &self) { return of_lanes(self, self.lanes().middle); })
        .def_prop_ro("force_n", [](const Panels &self) { return of_lanes(self, self.lanes().force); },
                     "Force of each panel where the forces were computed last.")
        .def_prop_ro("induced_mps", [](const Panels &self) { return of_lanes(self, self.lanes().induced); },
                     "Velocity w through each panel, there.")
        .def_prop_ro("along_mps", [](const Panels &self) { return of_lanes(self, self.lanes().along); },
                     "Velocity u_x of each panel with slipstreams, there.")
        .def_prop_ro(
            "influence",
            [](const Panels &self) {
                nb::list rows;
                const PanelLanes &l = self.lanes();
                for (int i = 0; i < self.count(); ++i) {
                    nb::list row;
                    if (self.lane(i) >= l.lifting) continue;
                    for (int j = 0; j < self.count(); ++j) {
                        if (self.lane(j) < l.lifting) row.append(l.influence[self.lane(j)][self.lane(i)]);
                    }
                    rows.append(row);
                }
                return rows;
            },
            "W of the lifting panels, row by row.");
}};

}  // namespace

}  // namespace hil::sim
