// Position from pseudoranges by weighted least squares, linearised at the true place.
//
//   G = [-e_i  1],   Q = (G^T W G)^-1,   dx = Q G^T W r,   v = r - G dx
//
// e_i: unit vector to satellite i in east, north, up; W: the weights, relative; r: error of the pseudorange [m]. The place is
// wrong by dx[0..2], the clock by dx[3] (all systems on one clock: their offsets are broadcast). Q without the weights,
// (G^T G)^-1, gives the dilutions of precision. Around the true place the linear solution is that of the full equations but
// for |dx|^2 / range: 0.5 mm for an error of 100 m.
//
// `held`: the height is known (a fix of three satellites): a row (0 0 1 0) of weight kHeld with the error `height_error`.
// Sums run in the order of the satellites. The normal equations are solved by Cholesky's method; + - * / sqrt only.
#pragma once

#include <cstddef>

namespace hil::sim {

struct GnssFix {
    bool solved = false;
    double shift[4] = {};      // dx: east, north, up, clock [m]
    double variance[4] = {};   // diagonal of Q
    double dilution[4] = {};   // diagonal of (G^T G)^-1
};

// `directions` [count][3], `weights`, `errors`, `residuals` [count]. Not solved: too few satellites, or all in one cone.
GnssFix solve_gnss(const double *directions, const double *weights, const double *errors, std::size_t count, bool held,
                   double height_error, double *residuals);

}  // namespace hil::sim
