#include "placed_vehicle.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace hil::sim {

namespace {

constexpr std::size_t kFixedNumbers = 13;  // of a state, beside its time and those of the rotors
constexpr Vec3 kOutside{1e8, 0.0, 0.0};  // beyond the geometry's world

double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

Quat about_z(double angle_rad) { return {det::cos(0.5 * angle_rad), 0.0, 0.0, det::sin(0.5 * angle_rad)}; }

Quat turned_by(Vec3 rotation_rad) {
    const double angle = norm(rotation_rad);
    // sin(angle / 2) / angle; below 1e-4 rad the series has a relative error of 1e-10
    const double ratio = angle > 1e-4 ? det::sin(0.5 * angle) / angle : 0.5 - angle * angle / 48.0;
    const Vec3 u = ratio * rotation_rad;
    return {det::cos(0.5 * angle), u.x, u.y, u.z};
}

void write(double *to, Vec3 v) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }
void write(double *to, Quat q) { to[0] = q.w, to[1] = q.x, to[2] = q.y, to[3] = q.z; }

}  // namespace

PlacedVehicle::PlacedVehicle(std::vector<RotorMount> rotors, double radius_m)
    : rotors_(std::move(rotors)), radius_m_(radius_m) {}

void PlacedVehicle::place(PlacedState state) {
    if (state.speed_radps.size() != rotors_.size()) {
        throw std::invalid_argument("a state must have the speed of each rotor of the vehicle");
    }
    if (!states_.empty() && state.t_ns <= states_.back().t_ns) states_.clear();
    state.angle_rad.assign(rotors_.size(), 0.0);
    if (!states_.empty()) {
        const PlacedState &last = states_.back();
        const double half_s = 0.5 * seconds(state.t_ns - last.t_ns);
        for (std::size_t i = 0; i < rotors_.size(); ++i) {
            const double sum_radps = last.speed_radps[i] + state.speed_radps[i];
            state.angle_rad[i] = wrap_pi(last.angle_rad[i] + half_s * rotors_[i].spin * sum_radps);
        }
    }
    while (states_.size() > 1 && states_[1].t_ns <= state.t_ns - kHistoryNs) states_.pop_front();
    states_.push_back(std::move(state));
}

std::vector<std::uint8_t> PlacedVehicle::states_since(std::int64_t t_ns) const {
    std::vector<std::uint8_t> data;
    const PlacedState *first = at(t_ns);
    const auto add = [&data](const void *from, std::size_t size) {
        const auto *bytes = static_cast<const std::uint8_t *>(from);
        data.insert(data.end(), bytes, bytes + size);
    };
    for (const PlacedState &state : states_) {
        if (state.t_ns < first->t_ns) continue;
        add(&state.t_ns, sizeof state.t_ns);
        double fixed[kFixedNumbers];
        write(fixed, state.p_WB);
        write(fixed + 3, state.q_WB);
        write(fixed + 7, state.v_WB_W);
        write(fixed + 10, state.w_WB_B);
        add(fixed, sizeof fixed);
        add(state.speed_radps.data(), rotors_.size() * sizeof(double));
        add(state.angle_rad.data(), rotors_.size() * sizeof(double));
    }
    return data;
}

void PlacedVehicle::restore(const std::uint8_t *data, std::size_t size) {
    const std::size_t rotors = rotors_.size();
    const std::size_t row = sizeof(std::int64_t) + (kFixedNumbers + 2 * rotors) * sizeof(double);
    if (size % row != 0) throw std::invalid_argument("the states are not those of a vehicle with as many rotors");
    states_.clear();
    std::vector<double> n(kFixedNumbers + 2 * rotors);
    for (const std::uint8_t *from = data; from != data + size; from += row) {
        std::int64_t t_ns;
        std::memcpy(&t_ns, from, sizeof t_ns);
        std::memcpy(n.data(), from + sizeof t_ns, row - sizeof t_ns);
        const auto speeds = n.begin() + kFixedNumbers, angles = speeds + static_cast<std::ptrdiff_t>(rotors);
        states_.push_back({t_ns, {n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}, {n[7], n[8], n[9]}, {n[10], n[11], n[12]},
                           {speeds, angles}, {angles, n.end()}});
    }
}

const PlacedState *PlacedVehicle::at(std::int64_t t_ns) const {
    if (states_.empty()) return nullptr;
    const auto later = std::upper_bound(states_.begin(), states_.end(), t_ns,
                                        [](std::int64_t t, const PlacedState &state) { return t < state.t_ns; });
    return later == states_.begin() ? &states_.front() : &*(later - 1);
}

Sphere PlacedVehicle::bound(std::int64_t t_ns) const {
    const PlacedState *state = at(t_ns);
    const Vec3 p = state == nullptr ? kOutside : state->p_WB + seconds(t_ns - state->t_ns) * state->v_WB_W;
    return {{p.x, p.y, p.z}, radius_m_};
}

void PlacedVehicle::pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const {
    const PlacedState *state = at(t_ns);
    if (state == nullptr) {
        for (std::size_t i = 0; i < bodies(); ++i) {
            write(p_WB + 3 * i, kOutside);
            write(q_WB + 4 * i, Quat{});
            write(v_WB_W + 3 * i, Vec3{});
            write(w_WB_W + 3 * i, Vec3{});
        }
        return;
    }
    const double s = seconds(t_ns - state->t_ns);
    const Vec3 p = state->p_WB + s * state->v_WB_W;
    const Quat q = normalized(state->q_WB * turned_by(s * state->w_WB_B));
    const Vec3 w_W = rotate(q, state->w_WB_B);
    write(p_WB, p);
    write(q_WB, q);
    write(v_WB_W, state->v_WB_W);
    write(w_WB_W, w_W);
    for (std::size_t i = 0; i < rotors_.size(); ++i) {
        const RotorMount &rotor = rotors_[i];
        const double rate_radps = rotor.spin * state->speed_radps[i];
        const Vec3 arm_W = rotate(q, rotor.p_BR);
        const Quat q_WR = q * rotor.q_BR;
        write(p_WB + 3 * (i + 1), p + arm_W);
        write(q_WB + 4 * (i + 1), normalized(q_WR * about_z(wrap_pi(state->angle_rad[i] + s * rate_radps))));
        write(v_WB_W + 3 * (i + 1), state->v_WB_W + cross(w_W, arm_W));
        write(w_WB_W + 3 * (i + 1), w_W + rotate(q_WR, {0.0, 0.0, rate_radps}));
    }
}

}  // namespace hil::sim
