// Inner loops that compute the channels of visible surfaces. Contract: resolve.hpp.
#include "ambient_occlusion.hpp"
#include "flat_faces.hpp"
#include "lane_exp.hpp"
#include "resolve.hpp"
#include "sky.hpp"
#include "surface_colour.hpp"

namespace hil::sim::frame::HIL_ISA {

namespace {

HIL_INLINE Vec<F> rays_of(const RayTable &rays, int row, int column, int block) {
    if (rays.projection == Projection::kTable) {
        const float *xyz = rays.xyz.data() + 48 * block;
        return {load<F>(xyz), load<F>(xyz + 16), load<F>(xyz + 32)};
    }
    return {load<F>(rays.x.data() + 16 * column), load<F>(rays.y.data() + 16 * row), splat<F>(1)};
}

// Outward direction of a primitive at a point of its surface, in its local frame; any length.
HIL_INLINE Vec<F> gradient(const DrawnGeom &g, const Vec<F> &p) {
    const F zero = splat<F>(0), one = splat<F>(1);
    switch (g.shape) {
        case Shape::kBox: {
            // The face nearest to the point, which may be slightly inside or outside.
            const F x = abs(p.x) - g.half[0], y = abs(p.y) - g.half[1], z = abs(p.z) - g.half[2];
            const I is_x = (x >= y) & (x >= z), is_y = ~is_x & (y >= z), is_z = ~is_x & ~is_y;
            return {select(is_x, copysign(one, p.x), zero), select(is_y, copysign(one, p.y), zero),
                    select(is_z, copysign(one, p.z), zero)};
        }
        case Shape::kCylinder: {
            const F end = abs(abs(p.z) - g.half[2]), side = abs(sqrt(p.x * p.x + p.y * p.y) - g.radius);
            const I cap = end < side;
            return {select(cap, zero, p.x), select(cap, zero, p.y), select(cap, copysign(one, p.z), zero)};
        }
        case Shape::kCapsule: {
            const F end = splat<F>(g.half[2]);
            return {p.x, p.y, p.z - min(max(p.z, -end), end)};
        }
        case Shape::kPlane: return {zero, zero, one};
        default: return p;
    }
}

struct MeshPoint {
    Vec<F> flat, smooth;  // normals in the local frame; smooth: set if the mesh has corner normals
    MeshTexture texture;
};

enum MeshLook : unsigned { kSmooth = 1, kTextured = 2, kRelief = 4 };  // interpolated parts of a MeshPoint

HIL_INLINE void put_at(Vec<F> &to, const I &here, float x, float y, float z) {
    to = {select(here, splat<F>(x), to.x), select(here, splat<F>(y), to.y), select(here, splat<F>(z), to.z)};
}

// Unit direction in the plane of a triangle in which its texture coordinate grows.
HIL_INLINE void put_gradient(const float *row, const I &here, Vec<F> &to) {
    const float length2 = row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
    const float scale = length2 > 1e-20f ? 1.0f / __builtin_sqrtf(length2) : 0.0f;
    put_at(to, here, row[0] * scale, row[1] * scale, row[2] * scale);
}

// Normal of each pixel's triangle and the parts named by `look`, face by face.
HIL_INLINE MeshPoint mesh_point(const DrawnGeom &g, const std::int32_t *triangles, const I &mask, const Vec<F> &p, unsigned look) {
    const F zero = splat<F>(0);
    const Vec<F> none{zero, zero, zero};
    const Mesh &mesh = *g.mesh;
    I index = select(mask, load<I>(triangles), splat<I>(0));
    if (mesh.corner_normal.empty()) index = gather(mesh.face.data(), index);
    std::int32_t faces[16];
    store(faces, index);
    MeshPoint found{none, none, {zero, zero, none, none}};
    for (unsigned lanes = bits(mask); lanes != 0;) {
        const std::int32_t triangle = faces[__builtin_ctz(lanes)];
        const I here = mask & (index == splat<I>(triangle));
        lanes &= ~bits(here);
        const Facet &facet = mesh.facet.data()[triangle];
        const auto put_value = [&](F &to, const float *row) {
            to = select(here, p.x * row[0] + p.y * row[1] + p.z * row[2] + row[3], to);
        };
        put_at(found.flat, here, facet.normal[0], facet.normal[1], facet.normal[2]);
        if (look & kTextured) {
            put_value(found.texture.u, facet.u);
            put_value(found.texture.v, facet.v);
        }
        if (look & kSmooth) {
            put_value(found.smooth.x, facet.smooth[0]);
            put_value(found.smooth.y, facet.smooth[1]);
            put_value(found.smooth.z, facet.smooth[2]);
        }
        if (look & kRelief) {
            put_gradient(facet.u, here, found.texture.along_u);
            put_gradient(facet.v, here, found.texture.along_v);
        }
    }
    return found;
}

// Attenuates the light of a block by haze and adds the light of the air. Not inlined, because its registers would be
// lost to the pictures in clear air, which are most.
__attribute__((noinline)) void put_haze(const ResolveJob &job, const Vec<F> &d, const F &t, const I &seen, Rgb &c) {
    const Daylight &light = *job.light;
    const F length = length_of(d);
    const F up = (d.x * job.up_C[0] + d.y * job.up_C[1] + d.z * job.up_C[2]) / length;
    const F range = select(seen, t * length, light.haze_m / max(up, splat<F>(1e-3f)));
    const F through = exp_of_minus(range * light.extinction_per_m);
    const auto mixed = [&](const F &x, int i) { return light.air_rgb[i] + through * (x - light.air_rgb[i]); };
    c = {mixed(c.r, 0), mixed(c.g, 1), mixed(c.b, 2)};
}

HIL_INLINE Vec<F> unit(const Vec<F> &n) {
    const F scale = 1.0f / length_of(n);
    return {n.x * scale, n.y * scale, n.z * scale};
}

HIL_INLINE F fifth_power(const F &x) { return x * x * (x * x) * x; }

// Adds the mirror images of sun, sky and ground to the light `c` of a surface of colour `own`; `sun`: share of the sun's
// light that arrives, times the cosine of its incidence; `open`: share of the ambient light. Not inlined, as put_haze.
__attribute__((noinline)) void put_highlights(const ResolveJob &job, const Appearance &look, const Surface &s, const Vec<F> &normal,
                                              const Rgb &own, const F &sun, const F &open, Rgb &c) {
    const Daylight &light = *job.light;
    const F zero = splat<F>(0), one = splat<F>(1);
    const float gloss = look.shininess;
    const F inverse = splat<F>(-1) / length_of(s.d);
    const Vec<F> view{s.d.x * inverse, s.d.y * inverse, s.d.z * inverse};  // towards the camera
    const F facing = min(max(dot(normal, view), zero), one);
    const F twice = 2.0f * facing;
    const Vec<F> mirrored{twice * normal.x - view.x, twice * normal.y - view.y, twice * normal.z - view.z};
    const F up = mirrored.x * job.up_C[0] + mirrored.y * job.up_C[1] + mirrored.z * job.up_C[2];
    // A rough surface blurs the horizon.
    const F above = min(max(up * (0.5f / (1.05f - gloss)) + 0.5f, zero), one);
    const Rgb over = plain_sky(light, up);
    Vec<F> half{view.x + job.sun_C[0], view.y + job.sun_C[1], view.z + job.sun_C[2]};
    half = unit(half);
    const float exponent = 1024.0f * gloss * gloss * gloss;
    const F lobe = exp_of_minus((1.0f - dot(normal, half)) * exponent) * ((exponent + 8.0f) * 0.125f);
    const F at_view = fifth_power(1.0f - facing), at_sun = fifth_power(1.0f - min(max(dot(view, half), zero), one));
    const auto mirror = [&](const F &a, const F &colour, const F &sky_light, int i) {
        const F f0 = 0.08f * look.specular + look.metallic * (colour - 0.08f * look.specular);
        const F share = gloss * (f0 + (max(splat<F>(gloss), f0) - f0) * at_view);
        const F around = light.ground_rgb[i] + above * (sky_light - light.ground_rgb[i]);
        return a * (1.0f - share) * (1.0f - look.metallic) + around * share * open + sun * lobe * (f0 + (1.0f - f0) * at_sun) * light.sun_rgb[i];
    };
    c = {mirror(c.r, own.r, over.r, 0), mirror(c.g, own.g, over.g, 1), mirror(c.b, own.b, over.b, 2)};
}

// Turns unit normals in C by a texture of normals.
template <class Into>
HIL_INLINE Vec<F> relieved(const ResolveJob &job, const Texture &texture, const TexturePlace &place, const Surface &s,
                           const Vec<F> &normal, Into &&into_camera) {
    const Rgb texel = sample(texture, place, s, job.pixel_angle_rad, job.shading.filtering);
    const F ru = texel.r * 2.0f - 1.0f, rv = texel.g * 2.0f - 1.0f;
    const F rn = sqrt(max(1.0f - ru * ru - rv * rv, splat<F>(0.04f))), inverse = 1.0f / rn;
    const Vec<F> u = into_camera(place.along_u), v = into_camera(place.along_v);
    const F a = ru * inverse, b = rv * inverse;
    return unit({normal.x + a * u.x + b * v.x, normal.y + a * u.y + b * v.y, normal.z + a * u.z + b * v.z});
}

// Puts the colour of a geom into the lanes s.mask of block `at` of a run.
template <class Into>
HIL_INLINE void shade(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles, Vec<F> normal,
                      const MeshTexture *on_mesh, Into &&into_camera, Run &run, int at, SunTriangles &known) {
    const Daylight &light = *job.light;
    const Scenery &scenery = *job.scenery;
    const Appearance &look = scenery.geoms.data()[g.geom];
    const bool relief = job.shading.relief && look.relief >= 0, highlights = job.shading.highlights && look.specular > 0.0f;
    const Texture *texture = look.texture >= 0 ? scenery.textures.data() + look.texture : nullptr;
    const bool later = texture != nullptr && !job.shading.filtering && !highlights;  // the texel is the last factor
    Rgb c{splat<F>(decode(look.rgb[0])), splat<F>(decode(look.rgb[1])), splat<F>(decode(look.rgb[2]))};
    I texel = splat<I>(0);
    if (texture != nullptr || relief) {
        const TexturePlace place = place_on(g, look, s, texture != nullptr && texture->cube, on_mesh);
        if (later) {
            texel = nearest_texel(*texture, place, s, job.pixel_angle_rad);
        } else if (texture != nullptr) {
            const Rgb own = sample(*texture, place, s, job.pixel_angle_rad, job.shading.filtering);
            c = {c.r * own.r, c.g * own.g, c.b * own.b};
        }
        if (relief) normal = relieved(job, scenery.textures.data()[look.relief], place, s, normal, into_camera);
    }
    const F zero = splat<F>(0);
    F sun = normal.x * job.sun_C[0] + normal.y * job.sun_C[1] + normal.z * job.sun_C[2];
    const F up = normal.x * job.up_C[0] + normal.y * job.up_C[1] + normal.z * job.up_C[2];
    // Shading by the flat normal: an interpolated one may face the sun although the surface does not. Leaves let the
    // light through to their other side.
    const Vec<F> &flat = g.mask == nullptr ? s.normal : normal;
    const I faces = s.mask & (flat.x * job.sun_C[0] + flat.y * job.sun_C[1] + flat.z * job.sun_C[2] > zero);
    sun = select(faces, max(sun, zero), zero);
    if (job.shadows > 0 && any(faces)) sun = sun * sunlight(job, g, run.sun[at], triangles, faces, known);
    const F above = up * 0.5f + 0.5f;
    const F open = job.sky != nullptr ? ambient_share(job, s, normal) : splat<F>(1);
    const auto lit = [&](const F &a, int i) {
        const F ambient = (light.ground_rgb[i] + above * (light.sky_rgb[i] - light.ground_rgb[i])) * open;
        return a * (ambient + sun * light.sun_rgb[i] + look.emission);
    };
    Rgb seen{lit(c.r, 0), lit(c.g, 1), lit(c.b, 2)};
    if (highlights) put_highlights(job, look, s, normal, c, sun, open, seen);
    if (later) {
        put_later(run, at, s.mask, *texture, texel, seen);
    } else {
        put_now(run, at, s.mask, seen);
    }
}

HIL_INLINE void put_tone(const Shading &shading, Rgb &c) {
    const auto toned = [&](const F &x, int i) {
        const F light = x * shading.gain[i];
        if (!shading.filmic) return light;
        const F e = 0.723f * light;
        return e * (2.51f * e + 0.03f) / (e * (2.43f * e + 0.59f) + 0.14f);
    };
    c = {toned(c.r, 0), toned(c.g, 1), toned(c.b, 2)};
}

// Writes the lanes of one block to a row-major picture.
template <class T, class V>
HIL_INLINE void put(T *picture, int width, int x, int y, int columns, int rows, const V *lanes) {
    for (int r = 0; r < rows; ++r) {
        T *to = picture + (long)(y + r) * width + x;
        if (columns == 4) {
            for (int c = 0; c < 4; ++c) to[c] = (T)lanes[4 * r + c];
        } else {
            for (int c = 0; c < columns; ++c) to[c] = (T)lanes[4 * r + c];
        }
    }
}

// Writes one value to all pixels of a block that is four columns wide.
template <class T>
HIL_INLINE void put_one(T *picture, int width, int x, int y, int rows, int value) {
    const T four[4] = {(T)value, (T)value, (T)value, (T)value};
    for (int r = 0; r < rows; ++r) __builtin_memcpy(picture + (long)(y + r) * width + x, four, sizeof four);
}

HIL_INLINE void put3(float *picture, int width, int x, int y, int columns, int rows, const Vec<F> &lanes) {
    float *to = picture + 3 * ((long)y * width + x);
    if (columns == 4 && rows == 4) return store_triples(to, 3L * width, lanes);
    float all[48];
    store_triples(all, 12, lanes);
    for (int r = 0; r < rows; ++r) __builtin_memcpy(to + 3L * r * width, all + 12 * r, 3 * sizeof(float) * (unsigned long)columns);
}

HIL_INLINE void put_rgb(std::uint8_t *picture, int width, int x, int y, int columns, int rows, const I &packed) {
    std::uint8_t *to = picture + 3 * ((long)y * width + x);
    if (columns == 4 && rows == 4) return store_triples(to, 3L * width, packed);
    std::uint8_t all[48];
    store_triples(all, 12, packed);
    for (int r = 0; r < rows; ++r) __builtin_memcpy(to + 3L * r * width, all + 12 * r, (unsigned long)(3 * columns));
}

struct Place {  // of a block
    int row, column, block, x, y, columns, rows;
};

HIL_INLINE Place place_of(const VisibilityBuffer &b, int row, int column) {
    const int x = 4 * column, y = 4 * row;
    return {row, column, row * b.blocks_x + column, x, y, b.width - x < 4 ? b.width - x : 4, b.height - y < 4 ? b.height - y : 4};
}

// Channels that need no surface point.
HIL_INLINE void put_labels_and_depth(const ResolveJob &job, const Place &at, SunPlace &sun) {
    const VisibilityBuffer &b = *job.buffer;
    const ChannelOutputs &out = job.out;
    const std::int32_t *ids = b.geom.data() + 16 * at.block;
    const I id = load<I>(ids);
    const F t = load<F>(b.t.data() + 16 * at.block), inf = splat<F>(LaneTraits<F>::kInf);
    const I seen = id >= splat<I>(0);
    const Vec<F> d = rays_of(*job.rays, at.row, at.column, at.block);
    const auto put_lanes = [&](auto *picture, const auto &lanes) {
        if constexpr (sizeof *picture == 4) {
            if (at.columns == 4 && at.rows == 4) return store_rows(picture + (long)at.y * b.width + at.x, b.width, lanes);
        }
        ScalarOf<std::decay_t<decltype(lanes)>> values[16];
        store(values, lanes);
        put(picture, b.width, at.x, at.y, at.columns, at.rows, values);
    };
    if (job.shadows > 0 && any(seen)) place_in_sun(job, d, t, sun);
    if (out.geom) put_lanes(out.geom, id);
    if (out.depth) put_lanes(out.depth, select(seen, job.rays->projection == Projection::kTable ? t * d.z : t, inf));
    if (out.range) put_lanes(out.range, select(seen, t * length_of(d), inf));
    if (!out.segmentation && !out.material && !out.instance) return;
    if (at.columns == 4 && !any(id != splat<I>(ids[0]))) {
        const bool nothing = ids[0] < 0;
        const Geom *g = job.geoms + (nothing ? 0 : ids[0]);
        if (out.segmentation) put_one(out.segmentation, b.width, at.x, at.y, at.rows, nothing ? 0 : g->class_id);
        if (out.material) put_one(out.material, b.width, at.x, at.y, at.rows, nothing ? 0 : g->surface);
        if (out.instance) put_one(out.instance, b.width, at.x, at.y, at.rows, nothing ? 0 : g->instance);
        return;
    }
    I labels = splat<I>(0), instance = splat<I>(0);  // labels: class, and surface from bit 8
    for (unsigned left = bits(seen); left != 0;) {
        const std::int32_t geom = ids[__builtin_ctz(left)];
        const I here = id == splat<I>(geom);
        left &= ~bits(here);
        const Geom &g = job.geoms[geom];
        labels = select(here, splat<I>(g.class_id | g.surface << 8), labels);
        instance = select(here, splat<I>(g.instance), instance);
    }
    if (out.segmentation) put_lanes(out.segmentation, labels);
    if (out.material) put_lanes(out.material, shift_right(labels, 8));
    if (out.instance) put_lanes(out.instance, instance);
}

// Channels that need the surface of each geom of a block: radial velocity, normals, and the colour of block `k` of a run.
HIL_INLINE void put_surfaces(const ResolveJob &job, const Place &at, FlatFaces &faces, SunTriangles &known, Run &run, int k) {
    const VisibilityBuffer &b = *job.buffer;
    const ChannelOutputs &out = job.out;
    const F zero = splat<F>(0);
    const bool wants_normal = out.normal || out.rgb;
    const std::int32_t *ids = b.geom.data() + 16 * at.block, *triangles = b.triangle.data() + 16 * at.block;
    const I id = load<I>(ids);
    const F t = load<F>(b.t.data() + 16 * at.block);
    const Vec<F> d = rays_of(*job.rays, at.row, at.column, at.block);
    const F per_length = out.radial_velocity ? 1.0f / length_of(d) : zero;  // one for all geoms of the block
    Vec<F> normals{zero, zero, zero};
    F velocity = zero;
    run.colour[k] = {zero, zero, zero};
    const unsigned wanted_lanes = job.lanes == nullptr ? 0xffffu : job.lanes[at.block];
    for (unsigned left = bits(id >= splat<I>(0)) & wanted_lanes; left != 0;) {
        const std::int32_t geom = ids[__builtin_ctz(left)];
        const DrawnGeom &g = job.drawn[job.drawn_of_geom[geom]];
        Surface s;
        s.mask = id == splat<I>(geom);
        left &= ~bits(s.mask);
        s.t = t;
        s.d = d;
        if (out.radial_velocity) {
            const F along = (d.x * g.velocity_C[0] + d.y * g.velocity_C[1] + d.z * g.velocity_C[2]) * per_length;
            velocity = select(s.mask, along, velocity);
        }
        if (!wants_normal) continue;
        const bool flat = out.rgb && is_flat(job, g);
        if (flat) put_flat(job, g, s, triangles, faces, run, k, known);
        if (flat && !out.normal) continue;
        const float *m = g.m;
        s.local = local_point(g, s);
        MeshPoint on_mesh;
        unsigned wanted = 0;
        if (g.shape == Shape::kMesh) {
            if (out.rgb && !flat) {
                const Appearance &look = job.scenery->geoms.data()[geom];
                const bool relief = job.shading.relief && look.relief >= 0;
                if (!g.mesh->uv.empty() && (look.texture >= 0 || relief)) wanted = relief ? kTextured | kRelief : kTextured;
                if (!g.mesh->corner_normal.empty()) wanted |= kSmooth;
            }
            on_mesh = mesh_point(g, triangles, s.mask, s.local, wanted);
            s.gradient = on_mesh.flat;
        } else {
            s.gradient = gradient(g, s.local);
        }
        const auto into_camera = [&](const Vec<F> &q, bool is_unit_already) {
            // Normals transform by the transpose of the points' matrix, which includes an ellipsoid's scaling.
            const Vec<F> n{q.x * m[0] + q.y * m[3] + q.z * m[6], q.x * m[1] + q.y * m[4] + q.z * m[7],
                           q.x * m[2] + q.y * m[5] + q.z * m[8]};
            return is_unit_already ? n : unit(n);
        };
        const auto facing = [&](const Vec<F> &n, const I &away) {
            return Vec<F>{select(away, -n.x, n.x), select(away, -n.y, n.y), select(away, -n.z, n.z)};
        };
        const bool is_unit = g.shape == Shape::kBox || g.shape == Shape::kPlane || g.shape == Shape::kMesh;
        const Vec<F> outward = into_camera(s.gradient, is_unit);
        const I away = dot(outward, d) > zero;  // seen from inside, or the back of a triangle
        s.normal = facing(outward, away);
        if (out.normal) {
            normals = {select(s.mask, s.normal.x, normals.x), select(s.mask, s.normal.y, normals.y),
                       select(s.mask, s.normal.z, normals.z)};
        }
        if (!out.rgb || flat) continue;
        Vec<F> shading = s.normal;
        // The normals of leaf cards are those of the crown, seen from either side.
        if (wanted & kSmooth) shading = into_camera(on_mesh.smooth, false);
        if (wanted & kSmooth && g.mask == nullptr) shading = facing(shading, away);
        shade(job, g, s, triangles, shading, wanted & kTextured ? &on_mesh.texture : nullptr,
              [&](const Vec<F> &q) { return into_camera(q, true); }, run, k, known);
    }
    if (out.radial_velocity) {
        float lanes[16];
        store(lanes, velocity);
        put(out.radial_velocity, b.width, at.x, at.y, at.columns, at.rows, lanes);
    }
    if (out.normal) put3(out.normal, b.width, at.x, at.y, at.columns, at.rows, normals);
}

// Colour of the sky, haze, tone curve and code.
HIL_INLINE void put_colour(const ResolveJob &job, const Place &at, Rgb colour) {
    const VisibilityBuffer &b = *job.buffer;
    const float *gain = job.shading.gain;
    const I seen = load<I>(b.geom.data() + 16 * at.block) >= splat<I>(0);
    const Vec<F> d = rays_of(*job.rays, at.row, at.column, at.block);
    put_surroundings(job, b.geom.data() + 16 * at.block, d, load<F>(b.t.data() + 16 * at.block), seen, colour);
    if (job.light->extinction_per_m > 0.0f) put_haze(job, d, load<F>(b.t.data() + 16 * at.block), seen, colour);
    if (job.shading.filmic || gain[0] != 1.0f || gain[1] != 1.0f || gain[2] != 1.0f) put_tone(job.shading, colour);
    put_rgb(job.out.rgb, b.width, at.x, at.y, at.columns, at.rows, encode(colour));
}

void resolve(const ResolveJob &job) {
    const VisibilityBuffer &b = *job.buffer;
    const ChannelOutputs &out = job.out;
    FlatFaces faces;
    SunTriangles known;
    Run run;
    for (int row = job.row0; row < job.row1; ++row) {
        for (int next = 0; next < b.blocks_x;) {
            int columns[kRun], count = 0;
            for (; next < b.blocks_x && count < kRun; ++next) {
                if (job.lanes == nullptr || job.lanes[row * b.blocks_x + next] != 0) columns[count++] = next;
            }
            for (int k = 0; k < count; ++k) put_labels_and_depth(job, place_of(b, row, columns[k]), run.sun[k]);
            if (!out.rgb && !out.normal && !out.radial_velocity) continue;
            for (int k = 0; k < count; ++k) put_surfaces(job, place_of(b, row, columns[k]), faces, known, run, k);
            if (!out.rgb) continue;
            put_texels(run);
            for (int k = 0; k < count; ++k) put_colour(job, place_of(b, row, columns[k]), run.colour[k]);
        }
    }
}

}  // namespace

extern const ResolveKernels resolve_kernels_of_isa;
const ResolveKernels resolve_kernels_of_isa{resolve};

}  // namespace hil::sim::frame::HIL_ISA
