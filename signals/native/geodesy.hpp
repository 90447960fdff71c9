// WGS 84 latitude, longitude, altitude <-> local north, east, down.
//
// North and east are the exact tangent-plane components of the ECEF difference (WGS 84: a = 6378137 m,
// 1/f = 298.257223563). Down is the difference of altitudes, as autopilots define it: it follows the ellipsoid, so it
// agrees with barometer and GPS, and leaves the tangent plane by d^2 / 2R (8 cm at 1 km).
//
// Units: degrees and metres. Uses detmath only; the inverse has a fixed count of iterations. Same bits on every machine.
#pragma once

#include <cmath>

#include "rotation.hpp"

namespace hil {

struct Geodetic {
    double lat_deg = 0.0, lon_deg = 0.0, alt_m = 0.0;
};

namespace wgs84 {
inline constexpr double kA = 6378137.0, kF = 1.0 / 298.257223563, kE2 = kF * (2.0 - kF);
inline constexpr double kDeg = det::kPi / 180.0;
}  // namespace wgs84

// Tangent plane at one origin. The trigonometry of the origin is evaluated once.
class LocalTangentPlane {
   public:
    void set_origin(Geodetic origin) {
        origin_ = origin;
        const double lat = origin.lat_deg * wgs84::kDeg;
        sin_lat_ = det::sin(lat);
        cos_lat_ = det::cos(lat);
        const double w = 1.0 - wgs84::kE2 * sin_lat_ * sin_lat_;
        const double prime_vertical = wgs84::kA / std::sqrt(w);
        north_per_rad_ = prime_vertical * (1.0 - wgs84::kE2) / w + origin.alt_m;
        east_per_rad_ = (prime_vertical + origin.alt_m) * cos_lat_;
        origin_meridional_ = meridional(prime_vertical, sin_lat_, cos_lat_, 1.0, origin.alt_m);
    }
    const Geodetic &origin() const { return origin_; }

    Vec3 to_ned(Geodetic g) const {
        const double lat = g.lat_deg * wgs84::kDeg, dlon = (g.lon_deg - origin_.lon_deg) * wgs84::kDeg;
        const double s = det::sin(lat), c = det::cos(lat);
        const double cos_dlon = det::cos(dlon);
        const double n = wgs84::kA / std::sqrt(1.0 - wgs84::kE2 * s * s);
        return {meridional(n, s, c, cos_dlon, g.alt_m) - origin_meridional_, (n + g.alt_m) * c * det::sin(dlon),
                origin_.alt_m - g.alt_m};
    }

    // Newton's method with the metric at the origin. Each pass multiplies the error by about distance / earth radius:
    // within 100 km, four passes reach the rounding of a degree in a double, below 1e-8 m.
    Geodetic to_geodetic(Vec3 p_N) const {
        Geodetic g{origin_.lat_deg, origin_.lon_deg, origin_.alt_m - p_N.z};
        for (int pass = 0; pass < 5; ++pass) {
            const Vec3 have = to_ned(g);
            g.lat_deg += (p_N.x - have.x) / north_per_rad_ / wgs84::kDeg;
            g.lon_deg += (p_N.y - have.y) / east_per_rad_ / wgs84::kDeg;
        }
        return g;
    }

   private:
    // North component of the ECEF position: -sin(lat0) * (X cos lon0 + Y sin lon0) + cos(lat0) * Z.
    double meridional(double n, double s, double c, double cos_dlon, double alt_m) const {
        return cos_lat_ * (n * (1.0 - wgs84::kE2) + alt_m) * s - sin_lat_ * (n + alt_m) * c * cos_dlon;
    }

    Geodetic origin_;
    double sin_lat_ = 0.0, cos_lat_ = 1.0, north_per_rad_ = wgs84::kA, east_per_rad_ = wgs84::kA;
    double origin_meridional_ = 0.0;
};

}  // namespace hil
