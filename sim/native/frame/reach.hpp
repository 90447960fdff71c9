// Regions in which an object can affect a sensor. An object that `misses` reports is outside for certain; one that it
// does not report may also be outside.
#pragma once

#include <algorithm>
#include <cmath>

#include "../actor.hpp"

namespace hil::sim::frame {

inline constexpr double kReachSlack = 1e-3;  // [m], far above rounding

class Reach {
public:
    virtual ~Reach() = default;
    virtual bool misses(const Sphere &sphere) const = 0;
};

// Points within `range_m` of a box in W; none if range_m is -infinity.
class Vicinity : public Reach {
public:
    Vicinity(const double *low_W, const double *high_W, double range_m) : range_m_(range_m) {
        std::copy_n(low_W, 3, low_W_);
        std::copy_n(high_W, 3, high_W_);
    }

    bool misses(const Sphere &sphere) const override {
        double d[3];
        for (int i = 0; i < 3; ++i) {
            d[i] = std::max({low_W_[i] - sphere.centre_W[i], 0.0, sphere.centre_W[i] - high_W_[i]});
        }
        return std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) > sphere.radius_m + range_m_ + kReachSlack;
    }

private:
    double low_W_[3], high_W_[3], range_m_;
};

// Points that a pinhole camera may see: in front of it, between the planes through its centre and the picture's edges.
class FieldOfView : public Reach {
public:
    // Edges as tangents in C: x of left and right, y of top and bottom.
    FieldOfView(const double *p_WC, const double *R_WC, double left, double right, double top, double bottom) {
        const double edges[4] = {left, right, top, bottom};
        std::copy_n(p_WC, 3, p_WC_);
        for (int side = 0; side < 4; ++side) {
            const double sign = side % 2 == 0 ? 1.0 : -1.0;
            double *n = inward_W_[side];
            for (int i = 0; i < 3; ++i) {
                n[i] = sign * (R_WC[3 * i + side / 2] - edges[side] * R_WC[3 * i + 2]);
            }
            const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            std::for_each_n(n, 3, [length](double &x) { x /= length; });
        }
        for (int i = 0; i < 3; ++i) {
            inward_W_[4][i] = R_WC[3 * i + 2];
        }
    }

    bool misses(const Sphere &sphere) const override {
        double d[3];
        for (int i = 0; i < 3; ++i) {
            d[i] = sphere.centre_W[i] - p_WC_[i];
        }
        return std::any_of(inward_W_, inward_W_ + 5, [&](const double *n) {
            return n[0] * d[0] + n[1] * d[1] + n[2] * d[2] < -sphere.radius_m - kReachSlack;
        });
    }

private:
    double p_WC_[3], inward_W_[5][3];
};

}  // namespace hil::sim::frame
