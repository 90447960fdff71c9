// Interpolation of the phase's remainder in the speed: exp(2 pi i g(v)) ~ sum over k of L_k(v) exp(2 pi i g(v_k)),
// L_k the Lagrange polynomials of the Chebyshev nodes v_k of an interval of speeds.
#pragma once

namespace hil::sim::radar {

constexpr int kMaxNodes = 16;

struct SpeedNodes {
    int count;
    double middle, half_span;    // m/s
    double node[kMaxNodes];      // in [-1, 1]
    double scale[kMaxNodes];     // 1 / prod over j != k of (node_k - node_j)
    double speed(int k) const { return middle + half_span * node[k]; }
};

SpeedNodes speed_nodes(int count, double least, double greatest);

}  // namespace hil::sim::radar
