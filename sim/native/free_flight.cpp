#include "free_flight.hpp"

#include <cmath>

#include "detmath.hpp"
#include "dormand_prince.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

static_assert(kStages8 == dp8::kStages);

constexpr double kTurnPerStep = 0.1;   // rad
constexpr double kWayPerStep = 0.06;   // m
constexpr double kDampingPerStep = 2.0, kDampingPerClassicalStep = 1.0;
constexpr double kLagsPerStep = 2.0;   // motor time constants
constexpr double kWhirlPerStep = 1.0;  // rad of an unbalanced rotor
constexpr double kPolePerStep = 0.4;   // distances to the nearest pole of a rotor's thrust

double largest(const double *v) {
    double most = v[0];
    if (v[1] > most) most = v[1];
    if (v[2] > most) most = v[2];
    return most;
}

double length(const double *v) { return std::sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]); }

// Rotors over a tick. With a constant command each speed is monotone, so the choice of tau_up or tau_down is made once.
struct Rotors {
    int count;
    bool whirling;
    bool up[kMaxRotors];
    double command[kMaxRotors];
    double lag[kMaxRotors];    // at the start of the step
    double rate[kMaxRotors];   // -1 / tau
    double phase[kMaxRotors];  // at the start of the step

    double decay(int i, RotorDecay d) const { return up[i] ? d.up : d.down; }

    // Writes the rotors at `t` after the start of the step to `out`; `d` is the decay over t.
    void at(const RigidBodyParams &params, double t, RotorDecay d, RotorStage &out) const {
        for (int i = 0; i < count; ++i) {
            const double lag_now = lag[i] * decay(i, d);
            out.speed[i] = command[i] + lag_now;
            out.accel[i] = rate[i] * lag_now;
            if (whirling) push(params, i, t, lag_now, out);
        }
    }

    void push(const RigidBodyParams &params, int i, double t, double lag_now, RotorStage &out) const {
        const double b = params.imbalance_kgm[i];
        out.push_x[i] = out.push_y[i] = 0.0;
        if (!(b > 0.0)) return;
        const double pull = b * (out.speed[i] * out.speed[i]);
        const double angle = phase_at(params, i, t, lag_now);
        out.push_x[i] = pull * det::cos(angle);
        out.push_y[i] = pull * det::sin(angle);
    }

    // phi + s int O dt,  int O dt = c t + tau (l(0) - l(t))
    double phase_at(const RigidBodyParams &params, int i, double t, double lag_now) const {
        return phase[i] + params.rotor_spin[i] * (command[i] * t - (lag[i] - lag_now) / rate[i]);
    }

    void advance(const RigidBodyParams &params, double h, RotorDecay d) {
        for (int i = 0; i < count; ++i) {
            const double lag_now = lag[i] * decay(i, d);
            if (whirling) {
                const double angle = phase_at(params, i, h, lag_now);
                phase[i] = angle - 2.0 * det::kPi * std::floor(angle / (2.0 * det::kPi));
            }
            lag[i] = lag_now;
        }
    }
};

void wind_at(const TickWind &wind, double t, double *out) {
    for (int j = 0; j < 3; ++j) out[j] = wind.start_W[j] + t * wind.slope_W[j];
}

// Sets s to `next` with q normalised; returns the distance moved.
double finish_step(double *s, double *next, double *path) {
    const double dx = next[0] - s[0], dy = next[1] - s[1], dz = next[2] - s[2];
    for (int k = 0; k < kPoseVelocity; ++k) s[k] = next[k];
    normalise_quaternion(s + kQ);
    for (int k = 0; k < 7; ++k) path[k] = s[k];
    return std::sqrt(dx * dx + dy * dy + dz * dz);
}

double classical_step(const RigidBodyParams &params, double t, double h, RotorDecay half, const TickWind &wind,
                      Rotors &rotors, double *s, double *path) {
    RotorStage r0, r1, r2;
    const RotorDecay whole{half.up * half.up, half.down * half.down};
    rotors.at(params, 0.0, {1.0, 1.0}, r0);
    rotors.at(params, 0.5 * h, half, r1);
    rotors.at(params, h, whole, r2);
    double w0[3], w1[3], w2[3];
    const double *a0 = wind.start_W, *a1 = wind.start_W, *a2 = wind.start_W;
    if (wind.changes) {
        wind_at(wind, t, w0);
        wind_at(wind, t + 0.5 * h, w1);
        wind_at(wind, t + h, w2);
        a0 = w0;
        a1 = w1;
        a2 = w2;
    }
    double k1[kPoseVelocity], k2[kPoseVelocity], k3[kPoseVelocity], k4[kPoseVelocity], mid[kPoseVelocity];
    const double reach = 0.5 * h;
    derivative(params, s, r0, a0, k1);
    for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + reach * k1[k];
    derivative(params, mid, r1, a1, k2);
    for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + reach * k2[k];
    derivative(params, mid, r1, a1, k3);
    for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + h * k3[k];
    derivative(params, mid, r2, a2, k4);
    const double sixth = h / 6.0;
    for (int k = 0; k < kPoseVelocity; ++k) mid[k] = s[k] + sixth * ((k1[k] + k4[k]) + 2.0 * (k2[k] + k3[k]));
    rotors.advance(params, h, whole);
    return finish_step(s, mid, path);
}

