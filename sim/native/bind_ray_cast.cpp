// sim._kernels.RayCaster: many rays against a Geometry at once. Contract: frame/ray_cast.hpp.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bind_arrays.hpp"
#include "frame/ray_cast.hpp"

using namespace hil::sim::frame;

namespace {

void cast(RayCaster &caster, In<double, -1, 3> origins, In<double, -1, 3> directions, double t_min, double t_max, Out<double, -1> range, Out<std::int32_t, -1> geom,
          std::optional<Out<double, -1, 3>> normal, std::optional<Out<double, -1>> radial_velocity, std::optional<In<std::int32_t, -1>> order, int threads,
          bool tree, bool max_range,
          const std::string &isa) {
    const std::size_t count = directions.shape(0);
    const bool one_origin = origins.shape(0) == 1;
    if (!one_origin) expect_rows(origins, count, "origins");
    expect_rows(range, count, "range_m");
    expect_rows(geom, count, "geom");
    if (normal) expect_rows(*normal, count, "normal");
    if (radial_velocity) expect_rows(*radial_velocity, count, "radial_velocity_mps");
    if (order) {
        expect_rows(*order, count, "order");
        std::vector<std::uint8_t> seen(count, 0);
        for (std::size_t i = 0; i < count; ++i) {
            const auto ray = static_cast<std::size_t>(order->data()[i]);
            if (ray >= count || seen[ray]++ != 0) throw std::invalid_argument("order is not a permutation of the rays");
        }
    }
    if (count > 0x7fffffff) throw std::invalid_argument("at most 2^31 - 1 rays at once");
    const CastOutput out{range.data(), geom.data(), normal ? normal->data() : nullptr,
                         radial_velocity ? radial_velocity->data() : nullptr};
    const CastSkips skips{tree, max_range};
    const Isa chosen = isa_by_name(isa);
    caster.refresh();  // while the GIL is held: two casts of one caster may run concurrently
    nb::gil_scoped_release release;
    caster.cast(origins.data(), one_origin, directions.data(), count, t_min, t_max, skips,
                order ? order->data() : nullptr, threads, chosen, out);
}

}  // namespace

void bind_ray_cast(nb::module_ &m) {
    nb::class_<RayCaster>(m, "RayCaster")
        .def(nb::init<const Geometry &>(), "geometry"_a, nb::keep_alive<1, 2>(), nb::call_guard<nb::gil_scoped_release>(),
             "Prepare the static geoms of a finished `geometry`.")
        .def("cast", &cast, "origins_W"_a, "directions_W"_a, "t_min"_a, "t_max"_a, "range_m"_a.noconvert(),
             "geom"_a.noconvert(), "normal_W"_a.noconvert() = nb::none(),
             "radial_velocity_mps"_a.noconvert() = nb::none(), nb::kw_only(), "order"_a = nb::none(), "threads"_a = 1,
             "tree"_a = true, "max_range"_a = true, "isa"_a = "",
             "Write the nearest hit of each ray in [t_min, t_max]: distance (+inf: no hit), geom (-1), normal against the "
             "ray (zeros) and speed of the surface point along the ray (NaN).");
    m.def(
        "coherent_order",
        [](In<double, -1, 3> directions, Out<std::int32_t, -1> out) {
            expect_rows(out, directions.shape(0), "out");
            nb::gil_scoped_release release;
            coherent_order(directions.data(), directions.shape(0), out.data());
        },
        "directions"_a, "out"_a.noconvert(), "Write a permutation in which rays of similar direction are neighbours.");
}
