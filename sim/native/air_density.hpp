// Density of the air over height, relative to 1.225 kg/m3: the standard atmosphere (ISO 2533, sim/scene/atmosphere.py),
// warmer or colder than it by the same number of kelvins at every height.
//
//   h = r z / (r + z)                          geopotential height of z metres above the sea
//   rho / rho_0 = (p / p_0) (T_0 / (T + dT)),  p and T of the standard
//
// It is a cubic through four heights of each layer of 64 m, within 1e-11 of the equation: smooth within a step, for a few
// operations. The layer is chosen by the height alone, so that the result is a pure function of it.
#pragma once

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

class AirDensity {
  public:
    AirDensity() = default;  // 1 everywhere
    AirDensity(double site_altitude_m, double warmer_k)
        : varies_(true), site_altitude_m_(site_altitude_m), warmer_k_(warmer_k) {}

    // `z_m` over the site.
    double ratio(double z_m) const {
        if (!varies_) return 1.0;
        const double layer = std::floor(z_m / kLayer_m);
        if (layer != layer_) enter(layer);
        const double x = z_m - (layer + 0.5) * kLayer_m;
        return c_[0] + x * (c_[1] + x * (c_[2] + x * c_[3]));
    }

    double exact(double z_m) const {
        constexpr double kEarth_m = 6356766.0, kExponent = 5.255876, kLapse = 0.0065, kSea_k = 288.15;
        constexpr double kTropopause_m = 11000.0, kTropopause_k = 216.65;
        const double altitude = site_altitude_m_ + z_m;
        const double h = kEarth_m * altitude / (kEarth_m + altitude);
        const double low = h < kTropopause_m ? h : kTropopause_m;
        const double temperature = kSea_k - kLapse * low;
        double pressure = det::pow(temperature / kSea_k, kExponent);
        if (h > kTropopause_m) pressure *= det::exp(-(h - kTropopause_m) * (kExponent * kLapse / kTropopause_k));
        return pressure * (kSea_k / (temperature + warmer_k_));
    }

  private:
    static constexpr double kLayer_m = 64.0, kNode_m = 24.0;

    // Newton's form at -72, -24, 24, 72 m from the middle, written out in powers.
    void enter(double layer) const {
        const double middle = (layer + 0.5) * kLayer_m, d = kNode_m;
        const double a = exact(middle - 3.0 * d), b = exact(middle - d), c = exact(middle + d), e = exact(middle + 3.0 * d);
        const double even1 = 0.5 * (b + c), even3 = 0.5 * (a + e), odd1 = 0.5 * (c - b) / d, odd3 = (e - a) / (6.0 * d);
        c_[2] = (even3 - even1) / (8.0 * d * d);
        c_[0] = even1 - c_[2] * d * d;
        c_[3] = (odd3 - odd1) / (8.0 * d * d);
        c_[1] = odd1 - c_[3] * d * d;
        layer_ = layer;
    }

    bool varies_ = false;
    double site_altitude_m_ = 0.0, warmer_k_ = 0.0;
    mutable double layer_ = std::nan(""), c_[4] = {};
};

}  // namespace hil::sim
