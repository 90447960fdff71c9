// Reflections of distant transmitters in plane faces, by the method of images.
//
// A face has centre C, unit normal n and a radius about C. For an antenna A in front of it at the distance
// h = |(A - C) . n| and a transmitter in the direction s (unit, from A; so far that rays to A and to the face are parallel)
//
//   m = s - 2 (s . n) n        direction in which the antenna sees the image
//   d = h / |s . n|            distance to the point of reflection Q = A + d m
//   extra path = d (1 - s . m) = 2 h |s . n|
//
// The transmitter must be on the antenna's side of the face. Faces farther than `reach_m` are left out, Q must be within the
// radius of C, and the extra path at most `max_extra_m`. Whether Q is on the face itself, and whether the ways A-Q and Q-s are free, is left to rays.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim {

struct MirrorHit {
    std::int32_t satellite, face;
    double direction[3];  // m
    double normal[3];     // of the face, towards the antenna
    double distance_m;    // d
    double extra_m;
    double cosine;        // |s . n|, of the angle of incidence
};

// `faces`: [count][7] centre, normal, radius. `directions`: [satellites][3]. Writes at most `limit` hits, by satellite and
// then by face, and returns how many there are (more than `limit`: the rest is missing).
std::size_t mirror_hits(const double *antenna, const double *faces, std::size_t count, const double *directions,
                        std::size_t satellites, double reach_m, double max_extra_m, MirrorHit *hits, std::size_t limit);

}  // namespace hil::sim
