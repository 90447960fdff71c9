// Channels of a picture from its visibility buffer. Only requested channels are computed.
//
//     depth            t of a pinhole, t z of other cameras: along the camera's axis [m], +inf without a hit
//     range            t |d|: along the ray [m], +inf without a hit
//     segmentation, instance, material, geom: labels of the surface; without a hit 0, and -1 for geom
//     normal           unit, in C, towards the camera's side of the surface; 0 without a hit
//     radial_velocity  (v_P - v_C) . d / |d| [m/s], + receding; 0 without a hit. With v of the rigid body taken at the
//                      camera's origin this needs no position: w x (t d) is normal to d.
//     rgb              sRGB: Lambert's law, sun with or without shadow, sky light by the surface's upward component,
//                      haze by Koschmieder's law (scenery.hpp), for surfaces and sky in linear light; then gain and
//                      tone curve
//
// Highlights. With F0 = 0.08 specular (dielectrics; metals: their colour), gloss g = shininess and the angle a between
// normal and view, a surface mirrors the share
//
//     k = g (F0 + (max(g, F0) - F0) (1 - cos a)^5)            Schlick, Comput. Graph. Forum 13 (1994), with the limit
//                                                             for rough surfaces of Lagarde (2011)
//
// of the sky or ground in the direction of reflection, and of the sun the lobe of Blinn (SIGGRAPH 1977) with the exponent
// e = 1024 g^3, normalised by (e + 8) / 8, as the Gaussian exp(-e (1 - n.h)) (Wang et al., SIGGRAPH Asia 2009).
//
// Ambient occlusion. With the share V of the surroundings that is open (sky_visibility.hpp), the ambient light is
// multiplied by 0.2 + 0.8 V: what is not open sends a fifth of the ambient light.
//
// Relief. A normal n becomes the unit vector along n + (r_u / r_n) t_u + (r_v / r_n) t_v for the texel (r_u, r_v, r_n) and
// the unit directions t in which the texture's coordinates grow.
//
// Tone curve. x = 0.723 gain L, y = x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14): Narkowicz's fit of the ACES film
// curve (2015), scaled to leave a grey of 0.18 where it is.
//
// A block of 4 x 4 pixels that sees one geom is resolved at once, any other block once for each of its geoms. Flat faces
// have a shorter way (flat_faces.hpp). Texels are read last, for a run of blocks at once (Run in surface_colour.hpp).
#pragma once

#include <cstdint>

#include "raster.hpp"
#include "scenery.hpp"
#include "sky_visibility.hpp"

namespace hil::sim::frame {

struct ChannelOutputs {  // row-major, width wide; null: not requested
    float *depth = nullptr, *range = nullptr, *normal = nullptr, *radial_velocity = nullptr;
    std::uint8_t *segmentation = nullptr, *material = nullptr, *rgb = nullptr;
    std::uint16_t *instance = nullptr;
    std::int32_t *geom = nullptr;
};

constexpr std::int32_t kSeveral = -2;

// Shadow map as the kernel reads it: picture of the scene from the sun with parallel rays.
struct ShadowMap {
    const VisibilityBuffer *buffer = nullptr;
    const RayTable *rays = nullptr;
    const DrawnGeom *drawn = nullptr;         // transforms sun camera -> local
    const std::int32_t *drawn_of_geom = nullptr;
    std::int32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;  // pixels that may hold a geom
    // [areas]: the only geom in a square area and the pixels right of it and below; -1: none; kSeveral: there may be more
    const std::int32_t *sole = nullptr;
    std::int32_t areas_x = 0, area_power = 0;  // an area is 2^area_power pixels wide and high
};

struct SkyPattern;

struct ResolveJob {
    const VisibilityBuffer *buffer;
    const RayTable *rays;
    const DrawnGeom *drawn;
    const std::int32_t *drawn_of_geom;
    const Geom *geoms;
    const Scenery *scenery;
    ChannelOutputs out;
    int row0, row1;  // block rows
    // [blocks]: a bit for each pixel whose surface is wanted; blocks without any are left as they are. Null: all.
    const std::uint16_t *lanes = nullptr;
    // Light in C.
    float sun_C[3], up_C[3];
    float pixel_angle_rad;  // of one pixel, for the choice of texture level
    const Daylight *light;
    const SkyPattern *pattern = nullptr;  // of clouds and distant land; null: a plain sky
    Shading shading;
    const SkyVisibility *sky = nullptr;        // null: no ambient occlusion
    float camera_to_world[9], p_WC[3];
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
