#include "walk_path.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "detmath.hpp"

namespace hil::sim {
namespace {

double smoothstep_integral(double u) { return u * u * u * u * (2.5 + u * (u - 3.0)); }

struct ValueSlope {
    double value, slope;
};

// Value and slope at t of the quintic with these values, slopes and second derivatives at 0 and 1.
ValueSlope hermite(double p0, double v0, double a0, double p1, double v1, double a1, double t) {
    const double d = p1 - p0 - v0 - 0.5 * a0, e = v1 - v0 - a0, f = a1 - a0;
    const double c3 = 10.0 * d - 4.0 * e + 0.5 * f, c4 = -15.0 * d + 7.0 * e - f, c5 = 6.0 * d - 3.0 * e + 0.5 * f;
    return {p0 + t * (v0 + t * (0.5 * a0 + t * (c3 + t * (c4 + t * c5)))),
            v0 + t * (a0 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))};
}

WalkPlace at(const WalkStraight &straight, double s_m) {
    const double d = s_m - straight.start_m;
    return {straight.x_m + d * straight.cos, straight.y_m + d * straight.sin, straight.cos, straight.sin,
            straight.cos, straight.sin, 0.0};
}

WalkPlace at(const WalkCorner &corner, double s_m) {
    const double u = std::clamp((s_m - corner.start_m) / corner.length_m, 0.0, 1.0);
    const double heading = corner.heading_rad + corner.turn_rad * smoothstep(u);
    const int i = u < 1.0 ? static_cast<int>(u * kCornerPieces) : kCornerPieces - 1;  // also for a NaN
    const double h = corner.length_m / kCornerPieces, t = u * kCornerPieces - i;
    const auto &a = corner.knots[i], &b = corner.knots[i + 1];
    const auto [x, dx] = hermite(a[0], a[2] * h, a[4] * h * h, b[0], b[2] * h, b[4] * h * h, t);
    const auto [y, dy] = hermite(a[1], a[3] * h, a[5] * h * h, b[1], b[3] * h, b[5] * h * h, t);
    const double yaw_per_m = corner.turn_rad * smoothstep_slope(u) / corner.length_m;
    return {x, y, det::cos(heading), det::sin(heading), dx / h, dy / h, yaw_per_m};
}

// The last element that starts at or before `at`, or the first one.
template <class Part>
const Part &started(const std::vector<Part> &parts, double Part::*start, double at) {
    auto next = std::upper_bound(parts.begin(), parts.end(), at, [start](double x, const Part &p) { return x < p.*start; });
    return next == parts.begin() ? parts.front() : *(next - 1);
}

}  // namespace

std::pair<double, double> WalkPlace::half_heading() const {
    const double half_cos = cos > -0.5 ? std::sqrt(0.5 * (1.0 + cos)) : 0.5 * std::fabs(sin) / std::sqrt(0.5 * (1.0 - cos));
    const double half_sin = cos < 0.5 ? std::sqrt(0.5 * (1.0 - cos)) : 0.5 * std::fabs(sin) / half_cos;
    return {half_cos, sin < 0.0 ? -half_sin : half_sin};
}

WalkPath::WalkPath(std::vector<WalkPiece> pieces, std::vector<WalkStraight> straights, std::vector<WalkCorner> corners,
                   double lap_s, double offset_s)
    : pieces_(std::move(pieces)), straights_(std::move(straights)), corners_(std::move(corners)), lap_s_(lap_s),
      offset_s_(offset_s) {
    if (pieces_.empty() || straights_.empty() || corners_.size() != straights_.size()) {
        throw std::invalid_argument("a path needs pieces and straights, and as many corners as straights");
    }
    if (!(lap_s > 0.0) || !std::isfinite(lap_s) || !std::isfinite(offset_s)) {
        throw std::invalid_argument("a lap needs a finite duration above 0 and a finite offset");
    }
}

WalkProgress WalkPath::progress(std::int64_t t_ns) const {
    double t_s = static_cast<double>(t_ns) / 1e9 + offset_s_;
    const double rest_s = std::fmod(t_s, lap_s_);
    double laps = std::floor((t_s - rest_s) / lap_s_ + 0.5);  // the quotient is an integer up to rounding
    if (rest_s < 0.0) {
        laps -= 1.0;
    }
    t_s -= laps * lap_s_;
    const WalkPiece &piece = started(pieces_, &WalkPiece::start_s, t_s);
    const double elapsed_s = t_s - piece.start_s, v0 = piece.speed_before_mps, v1 = piece.speed_after_mps;
    if (v0 == v1) {
        return {static_cast<std::int64_t>(laps), piece.start_m + v0 * elapsed_s, v0};
    }
    const double u = elapsed_s / piece.duration_s, dv = v1 - v0;
    return {static_cast<std::int64_t>(laps),
            piece.start_m + v0 * elapsed_s + dv * piece.duration_s * smoothstep_integral(u), v0 + dv * smoothstep(u)};
}

WalkPlace WalkPath::place(double s_m) const {
    const WalkStraight &straight = started(straights_, &WalkStraight::start_m, s_m);
    const WalkCorner &corner = corners_[static_cast<std::size_t>(&straight - straights_.data())];
    return s_m < corner.start_m ? at(straight, s_m) : at(corner, s_m);
}

}  // namespace hil::sim
