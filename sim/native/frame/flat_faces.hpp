// Colour of flat faces with one light: planes, boxes and meshes without corner normals, with the nearest texel and without
// highlights, relief and ambient occlusion. For use in *.isa.cpp only.
//
// All points of a face have one normal, thus one light, and their texture coordinates are affine in the point. Both are
// computed once for a face and a picture. A table keeps them for the next blocks; it does not change the picture, because
// a face's entry depends on the face and the job alone.
#pragma once

#include "sunlight.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

struct FlatFace {
    std::int32_t geom = -1, id = -1;
    const Texture *texture = nullptr;
    float u[4], v[4];          // texture coordinates of the point p in C: u[0..2] . p + u[3]
    float normal[3];           // unit, in C
    float texels;              // 0.7 times those that a pixel covers across, at a distance of 1 m
    float ambient[3], sun[3];  // light that leaves the face, per unit of its texture: of sky, ground and itself; of the sun
    bool sunlit;
};

struct FlatFaces {
    static constexpr unsigned kEntries = 128;
    FlatFace entry[kEntries];
};

HIL_INLINE bool is_flat(const ResolveJob &job, const DrawnGeom &g) {
    if (g.shape == Shape::kMesh ? !g.mesh->corner_normal.empty() : g.shape != Shape::kPlane && g.shape != Shape::kBox) return false;
    const Appearance &look = job.scenery->geoms.data()[g.geom];
    if (job.sky != nullptr || (job.shading.highlights && look.specular > 0.0f) || (job.shading.relief && look.relief >= 0)) return false;
    return look.texture < 0 || !(job.shading.filtering || job.scenery->textures.data()[look.texture].cube);
}

// Fills in a face: of a box 2 axis + (1 on the negative side), of a mesh the triangle.
HIL_NOINLINE void set_up_face(const ResolveJob &job, const DrawnGeom &g, std::int32_t id, FlatFace &face) {
    const Daylight &light = *job.light;
    const Appearance &look = job.scenery->geoms.data()[g.geom];
    face.geom = g.geom;
    face.id = id;
    const Facet *facet = g.shape == Shape::kMesh ? g.mesh->facet.data() + id : nullptr;
    float n[4] = {0, 0, 0, 0};  // as Facet::normal
    if (g.shape == Shape::kPlane) {
        n[2] = 1.0f;
    } else if (g.shape == Shape::kBox) {
        n[id >> 1] = id & 1 ? -1.0f : 1.0f;
        n[3] = -g.half[id >> 1];
    } else {
        for (int i = 0; i < 4; ++i) n[i] = facet->normal[i];
    }
    const auto in_camera = [&](const float *q, int i) { return q[0] * g.m[i] + q[1] * g.m[3 + i] + q[2] * g.m[6 + i]; };
    const bool behind = n[0] * g.o[0] + n[1] * g.o[1] + n[2] * g.o[2] + n[3] < 0.0f;  // the camera sees the back
    float sun = 0.0f, up = 0.0f;
    for (int i = 0; i < 3; ++i) {
        face.normal[i] = behind ? -in_camera(n, i) : in_camera(n, i);
        sun += face.normal[i] * job.sun_C[i];
        up += face.normal[i] * job.up_C[i];
    }
    face.sunlit = sun > 0.0f;
    const float above = up * 0.5f + 0.5f;
    for (int i = 0; i < 3; ++i) {
        const float own = decode(look.rgb[i]);
        face.ambient[i] = own * (light.ground_rgb[i] + above * (light.sky_rgb[i] - light.ground_rgb[i]) + look.emission);
        face.sun[i] = face.sunlit ? own * (sun * light.sun_rgb[i]) : 0.0f;
    }
    face.texture = look.texture < 0 ? nullptr : job.scenery->textures.data() + look.texture;
    if (face.texture == nullptr) return;
    float along[2][3] = {}, start[2], per_m[2];  // growth of the coordinates, in the local frame
    if (g.shape == Shape::kMesh && !g.mesh->uv.empty()) {
        for (int k = 0; k < 2; ++k) {
            const float *row = k == 0 ? facet->u : facet->v;
            for (int i = 0; i < 3; ++i) along[k][i] = row[i] * look.repeat[k];
            start[k] = row[3] * look.repeat[k];
            per_m[k] = look.repeat[k] * g.mesh->uv_per_m;
        }
    } else {
        float edge[3];
        edges_of(g, edge);
        const float x = __builtin_fabsf(n[0]), y = __builtin_fabsf(n[1]), z = __builtin_fabsf(n[2]);
        const bool along_z = z >= x && z >= y, along_x = !along_z && x >= y;
        const int axis[2] = {along_x ? 1 : 0, along_z ? 1 : 2};
        for (int k = 0; k < 2; ++k) {
            per_m[k] = look.per_metre ? 0.5f * look.repeat[k] : per_edge(edge[axis[k]]) * look.repeat[k];
            along[k][axis[k]] = per_m[k];
            const float half = edge[axis[k]] < 1e6f ? 0.5f * edge[axis[k]] : 0.0f;
            start[k] = (k == 0 ? half : -half) * per_m[k];
        }
    }
    for (int k = 0; k < 2; ++k) {
        float *const to = k == 0 ? face.u : face.v;
        for (int i = 0; i < 3; ++i) to[i] = in_camera(along[k], i);
        to[3] = start[k] + (along[k][0] * g.o[0] + along[k][1] * g.o[1] + along[k][2] * g.o[2]);
    }
    const float across = per_m[0] * (float)face.texture->width, down = per_m[1] * (float)face.texture->height;
    face.texels = 0.7f * job.pixel_angle_rad * (across > down ? across : down);
}

