#include "ray.hpp"

#include <limits>

namespace hil::sim {

double ray_distance(const double *origin_W, const double *direction_W, const double *boxes, std::size_t count) {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    double nearest = kNone;
    if (origin_W[2] <= 0.0) {
        nearest = 0.0;
    } else if (direction_W[2] < 0.0) {
        nearest = -origin_W[2] / direction_W[2];
    }
    for (std::size_t b = 0; b < count; ++b) {
        const double *centre = boxes + 6 * b, *half = centre + 3;
        double enter = 0.0, leave = nearest;
        for (int i = 0; i < 3 && enter <= leave; ++i) {
            const double low = centre[i] - half[i] - origin_W[i], high = centre[i] + half[i] - origin_W[i];
            const double d = direction_W[i];
            if (d == 0.0) {
                if (low > 0.0 || high < 0.0) leave = -1.0;
                continue;
            }
            const double a = low / d, c = high / d;
            const double near = a < c ? a : c, far = a < c ? c : a;
            if (near > enter) enter = near;
            if (far < leave) leave = far;
        }
        if (enter <= leave && enter < nearest) nearest = enter;
    }
    return nearest == kNone ? -1.0 : nearest;
}

}  // namespace hil::sim
