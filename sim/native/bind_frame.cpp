// sim._kernels.Geometry, Scenery, SunShadows, Picture: the frame kernels for Python. Contracts: frame/*.hpp.
#include <nanobind/stl/optional.h>

#include <cmath>
#include <memory>

#include "bind_arrays.hpp"
#include "frame/picture.hpp"
#include "frame/supersample.hpp"
#include "srgb.hpp"

namespace fr = hil::sim::frame;

namespace {

using Rgb = std::array<float, 3>;

fr::RasterCamera camera_of(const Vec3 &p_WC, const Mat3 &R_WC, const Vec3 &v_W) {
    fr::RasterCamera camera{};
    std::copy(p_WC.begin(), p_WC.end(), camera.p_WC);
    std::copy(R_WC.begin(), R_WC.end(), camera.R_WC);
    std::copy(v_W.begin(), v_W.end(), camera.v_W);
    return camera;
}

void set(float *to, const Rgb &from) { std::copy(from.begin(), from.end(), to); }

// Returns the data of a requested channel, else null. Throws nb::type_error for a wrong type, shape or layout.
template <class T>
T *channel(const nb::dict &out, const char *name, int height, int width, int depth) {
    if (!out.contains(name)) return nullptr;
    const std::string wanted = std::string("channel '") + name + "' needs a writable, C-contiguous array (" +
                               std::to_string(height) + ", " + std::to_string(width) +
                               (depth > 1 ? ", " + std::to_string(depth) : "") + ") of its type";
    nb::ndarray<T, nb::c_contig, nb::device::cpu> array;
    if (!nb::try_cast<nb::ndarray<T, nb::c_contig, nb::device::cpu>>(out[name], array, false)) {
        throw nb::type_error(wanted.c_str());
    }
    const bool fits = array.ndim() == (depth > 1 ? 3u : 2u) && array.shape(0) == static_cast<std::size_t>(height) &&
                      array.shape(1) == static_cast<std::size_t>(width) &&
                      (depth == 1 || array.shape(2) == static_cast<std::size_t>(depth));
    if (!fits) throw nb::type_error(wanted.c_str());
    return array.data();
}

int add_texture(fr::Scenery &scenery, const std::vector<In<std::uint8_t, -1, -1, 3>> &levels, bool cube, bool linear) {
    fr::Texture t;
    t.cube = cube;
    std::int32_t code[256];  // sRGB (IEC 61966-2-1) to ten bits of the square root of linear light
    for (int i = 0; i < 256; ++i) {
        code[i] = static_cast<std::int32_t>(std::lround(1023.0 * std::sqrt(linear ? i / 255.0 : hil::sim::srgb_to_linear(i / 255.0))));
    }
    if (levels.empty() || levels.size() > 16) throw std::invalid_argument("a texture needs 1 to 16 levels");
    for (const auto &level : levels) {
        const auto h = level.shape(0), w = level.shape(1);
        if (w > 4096 || h > 6 * 4096)
            throw std::invalid_argument("a texture must have at most 4096 texels along each edge");
        if (w < 4 || h < 4 || w % 4 != 0 || h % 4 != 0)
            throw std::invalid_argument("each edge of a texture level must be a multiple of 4 texels");
        t.offset[t.levels++] = static_cast<std::int32_t>(t.texel.size());
        for (std::size_t i = 0; i < w * h; ++i) {
            const std::size_t square = i / 16, y = square / (w / 4) * 4 + i % 16 / 4, x = square % (w / 4) * 4 + i % 4;
            const std::uint8_t *p = level.data() + 3 * (y * w + x);
            t.texel.push_back(code[p[0]] | code[p[1]] << 10 | code[p[2]] << 20);
        }
    }
    t.width = static_cast<int>(levels[0].shape(1));
    t.height = static_cast<int>(levels[0].shape(0));
    const int face = cube ? t.width : t.height;
    const auto power = [](int n) { return n > 0 && (n & (n - 1)) == 0; };
    if (!power(t.width) || !power(face) || (cube && t.height != 6 * t.width)) {
        throw std::invalid_argument("edges of a texture must be powers of two; a cube has six square faces");
    }
    for (int k = 0; k < t.levels; ++k) {
        const int w = t.width >> k, h = (face >> k) * (cube ? 6 : 1);
        const auto at = static_cast<std::size_t>(k);
        if (levels[at].shape(1) != static_cast<std::size_t>(w) || levels[at].shape(0) != static_cast<std::size_t>(h)) {
            throw std::invalid_argument("each level of a texture must be half the size of the previous one");
        }
    }
    scenery.textures.push_back(std::move(t));
    return static_cast<int>(scenery.textures.size()) - 1;
}

}  // namespace

