// Backscatter of a surface, sigma0 [m^2 of cross-section per m^2].
//
// With c the cosine of the angle of incidence, eps = eps_r - j eps_i, w = sqrt(eps - 1 + c^2):
//
//     Fresnel (Born and Wolf, Principles of Optics, 7th ed., sec. 1.5), the mean of both polarisations:
//         |Gamma(c)|^2 = ( |(c - w) / (c + w)|^2 + |(eps c - w) / (eps c + w)|^2 ) / 2
//     roughness (Ament, Proc. IRE 41, 1953, p. 142), h the rms height: the coherent share is
//         rho^2 = exp(-(4 pi h c / lambda)^2)
//     coherent part, facets of rms slope s (Kirchhoff, geometric optics: Ulaby, Moore and Fung, Microwave Remote
//     Sensing II, 1982, sec. 12-4), and the rest (Lambert):
//         sigma0(c) = rho^2 |Gamma(1)|^2 exp(-tan^2 / (2 s^2)) / (2 s^2 c^4)  +  4 (1 - rho^2) |Gamma(c)|^2 c^2
//
// Determinism: + - * / sqrt and detmath.hpp. Caller-owned arrays; no allocation.
#pragma once

#include <cstddef>

namespace hil::sim::radar {

struct ReflectingSurface {
    double eps_r, eps_i;  // of relative permittivity; eps_i >= 0 is loss
    double phase_height;  // 4 pi h / lambda
    double facet_slope;   // s > 0
};

double fresnel_power(const ReflectingSurface &surface, double cosine);
// sigma0(c); 0 if c is not above 0.
double backscatter(const ReflectingSurface &surface, double cosine);
// sqrt(sigma0(c) / c) at c = u^2, u = 0 .. 1 at `count` even nodes, ends included: the amplitude of a pixel is
// proportional to it (scatterers.hpp). Near grazing it falls with c^1.5 = u^3, which even steps of u resolve.
void amplitude_curve(const ReflectingSurface &surface, float *out, std::size_t count);

}  // namespace hil::sim::radar
