#include "free_flight.hpp"

#include <cmath>

#include "dormand_prince.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kTurnPerStep = 0.1;   // rad
constexpr double kWayPerStep = 0.25;  // m
constexpr double kDampingPerStep = 2.0, kDampingPerClassicalStep = 1.0;

double length(const double *v) { return std::sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]); }

void wind_at(const TickWind &wind, double t, double *out) {
    for (int j = 0; j < 3; ++j) out[j] = wind.start_W[j] + t * wind.slope_W[j];
}

// Sets s to `next` with q normalised; returns the distance moved.
double finish_step(int width, double *s, double *next, double *path) {
    const double dx = next[0] - s[0], dy = next[1] - s[1], dz = next[2] - s[2];
    for (int k = 0; k < width; ++k) s[k] = next[k];
    normalise_quaternion(s + kQ);
    for (int k = 0; k < 7; ++k) path[k] = s[k];
    return std::sqrt(dx * dx + dy * dy + dz * dz);
}

void set_integrated(const Body &body, const double *s) {
    const double *values = s + kPoseVelocity;
    for (Force *force : body.forces) {
        force->set_integrated(values);
        values += force->integrals();
    }
}

// d/dt of (p, q, v, w) and of the integrated values at a node of a step that begins `t` after the tick.
template <int kWidth>
void derivative_at(const Body &body, const TickWind &wind, int level, int node, double t, double reach, const double *s,
                   double *ds) {
    for (Force *force : body.forces) force->at(level, node, reach);
    if constexpr (kWidth > kPoseVelocity) set_integrated(body, s);
    double moved[3];
    const double *wind_now = wind.start_W;
    if (wind.changes) {
        wind_at(wind, t + reach, moved);
        wind_now = moved;
    }
    derivative(body, s, wind_now, ds);
    if constexpr (kWidth > kPoseVelocity) {
        double *rates = ds + kPoseVelocity;
        for (const Force *force : body.forces) {
            force->rates(rates);
            rates += force->integrals();
        }
    }
}

template <int kWidth>
double classical_step(const Body &body, const TickWind &wind, int level, double t, double h, const double *, double *s,
                      double *path) {
    double k1[kWidth] = {}, k2[kWidth] = {}, k3[kWidth] = {}, k4[kWidth] = {}, mid[kWidth];
    const double reach = 0.5 * h;
    derivative_at<kWidth>(body, wind, level, 0, t, 0.0, s, k1);
    for (int k = 0; k < kWidth; ++k) mid[k] = s[k] + reach * k1[k];
    derivative_at<kWidth>(body, wind, level, 1, t, reach, mid, k2);
    for (int k = 0; k < kWidth; ++k) mid[k] = s[k] + reach * k2[k];
    derivative_at<kWidth>(body, wind, level, 1, t, reach, mid, k3);
    for (int k = 0; k < kWidth; ++k) mid[k] = s[k] + h * k3[k];
    derivative_at<kWidth>(body, wind, level, 2, t, h, mid, k4);
    const double sixth = h / 6.0;
    for (int k = 0; k < kWidth; ++k) mid[k] = s[k] + sixth * ((k1[k] + k4[k]) + 2.0 * (k2[k] + k3[k]));
    return finish_step(kWidth, s, mid, path);
}

// `first`: derivatives at the start if they are known, else null.
template <int kWidth>
double order8_step(const Body &body, const TickWind &wind, int level, double t, double h, const double *first, double *s,
                   double *path) {
    double k[dp8::kStages][kWidth] = {}, y[kWidth];
    if (first) {
        for (int j = 0; j < kWidth; ++j) k[0][j] = first[j];
    }
    for (int stage = first ? 1 : 0; stage < dp8::kStages; ++stage) {
        for (int j = 0; j < kWidth; ++j) {
            double sum = 0.0;
            for (int earlier = 0; earlier < stage; ++earlier) sum += dp8::kA[stage][earlier] * k[earlier][j];
            y[j] = s[j] + h * sum;
        }
        derivative_at<kWidth>(body, wind, level, stage, t, dp8::kC[stage] * h, y, k[stage]);
    }
    for (int j = 0; j < kWidth; ++j) {
        double sum = 0.0;
        for (int stage = 0; stage < dp8::kStages; ++stage) sum += dp8::kB[stage] * k[stage][j];
        y[j] = s[j] + h * sum;
    }
    return finish_step(kWidth, s, y, path);
}

using Step = double (*)(const Body &, const TickWind &, int, double, double, const double *, double *, double *);
using Start = void (*)(const Body &, const TickWind &, int, int, double, double, const double *, double *);