HIL_INLINE const FlatFace &face_of(const ResolveJob &job, const DrawnGeom &g, std::int32_t id, FlatFaces &faces) {
    FlatFace &face = faces.entry[((unsigned)g.geom * 5u + (unsigned)id) % FlatFaces::kEntries];
    if (face.geom != g.geom || face.id != id) set_up_face(job, g, id, face);
    return face;
}

// Calls f(face, lanes) for each face of a geom under the lanes of s.mask.
template <class Function>
HIL_INLINE void each_face(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles,
                          FlatFaces &faces, Function &&f) {
    if (g.shape == Shape::kPlane) return f(face_of(job, g, 0, faces), s.mask);
    I id;
    unsigned lanes = bits(s.mask);
    if (g.shape == Shape::kBox) {
        // The face nearest to the point, which may be slightly inside or outside.
        const F zero = splat<F>(0);
        const Vec<F> p = local_point(g, s);
        const F x = abs(p.x) - g.half[0], y = abs(p.y) - g.half[1], z = abs(p.z) - g.half[2];
        const I is_x = (x >= y) & (x >= z), is_y = ~is_x & (y >= z);
        const F along = select(is_x, p.x, select(is_y, p.y, p.z));
        id = select(is_x, splat<I>(0), select(is_y, splat<I>(2), splat<I>(4))) + ((along < zero) & splat<I>(1));
    } else {
        const std::int32_t triangle = triangles[__builtin_ctz(lanes)];
        const I index = select(s.mask, load<I>(triangles), splat<I>(triangle));
        if (!any(index != splat<I>(triangle))) return f(face_of(job, g, g.mesh->face.data()[triangle], faces), s.mask);
        id = gather(g.mesh->face.data(), index);
    }
    std::int32_t ids[16];
    store(ids, id);
    while (lanes != 0) {
        const std::int32_t one = ids[__builtin_ctz(lanes)];
        const I here = s.mask & (id == splat<I>(one));
        lanes &= ~bits(here);
        f(face_of(job, g, one, faces), here);
    }
}

// Puts the colour of a geom for which is_flat holds into the lanes s.mask of block `at` of a run.
HIL_INLINE void put_flat(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles,
                         FlatFaces &faces, Run &run, int at, SunTriangles &known) {
    F sun = splat<F>(1);
    if (job.shadows > 0) {
        I sunlit = splat<I>(0);
        each_face(job, g, s, triangles, faces, [&](const FlatFace &face, const I &here) {
            if (face.sunlit) sunlit |= here;
        });
        if (any(sunlit)) sun = sunlight(job, g, run.sun[at], triangles, sunlit, known);
    }
    const Vec<F> p{s.d.x * s.t, s.d.y * s.t, s.d.z * s.t};
    each_face(job, g, s, triangles, faces, [&](const FlatFace &face, const I &here) {
        const auto light = [&](int i) { return sun * face.sun[i] + face.ambient[i]; };
        const Rgb c{light(0), light(1), light(2)};
        if (face.texture == nullptr) return put_now(run, at, here, c);
        const auto coordinate = [&](const float *k) { return within_copy(p.x * k[0] + p.y * k[1] + p.z * k[2] + k[3]); };
        // As `footprint`, with one division: range / facing = t d . d / (normal . d).
        const F length2 = dot(s.d, s.d), towards = abs(s.d.x * face.normal[0] + s.d.y * face.normal[1] + s.d.z * face.normal[2]);
        const F covered = s.t * length2 * face.texels / max(towards, sqrt(length2) * 0.15f);
        const I texel = nearest_texel(*face.texture, coordinate(face.u), coordinate(face.v), covered, splat<I>(0), here);
        put_later(run, at, here, *face.texture, texel, c);
    });
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