double order8_step(const RigidBodyParams &params, double t, double h, const RotorDecay *node, const TickWind &wind,
                   Rotors &rotors, double *s, double *path) {
    double k[dp8::kStages][kPoseVelocity], y[kPoseVelocity];
    for (int stage = 0; stage < dp8::kStages; ++stage) {
        for (int j = 0; j < kPoseVelocity; ++j) {
            double sum = 0.0;
            for (int earlier = 0; earlier < stage; ++earlier) sum += dp8::kA[stage][earlier] * k[earlier][j];
            y[j] = s[j] + h * sum;
        }
        const double reach = dp8::kC[stage] * h;
        RotorStage now;
        rotors.at(params, reach, node[stage], now);
        double moved[3];
        const double *wind_now = wind.start_W;
        if (wind.changes) {
            wind_at(wind, t + reach, moved);
            wind_now = moved;
        }
        derivative(params, y, now, wind_now, k[stage]);
    }
    for (int j = 0; j < kPoseVelocity; ++j) {
        double sum = 0.0;
        for (int stage = 0; stage < dp8::kStages; ++stage) sum += dp8::kB[stage] * k[stage][j];
        y[j] = s[j] + h * sum;
    }
    rotors.advance(params, h, node[dp8::kStages]);
    return finish_step(s, y, path);
}

// Turns a velocity from B to the axes e1, e2, n of rotor i.
void into_rotor_axes(const RigidBodyParams &params, int i, double *v) {
    const double *rows[3] = {params.rotor_plane[i][0], params.rotor_plane[i][1], params.rotor_axis[i]};
    const double b[3] = {v[0], v[1], v[2]};
    for (int j = 0; j < 3; ++j) v[j] = (rows[j][0] * b[0] + rows[j][1] * b[1]) + rows[j][2] * b[2];
}

// Longest step that the poles of the rotors' thrust allow (free_flight.hpp), `longest` if none is near. The poles lie in
// the complex plane of the rotor's speed at radius a / (x0 sqrt(kappa)), 45 degrees off the axes, for the descent into
// the own wake, and at +-i V / sqrt(kappa) for the speed V across the rotor. Both are at least O / sqrt(2) away.
double step_by_poles(const RigidBodyParams &params, const TickWind &wind, const Rotors &rotors, double t,
                     double longest, const double *s) {
    bool far = true;
    for (int i = 0; i < rotors.count; ++i) {
        const double change = std::fabs(rotors.rate[i] * rotors.lag[i]) * longest;
        if (change * 1.5 > kPolePerStep * (rotors.command[i] + rotors.lag[i])) far = false;
    }
    if (far) return longest;
    double R[9], wind_W[3], air[3];
    rotation_matrix(s + kQ, R);
    wind_at(wind, t, wind_W);
    air_velocity(R, s, wind_W, air);
    double step = longest;
    for (int i = 0; i < rotors.count; ++i) {
        double hub[3];
        hub_velocity(air, s + kW, params.rotor_position_m[i], hub);
        if (!params.upright) into_rotor_axes(params, i, hub);
        const double speed = rotors.command[i] + rotors.lag[i];
        const double rate = std::fabs(rotors.rate[i] * rotors.lag[i]);
        const double ring = hub[2] < 0.0 ? -hub[2] / kVortexRingCentre : 0.0;
        const double across2 = (hub[0] * hub[0] + hub[1] * hub[1]) / params.air.kappa_m2;
        const double aside = ring * std::sqrt(0.5 / params.air.kappa_m2);
        const double along = speed - aside;
        const double ring2 = along * along + aside * aside, across = speed * speed + across2;
        const double distance = std::sqrt(ring2 < across ? ring2 : across);
        if (step * rate > kPolePerStep * distance) step = kPolePerStep * distance / rate;
    }
    return step;
}