// Widths are compiled in, for the speed of the sums over stages; the values beyond those of the body stay 0.
Step step_of(const Body &body, bool classical) {
    constexpr int kBare = kPoseVelocity, kOne = kPoseVelocity + 1, kMost = kPoseVelocity + kMostIntegrals;
    constexpr int kFew = kPoseVelocity + 9;  // of four rotors with motors
    constexpr int kOneSet = kPoseVelocity + 17;  // of eight rotors with motors
    if (classical) return body.integrals > 0 ? &classical_step<kMost> : &classical_step<kBare>;
    if (body.integrals > 17) return &order8_step<kMost>;
    if (body.integrals > 9) return &order8_step<kOneSet>;
    if (body.integrals > 1) return &order8_step<kFew>;
    return body.integrals > 0 ? &order8_step<kOne> : &order8_step<kBare>;
}

// What computes the derivatives at the start of a step, for bodies that choose steps by them.
Start start_of(const Body &body) {
    constexpr int kMost = kPoseVelocity + kMostIntegrals;
    return body.integrals > 0 ? &derivative_at<kMost> : &derivative_at<kPoseVelocity>;
}

// Number of times to halve the steps.
int level_for(const Body &body, const StepTimes &times, const TickWind &wind, const double *s) {
    double air2 = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double through = s[kV + j] - wind.start_W[j];
        air2 += through * through;
    }
    const double airspeed = std::sqrt(air2);
    double lambda = 0.0, rate = 0.0;
    for (const Force *force : body.forces) {
        lambda += force->damping_per_s(airspeed);
        const double own = force->step_rate_per_s(times.classical);
        if (own > rate) rate = own;
    }
    const double damping = lambda / (times.classical ? kDampingPerClassicalStep : kDampingPerStep);
    if (damping > rate) rate = damping;
    if (!times.classical) {
        const double turn = length(s + kW) / kTurnPerStep;
        const double way = length(s + kV) / kWayPerStep;
        if (turn > rate) rate = turn;
        if (way > rate) rate = way;
    }
    const double wanted = rate * times.tick_s;
    int level = 0;
    while (level < kLevels - 1 && wanted > static_cast<double>(times.base << level)) ++level;
    return level;
}

}  // namespace

double free_flight_tick(const Body &body, const StepTimes &times, const TickWind &wind, double *state, double *path,
                        int &steps) {
    for (std::size_t k = 0; k < body.forces.size(); ++k) body.forces[k]->begin_tick(state + body.first_state[k]);
    double s[kPoseVelocity + kMostIntegrals] = {}, rates[kPoseVelocity + kMostIntegrals] = {};
    for (int k = 0; k < kPoseVelocity; ++k) s[k] = state[k];
    double *values = s + kPoseVelocity;
    for (const Force *force : body.forces) {
        force->integrated(values);
        values += force->integrals();
    }
    const Step step = step_of(body, times.classical);

    const int level = level_for(body, times, wind, s);
    const int shortest = times.base << (kLevels - 1);  // the unit of `done`: steps begin at multiples of their length
    double travelled = 0.0;
    steps = 0;
    for (int done = 0; done < shortest; ++steps) {
        const double t = done * (times.tick_s / shortest);
        int fine = level;
        const double *first = nullptr;
        if (!times.classical) {
            double limit = times.step_s(level), wind_now[3];
            wind_at(wind, t, wind_now);
            for (const Force *force : body.forces) limit = force->longest_step(s, wind_now, limit);
            if (body.has_slipstreams) {
                start_of(body)(body, wind, level, 0, t, 0.0, s, rates);
                first = rates;
                for (const Force *force : body.forces) limit = force->longest_step_by_rates(s, rates, limit);
            }
            while (fine < kLevels - 1 && times.step_s(fine) > limit) ++fine;
        }
        while (done % (1 << (kLevels - 1 - fine)) != 0) ++fine;
        const double h = times.step_s(fine);
        double *reached = path + 7 * steps;
        travelled += step(body, wind, fine, t, h, first, s, reached);
        for (Force *force : body.forces) force->end_step(fine, h);
        if (body.integrals > 0) set_integrated(body, s);
        done += 1 << (kLevels - 1 - fine);
    }
    for (int k = 0; k < kPoseVelocity; ++k) state[k] = s[k];
    for (std::size_t k = 0; k < body.forces.size(); ++k) body.forces[k]->end_tick(state + body.first_state[k]);
    return travelled;
}

}  // namespace hil::sim
