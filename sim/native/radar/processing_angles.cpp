#include "processing_angles.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

constexpr int kDeepRounds = 16;

// Least squares for (y, z), a pair at a time.
struct Normal {
    double yy = 0.0, yz = 0.0, zz = 0.0, ry = 0.0, rz = 0.0;

    void add(double y, double z, double target) {
        yy += y * y, yz += y * z, zz += z * z;
        ry += y * target, rz += z * target;
    }
    double size() const { return yy + zz; }
    bool plane() const { return yy * zz - yz * yz > 1e-6 * size() * size(); }
    // A base within what is spanned: its multiple of lambda can be foreseen.
    bool spans(double y, double z) const {
        if (size() <= 0.0) return false;
        if (plane()) return true;
        const double off = y * y * zz - 2.0 * y * z * yz + z * z * yy;  // squared, across the line
        return off < 1e-6 * (y * y + z * z) * size();
    }
    void solve(double &y, double &z) const {
        if (plane()) {
            const double per = 1.0 / (yy * zz - yz * yz);
            y = (zz * ry - yz * rz) * per;
            z = (yy * rz - yz * ry) * per;
        } else if (size() > 0.0) {  // the shortest solution lies along the line
            y = ry / size();
            z = rz / size();
        }
    }
};

}  // namespace

Direction::Direction(const std::vector<std::array<double, 3>> &positions_m, double wavelength_m)
    : receivers_((int)positions_m.size()), wavelength_(wavelength_m) {
    if (positions_m.empty()) throw std::invalid_argument("an array needs a receiver");
    for (int i = 0; i < receivers_; ++i) {
        for (int j = i + 1; j < receivers_; ++j) {
            Pair pair{i, j, 0.0, 0.0, 0.0};
            pair.x = positions_m[i][0] - positions_m[j][0];
            pair.y = positions_m[i][1] - positions_m[j][1];
            pair.z = positions_m[i][2] - positions_m[j][2];
            if (pair.y != 0.0 || pair.z != 0.0) pairs_.push_back(pair);
            deep_ = deep_ || pair.x != 0.0;
        }
    }
    const auto length2 = [](const Pair &p) { return p.x * p.x + p.y * p.y + p.z * p.z; };
    std::stable_sort(pairs_.begin(), pairs_.end(),
                     [&](const Pair &a, const Pair &b) { return length2(a) < length2(b); });
}

std::array<double, 3> Direction::find(const double *re, const double *im) const {
    double x = 1.0, y = 0.0, z = 0.0;
    for (int round = 0; round < (deep_ ? kDeepRounds : 1); ++round) {
        Normal normal;
        double known_y = 0.0, known_z = 0.0;
        for (const Pair &p : pairs_) {
            const double cross_re = re[p.i] * re[p.j] + im[p.i] * im[p.j];
            const double cross_im = im[p.i] * re[p.j] - re[p.i] * im[p.j];
            double target = -det::atan2(cross_im, cross_re) * wavelength_ / (2.0 * det::kPi) - p.x * x;
            const double foreseen = normal.spans(p.y, p.z) ? p.y * known_y + p.z * known_z : 0.0;
            target += wavelength_ * std::floor((foreseen - target) / wavelength_ + 0.5);
            normal.add(p.y, p.z, target);
            normal.solve(known_y, known_z);
        }
        const double across = std::sqrt(known_y * known_y + known_z * known_z);
        if (across > 1.0) {  // noise: the nearest direction there is
            known_y /= across;
            known_z /= across;
        }
        y = known_y, z = known_z;
        const double rest = 1.0 - y * y - z * z;
        x = rest > 0.0 ? std::sqrt(rest) : 0.0;
    }
    return {x, y, z};
}

}  // namespace hil::sim::radar
