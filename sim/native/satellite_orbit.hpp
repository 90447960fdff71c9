// Positions of satellites on Kepler orbits, by the user algorithm of IS-GPS-200 (section 20.3.3.4.3, Table 20-IV) without
// harmonic corrections, as for an almanac (20.3.3.5.2):
//
//   n = sqrt(mu / a^3)          M = M0 + n tk                 E - e sin E = M
//   r = a (1 - e cos E)         sin v = sqrt(1 - e^2) sin E / (1 - e cos E),  cos v = (cos E - e) / (1 - e cos E)
//   u = v + omega               O = O0 + (dO/dt - w_e) tk - w_e t0
//   x = r (cos u cos O - sin u cos i sin O),  y = r (cos u sin O + sin u cos i cos O),  z = r sin u sin i
//
// tk: time since the reference time toa; t0: second of the GPS week at toa. w_e = 7.2921151467e-5 rad/s. Newton's method
// with a fixed count of steps solves for E (below 1e-14 rad for e < 0.1). detmath only: the same bits on every machine.
#pragma once

namespace hil::sim {

struct SatelliteOrbit {
    double toa_s;         // GPS time of the reference, since 6 January 1980
    double toa_week_s;    // second of the week at toa
    double mu_m3ps2, semi_major_m, eccentricity;
    double inclination_rad, node_rad, node_rate_radps, perigee_rad, anomaly_rad;  // at toa; node at the week's start
};

// Writes the position in the earth-fixed frame [m] at GPS time `t_s`.
void satellite_position(const SatelliteOrbit &orbit, double t_s, double out[3]);

}  // namespace hil::sim
