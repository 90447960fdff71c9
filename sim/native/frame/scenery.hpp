// Appearance: colour and texture of each geom, sun, sky and haze.
//
// Colours of geoms and textures are sRGB, as in MJCF files; light is linear.
#pragma once

#include <cstdint>
#include <vector>

namespace hil::sim::frame {

// Pyramid of images, each half the size of the previous one; edges are powers of two, at least 4.
struct Texture {
    int width = 0, height = 0, levels = 0;
    bool cube = false;                 // six square faces below each other: +x -x +y -y +z -z
    std::int32_t offset[16] = {};      // of each level's first texel
    // Stored in squares of 4 x 4 texels, row by row. Ten bits per channel hold the square root of linear light, red
    // lowest.
    std::vector<std::int32_t> texel;
};

struct Appearance {  // of one geom
    float rgb[3] = {0.5f, 0.5f, 0.5f};  // sRGB code / 255
    float emission = 0.0f;
    std::int32_t texture = -1;
    float repeat[2] = {1.0f, 1.0f};  // copies of the texture along an edge of the geom, or per 2 m (as MuJoCo has it)
    bool per_metre = false;
    float specular = 0.0f, shininess = 0.0f, metallic = 0.0f;  // 0 to 1
    // Texture of surface normals, laid as `texture` is: red and green are the components along u and v, 1/2 (n + 1).
    std::int32_t relief = -1;
};

struct Scenery {
    std::vector<Texture> textures;
    std::vector<Appearance> geoms;
};

// Returns a copy with each texture replaced by its mean colour.
Scenery without_textures(const Scenery &scenery);

// Parts of the colour that cost time (resolve.hpp), and the camera's response.
struct Shading {
    bool filtering = false;   // textures are interpolated between texels and levels
    bool highlights = false;  // surfaces mirror sun, sky and ground
    bool relief = false;      // textures of normals
    bool filmic = false;      // tone curve of a camera, else linear up to white
    float gain[3] = {1.0f, 1.0f, 1.0f};  // exposure and white balance
};

// Light in W; colours linear.
struct Daylight {
    float sun_W[3] = {0, 0, 1};  // unit, towards the sun
    float sun_rgb[3] = {1, 1, 1};
    float sky_rgb[3] = {0.3f, 0.3f, 0.3f};     // ambient light on upward surfaces
    float ground_rgb[3] = {0.1f, 0.1f, 0.1f};  // ambient light on downward surfaces
    float zenith_rgb[3] = {0.2f, 0.4f, 0.8f};
    float horizon_rgb[3] = {0.7f, 0.8f, 0.9f};
    // Haze (Koschmieder): over a range r the share exp(-extinction_per_m r) of a surface's light arrives, the rest is
    // air_rgb. The sky is seen through haze_m of haze at the zenith, haze_m / sin(elevation) elsewhere.
    float air_rgb[3] = {0.7f, 0.8f, 0.9f};
    float extinction_per_m = 0.0f;
    float haze_m = 0.0f;
    // Share of the sky that clouds cover, with distant land at the horizon (sky.hpp); below 0: a plain sky, no land.
    float clouds = -1.0f;
};

}  // namespace hil::sim::frame
