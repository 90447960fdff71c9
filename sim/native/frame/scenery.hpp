// How things look: colour and texture of each geom, sun, sky and haze.
//
// Colours of geoms and textures are coded as sRGB (as MJCF files mean them), light is linear.
#pragma once

#include <cstdint>
#include <vector>

namespace hil::sim::frame {

// A pyramid of images, each half the size of the one before; edges are powers of two, of 4 or more.
struct Texture {
    int width = 0, height = 0, levels = 0;
    bool cube = false;                 // six square faces below each other: +x -x +y -y +z -z
    std::int32_t offset[16] = {};      // of each level's first texel
    // In squares of 4 x 4 texels, row by row; ten bits a colour, red lowest: the square root of linear light.
    std::vector<std::int32_t> texel;
};

struct Appearance {  // of one geom
    float rgb[3] = {0.5f, 0.5f, 0.5f};  // sRGB code / 255
    float emission = 0.0f;
    std::int32_t texture = -1;
    float repeat[2] = {1.0f, 1.0f};  // copies of the texture along an edge of the geom, or per 2 m (as MuJoCo has it)
    bool per_metre = false;
};

struct Scenery {
    std::vector<Texture> textures;
    std::vector<Appearance> geoms;
};

// The same with each texture replaced by its mean colour.
Scenery without_textures(const Scenery &scenery);

// Light in W; colours linear.
struct Daylight {
    float sun_W[3] = {0, 0, 1};  // unit, towards the sun
    float sun_rgb[3] = {1, 1, 1};
    float sky_rgb[3] = {0.3f, 0.3f, 0.3f};     // ambient on what faces up
    float ground_rgb[3] = {0.1f, 0.1f, 0.1f};  // and on what faces down
    float zenith_rgb[3] = {0.2f, 0.4f, 0.8f};
    float horizon_rgb[3] = {0.7f, 0.8f, 0.9f};
    // Haze (Koschmieder): over a range r the share exp(-extinction_per_m r) of what is seen comes through, the rest is
    // air_rgb. The sky is seen through haze_m of it straight up, through haze_m / sin(elevation) elsewhere.
    float air_rgb[3] = {0.7f, 0.8f, 0.9f};
    float extinction_per_m = 0.0f;
    float haze_m = 0.0f;
};

}  // namespace hil::sim::frame