// Number of times to halve the steps; `fastest` is the greatest speed of an unbalanced rotor.
int level_for(const RigidBodyParams &params, const TickPlan &plan, const TickWind &wind, double fastest,
              const double *s) {
    double air2 = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double through = s[kV + j] - wind.start_W[j];
        air2 += through * through;
    }
    const double lambda = plan.static_rate_per_s +
                          2.0 * largest(params.body_drag_quadratic_n_per_m2ps2) * std::sqrt(air2) / params.mass_kg;
    const double turn = length(s + kW) / kTurnPerStep;
    const double way = length(s + kV) / kWayPerStep;
    const double whirl = fastest / kWhirlPerStep;
    double rate = lambda / (plan.classical ? kDampingPerClassicalStep : kDampingPerStep);
    if (!plan.classical && plan.lag_rate_per_s > rate) rate = plan.lag_rate_per_s;
    if (!plan.classical && turn > rate) rate = turn;
    if (!plan.classical && way > rate) rate = way;
    if (whirl > rate) rate = whirl;
    const double wanted = rate * plan.tick_s;
    int level = 0;
    while (level < kLevels - 1 && wanted > static_cast<double>(plan.base << level)) ++level;
    return level;
}

}  // namespace

TickPlan make_tick_plan(const RigidBodyParams &params, double tick_s, int base, bool classical) {
    TickPlan plan{};
    plan.tick_s = tick_s;
    plan.base = base;
    plan.classical = classical;
    for (int level = 0; level < kLevels; ++level) {
        const double h = tick_s / (base << level);
        plan.half[level] = rotor_decay(params, 0.5 * h);
        for (int stage = 0; stage < kStages8; ++stage) {
            plan.node[level][stage] = rotor_decay(params, dp8::kC[stage] * h);
        }
        plan.node[level][kStages8] = rotor_decay(params, h);
    }
    const double *I = params.inertia_kgm2;
    double least = I[0] < I[1] ? I[0] : I[1];
    if (I[2] < least) least = I[2];
    double reach2 = 0.0;
    for (int i = 0; i < params.rotor_count; ++i) {
        const double *r = params.rotor_position_m[i];
        reach2 += r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
    }
    const double tau =
        params.time_constant_up_s < params.time_constant_down_s ? params.time_constant_up_s : params.time_constant_down_s;
    plan.lag_rate_per_s = 1.0 / (kLagsPerStep * tau);
    const double n = params.rotor_count;
    const double drag = params.rotor_drag_kg_per_rad + params.air.axial_kg_per_rad;
    plan.static_rate_per_s = largest(params.body_drag_linear_n_per_mps) / params.mass_kg +
                             drag * params.max_speed_radps * (n / params.mass_kg + reach2 / least) +
                             n * params.rotor_inertia_kgm2 * params.max_speed_radps / least;
    return plan;
}

double free_flight_tick(const RigidBodyParams &params, const TickPlan &plan, const TickWind &wind,
                        const double *command, double *state, double *phase, double *path, int &steps) {
    const int n = params.rotor_count;
    double *rotor = state + kPoseVelocity;
    Rotors rotors;
    rotors.count = n;
    rotors.whirling = params.imbalanced;
    double fastest = 0.0;
    for (int i = 0; i < n; ++i) {
        rotors.command[i] = command[i];
        rotors.lag[i] = rotor[i] - command[i];
        rotors.up[i] = rotors.lag[i] < 0.0;
        rotors.rate[i] = -1.0 / (rotors.up[i] ? params.time_constant_up_s : params.time_constant_down_s);
        rotors.phase[i] = phase[i];
        if (params.imbalanced && params.imbalance_kgm[i] > 0.0) {
            const double most = rotors.up[i] ? command[i] : rotor[i];
            if (most > fastest) fastest = most;
        }
    }
    double s[kPoseVelocity];
    for (int k = 0; k < kPoseVelocity; ++k) s[k] = state[k];

    const int level = level_for(params, plan, wind, fastest, s);
    const bool poles = !plan.classical && params.air.kappa_m2 > 0.0 &&
                       (params.air.descent_loss > 0.0 || params.air.ground_floor > 0.0);
    const int shortest = plan.base << (kLevels - 1);  // the unit of `done`: steps begin at multiples of their length
    double travelled = 0.0;
    steps = 0;
    for (int done = 0; done < shortest; ++steps) {
        const double t = done * (plan.tick_s / shortest);
        int fine = level;
        if (poles) {
            const double limit = step_by_poles(params, wind, rotors, t, plan.tick_s / (plan.base << level), s);
            while (fine < kLevels - 1 && plan.tick_s / (plan.base << fine) > limit) ++fine;
        }
        while (done % (1 << (kLevels - 1 - fine)) != 0) ++fine;
        const double h = plan.tick_s / (plan.base << fine);
        double *reached = path + 7 * steps;
        travelled += plan.classical ? classical_step(params, t, h, plan.half[fine], wind, rotors, s, reached)
                                    : order8_step(params, t, h, plan.node[fine], wind, rotors, s, reached);
        done += 1 << (kLevels - 1 - fine);
    }
    for (int k = 0; k < kPoseVelocity; ++k) state[k] = s[k];
    for (int i = 0; i < n; ++i) {
        rotor[i] = command[i] + rotors.lag[i];
        phase[i] = rotors.phase[i];
    }
    return travelled;
}

}  // namespace hil::sim
