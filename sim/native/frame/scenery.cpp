#include "scenery.hpp"

#include <cstddef>

namespace hil::sim::frame {

namespace {

// The resolve kernel's decoding of geom colours, and its inverse by bisection, with additions and products only.
double decode(double c) { return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878); }

double encode(double linear) {
    double low = 0.0, high = 4.0;
    for (int i = 0; i < 48; ++i) {
        const double middle = 0.5 * (low + high);
        (decode(middle) < linear ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

// Mean linear colour of a texture's finest level.
void mean_of(const Texture &texture, double *rgb) {
    const std::size_t end = texture.levels > 1 ? static_cast<std::size_t>(texture.offset[1]) : texture.texel.size();
    std::int64_t sum[3] = {0, 0, 0};
    for (std::size_t i = 0; i < end; ++i) {
        for (int c = 0; c < 3; ++c) {
            const std::int64_t root = texture.texel[i] >> (10 * c) & 1023;
            sum[c] += root * root;
        }
    }
    for (int c = 0; c < 3; ++c) rgb[c] = static_cast<double>(sum[c]) / (1023.0 * 1023.0 * static_cast<double>(end));
}

}  // namespace

Scenery without_textures(const Scenery &scenery) {
    std::vector<double> mean(3 * scenery.textures.size());
    for (std::size_t t = 0; t < scenery.textures.size(); ++t) mean_of(scenery.textures[t], mean.data() + 3 * t);
    Scenery plain;
    plain.geoms = scenery.geoms;
    for (Appearance &look : plain.geoms) {
        look.relief = -1;
        if (look.texture < 0) continue;
        const double *of = mean.data() + 3 * static_cast<std::size_t>(look.texture);
        for (int c = 0; c < 3; ++c) {
            look.rgb[c] = static_cast<float>(encode(decode(static_cast<double>(look.rgb[c])) * of[c]));
        }
        look.texture = -1;
    }
    return plain;
}

}  // namespace hil::sim::frame
