// Coefficients of algorithm AS 241 (Wichura, 1988) for |p - 1/2| <= kCentre, highest power first: standard normals are
//     q A(r) / B(r),   q = p - 1/2,   r = 0.180625 - q q
#pragma once

namespace hil::normal_centre {

constexpr double kCentre = 0.425;
constexpr double kA[8] = {2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
                          13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608};
constexpr double kB[8] = {5226.495278852854561,  28729.085735721942674, 39307.89580009271061,
                          21213.794301586595867, 5394.1960214247511077, 687.1870074920579083,
                          42.313330701600911252, 1.0};

}  // namespace hil::normal_centre
