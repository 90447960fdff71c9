// Direction of an echo from the phases of the receivers.
//
// Receiver i at r_i (frame of the radar: x forward, y left, z up) sees the phase -2 pi r_i . d / lambda, d the unit
// direction to the echo. A pair (i, j) with the base b = r_i - r_j therefore gives
//
//     b . d = -arg(X_i conj X_j) lambda / (2 pi)   modulo lambda
//
// and d follows from the pairs by least squares, with |d| = 1 and d_x >= 0. Pairs are taken from the shortest base up:
// what is known so far says which multiple of lambda belongs to the next. Where the bases span a line alone, the other
// component of d is zero.
#pragma once

#include <array>
#include <vector>

namespace hil::sim::radar {

class Direction {
   public:
    // positions: x, y, z of each receiver.
    Direction(const std::vector<std::array<double, 3>> &positions_m, double wavelength_m);

    // re, im: what each receiver has in a cell.
    std::array<double, 3> find(const double *re, const double *im) const;
    int receivers() const { return receivers_; }

   private:
    struct Pair {
        int i, j;
        double x, y, z;
    };
    int receivers_;
    double wavelength_;
    bool deep_ = false;  // some base has an x: the equations need d_x, so they are solved again with the last one
    std::vector<Pair> pairs_;
};

}  // namespace hil::sim::radar
