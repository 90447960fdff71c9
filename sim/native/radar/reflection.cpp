#include "reflection.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

// 1 - exp(-x), x >= 0, without cancellation for the small x of smooth surfaces and grazing rays.
double lost_share(double x) {
    if (x > 0.01) return 1.0 - det::exp(-x);
    return x * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0))));
}

}  // namespace

double fresnel_power(const ReflectingSurface &surface, double cosine) {
    const double er = surface.eps_r, ei = surface.eps_i, c = cosine;
    // w = p - j q
    const double a = er - 1.0 + c * c;
    const double size = std::sqrt(a * a + ei * ei);
    double p = 0.0, q = 0.0;  // the smaller one is computed from the larger one, without cancellation
    if (size > 0.0) {
        if (a >= 0.0) {
            p = std::sqrt(0.5 * (size + a));
            q = 0.5 * ei / p;
        } else {
            q = std::sqrt(0.5 * (size - a));
            p = 0.5 * ei / q;
        }
    }
    const auto ratio = [](double re0, double im0, double re1, double im1) {
        const double below = re1 * re1 + im1 * im1;
        return below > 0.0 ? (re0 * re0 + im0 * im0) / below : 1.0;
    };
    const double across = ratio(c - p, q, c + p, q);
    const double along = ratio(er * c - p, ei * c - q, er * c + p, ei * c + q);
    return 0.5 * (across + along);
}

double backscatter(const ReflectingSurface &surface, double cosine) {
    if (!(cosine > 0.0)) return 0.0;
    const double c2 = cosine * cosine;
    const double phase = surface.phase_height * cosine;
    const double coherent = det::exp(-(phase * phase));
    double sigma0 = 4.0 * lost_share(phase * phase) * fresnel_power(surface, cosine) * c2;
    const double s2 = surface.facet_slope * surface.facet_slope;
    const double exponent = (1.0 - c2) / (c2 * 2.0 * s2);
    if (exponent < 700.0) {  // beyond it the lobe underflows, also times 1 / c^4
        sigma0 += coherent * fresnel_power(surface, 1.0) * det::exp(-exponent) / (2.0 * s2 * c2 * c2);
    }
    return sigma0;
}

void amplitude_curve(const ReflectingSurface &surface, float *out, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
        const double u = static_cast<double>(k) / static_cast<double>(count - 1);
        const double c = u * u;
        out[k] = k == 0 ? 0.0f : static_cast<float>(std::sqrt(backscatter(surface, c) / c));
    }
}

}  // namespace hil::sim::radar
