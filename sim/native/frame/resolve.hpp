// Channels of a picture from its visibility buffer. Only requested channels are computed.
//
//     depth            t of a pinhole, t z of other cameras: along the camera's axis [m], +inf without a hit
//     range            t |d|: along the ray [m], +inf without a hit
//     segmentation, instance, material, geom: labels of the surface; without a hit 0, and -1 for geom
//     normal           unit, in C, towards the camera's side of the surface; 0 without a hit
//     radial_velocity  (v_P - v_C) . d / |d| [m/s], + receding; 0 without a hit. With v of the rigid body taken at the
//                      camera's origin this needs no position: w x (t d) is normal to d.
//     rgb              sRGB: Lambert's law, sun with or without shadow, sky light by the surface's upward component,
//                      haze by Koschmieder's law (scenery.hpp), for surfaces and sky in linear light
//
// A block of 4 x 4 pixels that sees one geom is resolved at once, any other block once for each of its geoms.
#pragma once

#include <cstdint>

#include "raster.hpp"
#include "scenery.hpp"

namespace hil::sim::frame {

struct ChannelOutputs {  // row-major, width wide; null: not requested
    float *depth = nullptr, *range = nullptr, *normal = nullptr, *radial_velocity = nullptr;
    std::uint8_t *segmentation = nullptr, *material = nullptr, *rgb = nullptr;
    std::uint16_t *instance = nullptr;
    std::int32_t *geom = nullptr;
};

// Shadow map as the kernel reads it: picture of the scene from the sun with parallel rays.
struct ShadowMap {
    const VisibilityBuffer *buffer = nullptr;
    const RayTable *rays = nullptr;
    const DrawnGeom *drawn = nullptr;         // transforms sun camera -> local
    const std::int32_t *drawn_of_geom = nullptr;
    std::int32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;  // pixels that may hold a geom
};

struct ResolveJob {
    const VisibilityBuffer *buffer;
    const RayTable *rays;
    const DrawnGeom *drawn;
    const std::int32_t *drawn_of_geom;
    const Geom *geoms;
    const Scenery *scenery;
    ChannelOutputs out;
    int row0, row1;  // block rows
    // Light in C.
    float sun_C[3], up_C[3];
    float pixel_angle_rad;  // of one pixel, for the choice of texture level
    const Daylight *light;
    // Camera to sun camera: p_S = M p_C + s.
    float camera_to_sun[9], camera_in_sun[3];
    ShadowMap shadow[2];  // static, moving
    int shadows = 0;
};

struct ResolveKernels {
    void (*resolve)(const ResolveJob &);
};
const ResolveKernels &resolve_kernels(Isa isa);

}  // namespace hil::sim::frame