void bind_frame(nb::module_ &m) {
    m.def("frame_isa", [] { return std::string(fr::isa_name(fr::best_isa())); },
          "Return the instruction set of the frame kernels on this CPU: base, avx2 or avx512. HIL_ISA can lower it.");

    m.def(
        "mean_of_four",
        [](const In<std::uint8_t, -1, -1, 3> &fine, const Out<std::uint8_t, -1, -1, 3> &out) {
            if (fine.shape(0) != 2 * out.shape(0) || fine.shape(1) != 2 * out.shape(1)) {
                throw std::invalid_argument("the picture to average must be twice as wide and twice as high");
            }
            fr::mean_of_four(fine.data(), static_cast<int>(out.shape(1)), static_cast<int>(out.shape(0)), out.data());
        },
        "fine"_a.noconvert(), "out"_a.noconvert(), "Write the mean of 2 x 2 pixels in linear light (frame/supersample.hpp).");

    nb::class_<fr::Geometry>(m, "Geometry", "Geoms, meshes and the trees over them (frame/geometry.hpp).")
        .def(nb::init<>())
        .def(
            "add_mesh",
            [](fr::Geometry &g, const In<float, -1, 3> &vertex, const In<std::int32_t, -1, 3> &triangle,
               const std::optional<In<float, -1, 3, 2>> &uv, const std::optional<In<float, -1, 3, 3>> &normal) {
                if ((uv && uv->shape(0) != triangle.shape(0)) || (normal && normal->shape(0) != triangle.shape(0))) {
                    throw std::invalid_argument("uv and corner_normal need a row for each triangle");
                }
                nb::gil_scoped_release free;
                return g.add_mesh(vertex.data(), vertex.shape(0), triangle.data(), triangle.shape(0),
                                  uv ? uv->data() : nullptr, normal ? normal->data() : nullptr);
            },
            "vertex"_a, "triangle"_a, "uv"_a.none(), "corner_normal"_a.none())
        .def(
            "add_mask",
            [](fr::Geometry &g, const In<std::uint8_t, -1, -1> &opaque) {
                return g.add_mask(opaque.data(), opaque.shape(0), opaque.shape(1));
            },
            "opaque"_a, "Add the mask of meshes with holes; (height, width), 0 is a hole.")
        .def(
            "add_geom",
            [](fr::Geometry &g, int shape, const Vec3 &size, const Vec3 &p_WG, const Mat3 &R_WG, int mesh, bool moving,
               bool visible, std::uint8_t class_id, std::uint16_t instance, std::uint8_t surface, int mask) {
                fr::Geom geom{};
                const bool known = shape == 0 || (shape >= 2 && shape <= 7);
                if (!known) throw std::invalid_argument("shape must be 0 or 2 to 7, as in MuJoCo's mjtGeom");
                geom.shape = static_cast<fr::Shape>(shape);
                std::copy(size.begin(), size.end(), geom.size);
                std::copy(p_WG.begin(), p_WG.end(), geom.p_WG);
                std::copy(R_WG.begin(), R_WG.end(), geom.R_WG);
                geom.mesh = mesh;
                geom.mask = mask;
                geom.moving = moving;
                geom.visible = visible;
                geom.class_id = class_id;
                geom.instance = instance;
                geom.surface = surface;
                return g.add_geom(geom);
            },
            "shape"_a, "size"_a, "p_WG"_a, "R_WG"_a, "mesh"_a, "moving"_a, "visible"_a, "class_id"_a, "instance"_a,
            "surface"_a, "mask"_a = -1, "Add a geom. Shapes have the numbers of MuJoCo's mjtGeom, and its sizes.")
        .def("finish", &fr::Geometry::finish, nb::call_guard<nb::gil_scoped_release>(),
             "Build the tree of static geoms. Call once, after the last geom.")
        .def(
            "move",
            [](fr::Geometry &g, const In<std::int32_t, -1> &geoms, const In<double, -1, 3> &p,
               const In<double, -1, 3, 3> &R, const In<double, -1, 3> &v, const In<double, -1, 3> &w) {
                const std::size_t n = geoms.shape(0);
                if (p.shape(0) != n || R.shape(0) != n || v.shape(0) != n || w.shape(0) != n) {
                    throw std::invalid_argument("geoms, poses and velocities must have the same length");
                }
                for (std::size_t i = 0; i < n; ++i) {
                    const int geom = geoms.data()[i];
                    if (geom < 0 || static_cast<std::size_t>(geom) >= g.geoms().size()) {
                        throw std::out_of_range("a geom index is out of range");
                    }
                    g.move(geom, p.data() + 3 * i, R.data() + 9 * i, v.data() + 3 * i, w.data() + 3 * i);
                }
            },
            "geoms"_a, "p_WG"_a, "R_WG"_a, "v_WG_W"_a, "w_WG_W"_a, "Set poses and velocities of moving geoms.")
        .def_prop_ro("version", &fr::Geometry::version, "Number of changes of poses.");

    nb::class_<fr::Scenery>(m, "Scenery", "Colours and textures (frame/scenery.hpp).")
        .def(nb::init<>())
        .def("add_texture", &add_texture, "levels"_a, "cube"_a, "linear"_a = false,
             "Add a pyramid of images. `linear`: of normals; else sRGB colours.")
        .def(
            "add_geom",
            [](fr::Scenery &s, const Rgb &rgb, float emission, int texture, float repeat_u, float repeat_v, bool per_metre,
               float specular, float shininess, float metallic, int relief) {
                if (std::max(texture, relief) >= static_cast<int>(s.textures.size()))
                    throw std::invalid_argument("texture index is out of range");
                fr::Appearance a;
                set(a.rgb, rgb);
                a.emission = emission;
                a.texture = texture;
                a.repeat[0] = repeat_u, a.repeat[1] = repeat_v;
                a.per_metre = per_metre;
                a.specular = specular, a.shininess = shininess, a.metallic = metallic;
                a.relief = relief;
                s.geoms.push_back(a);
            },
            "rgb"_a, "emission"_a, "texture"_a, "repeat_u"_a, "repeat_v"_a, "per_metre"_a,
            "specular"_a = 0.0f, "shininess"_a = 0.0f, "metallic"_a = 0.0f, "relief"_a = -1)
        .def("without_textures", &fr::without_textures, "Return a copy with each texture replaced by its mean colour.");

    nb::class_<fr::Shading>(m, "Shading", "Parts of the colour that cost time, and the camera's response (frame/scenery.hpp).")
        .def(
            "__init__",
            [](fr::Shading *self, bool filtering, bool highlights, bool relief, bool filmic, const Rgb &gain) {
                new (self) fr::Shading{filtering, highlights, relief, filmic, {gain[0], gain[1], gain[2]}};
            },
            "filtering"_a = false, "highlights"_a = false, "relief"_a = false, "filmic"_a = false,
            "gain"_a = Rgb{1.0f, 1.0f, 1.0f});

    nb::class_<fr::Daylight>(m, "Daylight", "Sun, sky and haze in W; linear colours (frame/scenery.hpp).")
        .def(
            "__init__",
            [](fr::Daylight *self, const Rgb &sun_W, const Rgb &sun, const Rgb &sky, const Rgb &ground, const Rgb &zenith,
               const Rgb &horizon, const Rgb &air, float extinction, float haze, float clouds) {
                new (self) fr::Daylight();
                set(self->sun_W, sun_W);
                set(self->sun_rgb, sun);
                set(self->sky_rgb, sky);
                set(self->ground_rgb, ground);
                set(self->zenith_rgb, zenith);
                set(self->horizon_rgb, horizon);
                set(self->air_rgb, air);
                self->extinction_per_m = extinction;
                self->haze_m = haze;
                self->clouds = clouds;
            },
            "sun_W"_a, "sun_rgb"_a, "sky_rgb"_a, "ground_rgb"_a, "zenith_rgb"_a, "horizon_rgb"_a, "air_rgb"_a,
            "extinction_per_m"_a, "haze_m"_a, "clouds"_a = -1.0f);

    nb::class_<fr::SunShadows>(m, "SunShadows", "Shadow maps of the sun (frame/picture.hpp).")
        .def(
            "__init__",
            [](fr::SunShadows *self, const fr::Geometry &geometry, const Rgb &sun_W, int resolution, const std::string &isa) {
                const fr::Isa set = fr::isa_by_name(isa);
                nb::gil_scoped_release free;
                new (self) fr::SunShadows(geometry, sun_W.data(), resolution, set);
            },
            "geometry"_a, "sun_W"_a, "resolution"_a, "isa"_a = "", nb::keep_alive<1, 2>())
        .def(
            "update",
            [](fr::SunShadows &self, bool reuse_static, const fr::Picture *picture, const Vec3 &p_WC, const Mat3 &R_WC) {
                const fr::RasterCamera camera = camera_of(p_WC, R_WC, {});
                nb::gil_scoped_release free;
                self.update(reuse_static, picture == nullptr ? nullptr : &picture->raster(), &camera);
            },
            "reuse_static"_a, "picture"_a.none(), "p_WC"_a, "R_WC"_a,
            "Draw what has moved: all, but for a picture of a pinhole camera at this pose at least the moving geoms whose "
            "shadows it can show.");

    nb::class_<fr::SkyVisibility>(m, "SkyVisibility", "Ambient occlusion of the static geoms (frame/sky_visibility.hpp).")
        .def(
            "__init__",
            [](fr::SkyVisibility *self, const fr::Geometry &geometry, double cell_m, double reach_m, int threads,
               const std::string &isa) {
                const fr::Isa set = fr::isa_by_name(isa);
                nb::gil_scoped_release free;
                new (self) fr::SkyVisibility(geometry, cell_m, reach_m, threads, set);
            },
            "geometry"_a, "cell_m"_a, "reach_m"_a, "threads"_a = 1, "isa"_a = "");

    nb::class_<fr::RasterCounts>(m, "RasterCounts")
        .def_ro("nodes", &fr::RasterCounts::nodes)
        .def_ro("geoms", &fr::RasterCounts::geoms);

    nb::class_<fr::Picture>(m, "Picture", "Camera that draws a Geometry (frame/picture.hpp).")
        .def(
            "__init__",
            [](fr::Picture *self, const fr::Geometry &geometry, const fr::Scenery &scenery, int width, int height, double fx,
               double fy, double cx, double cy, const std::string &isa, const fr::Shading &shading) {
                if (scenery.geoms.size() != geometry.geoms().size()) {
                    throw std::invalid_argument("the scenery needs an entry for every geom");
                }
                new (self) fr::Picture(std::make_unique<fr::Raster>(geometry, width, height, fr::Projection::kPinhole, fx, fy,
                                                                    cx, cy, fr::isa_by_name(isa)),
                                       scenery, shading);
            },
            "geometry"_a, "scenery"_a, "width"_a, "height"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a, "isa"_a = "",
            "shading"_a = fr::Shading{}, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def(
            "__init__",
            [](fr::Picture *self, const fr::Geometry &geometry, const fr::Scenery &scenery,
               const In<double, -1, -1, 3> &directions_C, const std::string &isa, const fr::Shading &shading) {
                if (scenery.geoms.size() != geometry.geoms().size()) {
                    throw std::invalid_argument("the scenery needs an entry for every geom");
                }
                new (self) fr::Picture(
                    std::make_unique<fr::Raster>(geometry, static_cast<int>(directions_C.shape(1)),
                                                 static_cast<int>(directions_C.shape(0)), directions_C.data(), fr::isa_by_name(isa)),
                    scenery, shading);
            },
            "geometry"_a, "scenery"_a, "directions_C"_a, "isa"_a = "", "shading"_a = fr::Shading{}, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def(
            "take",
            [](fr::Picture &self, const Vec3 &p_WC, const Mat3 &R_WC, const Vec3 &v_W, const fr::Daylight &light,
               const fr::SunShadows *shadows, const nb::dict &out, float near_t, float far_t, bool frustum, bool occlusion, bool backs,
               int row0, int row1, int threads, const fr::SkyVisibility *sky, fr::Picture *finer) {
                const fr::VisibilityBuffer &b = self.raster().buffer();
                fr::RasterOptions options;
                options.near_t = near_t;
                options.far_t = far_t;
                options.frustum_culling = frustum;
                options.occlusion_culling = occlusion;
                options.hide_backs = backs;
                fr::ChannelOutputs o;
                o.depth = channel<float>(out, "depth", b.height, b.width, 1);
                o.range = channel<float>(out, "range", b.height, b.width, 1);
                o.segmentation = channel<std::uint8_t>(out, "segmentation", b.height, b.width, 1);
                o.instance = channel<std::uint16_t>(out, "instance", b.height, b.width, 1);
                o.geom = channel<std::int32_t>(out, "geom", b.height, b.width, 1);
                o.normal = channel<float>(out, "normal", b.height, b.width, 3);
                o.radial_velocity = channel<float>(out, "radial_velocity", b.height, b.width, 1);
                o.material = channel<std::uint8_t>(out, "material", b.height, b.width, 1);
                o.rgb = channel<std::uint8_t>(out, "rgb", b.height, b.width, 3);
                const fr::RasterCamera camera = camera_of(p_WC, R_WC, v_W);
                nb::gil_scoped_release free;
                if (finer != nullptr) {
                    self.take_smooth(*finer, camera, options, light, shadows, sky, o, row0, row1, threads);
                } else {
                    self.take(camera, options, light, shadows, sky, o, row0, row1, threads);
                }
            },
            "p_WC"_a, "R_WC"_a, "v_WC_W"_a, "light"_a, "shadows"_a.none(), "out"_a, "near_t"_a, "far_t"_a, "frustum"_a,
            "occlusion"_a, "backs"_a, "row0"_a, "row1"_a, "threads"_a, "sky"_a.none() = nb::none(),
            "finer"_a.none() = nb::none(), "Draw the picture. `finer`: the same camera with twice the pixels, to smooth outlines.")
        .def_prop_ro("counts", [](const fr::Picture &p) { return p.raster().counts(); });
}
