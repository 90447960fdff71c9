// Python bindings of the flight core. They check shapes and types; their errors tell what to do.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "flight_core.hpp"
#include "imu_fifo.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using hil::flight::FlightCore;
using hil::flight::Params;
using hil::flight::Setpoint;
using hil::flight::SetpointKind;
using hil::Vec3;

namespace {

using ParamArray = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

Params checked(const ParamArray &values, bool rotors = true) {
    if (values.shape(0) != hil::flight::kParamCount) {
        throw nb::value_error(("params has " + std::to_string(values.shape(0)) + " entries, PARAM_NAMES has " +
                               std::to_string(hil::flight::kParamCount) + ": give one value per name, in this order")
                                  .c_str());
    }
    Params params;
    std::copy_n(values.data(), params.size(), params.begin());
    hil::flight::Mixer mixer;
    if (rotors && !mixer.configure(params)) {
        throw nb::value_error("CA_ROTORi_* cannot produce roll, pitch, yaw and thrust: check positions and KM signs");
    }
    return params;
}

void set_param(FlightCore &core, std::size_t index, double value) {
    if (index >= hil::flight::kParamCount) {
        throw nb::index_error(("parameter index must be below " + std::to_string(hil::flight::kParamCount)).c_str());
    }
    if (!core.set_param(index, value)) {
        throw nb::value_error((std::string(hil::flight::kParamTable[index].name) +
                               ": with this value the rotors cannot produce roll, pitch, yaw and thrust; unchanged")
                                  .c_str());
    }
}

template <class Get>
nb::list table(Get get) {
    nb::list out;
    for (const auto &p : hil::flight::kParamTable) out.append(get(p));
    return out;
}

}  // namespace

void bind_flight_core(nb::module_ &m) {
    m.attr("PARAM_NAMES") = table([](const auto &p) { return nb::str(p.name); });
    m.attr("PARAM_DEFAULTS") = table([](const auto &p) { return nb::float_(p.value); });
    m.attr("PARAM_MIN") = table([](const auto &p) { return nb::float_(p.minimum); });
    m.attr("PARAM_MAX") = table([](const auto &p) { return nb::float_(p.maximum); });
    nb::dict fields;
    for (const auto &f : hil::flight::kStateFields) fields[f.name] = nb::make_tuple(f.offset, f.size);
    m.attr("STATE_FIELDS") = fields;

    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    nb::class_<FlightCore>(m, "FlightCore",
                           "Estimator, cascaded control and mixer of the mock autopilot (NED/FRD, SI). One step() per IMU "
                           "sample; `state` and `controls` are read-only views rewritten in place. Not thread-safe.")
        .def(
            "__init__",
            [](FlightCore *self, const ParamArray &params, bool rotors) {
                new (self) FlightCore(checked(params, rotors), rotors);
            },
            "params"_a.noconvert(), "rotors"_a = true,
            "params: float64[len(PARAM_NAMES)], each between PARAM_MIN and PARAM_MAX. ValueError if the rotors cannot produce all torques and thrust. "
            "rotors: False for an estimator alone, with commands that stay 0.")
        .def("set_landed", &FlightCore::set_landed, "landed"_a, "Without rotors: tell whether the vehicle is on the ground.")
        .def("set_param", &set_param, "index"_a, "value"_a, "Set a parameter. IndexError or ValueError if it is refused; nothing is changed then.")
        .def(
            "get_param",
            [](const FlightCore &core, std::size_t index) {
                if (index >= hil::flight::kParamCount) throw nb::index_error("no such parameter index");
                return core.param(index);
            },
            "index"_a)
        .def(
            "step",
            [](FlightCore &core, std::int64_t t_us, double gx, double gy, double gz, double ax, double ay, double az) {
                core.step(t_us, {gx, gy, gz}, {ax, ay, az});
            },
            "t_us"_a, "gx"_a, "gy"_a, "gz"_a, "ax"_a, "ay"_a, "az"_a,
            "Take one IMU sample ending at t_us: gyro rad/s, specific force m/s^2, FRD, means since the last sample.")
        .def(
            "step_fifo",
            [](FlightCore &core, std::int64_t t_us, double gx, double gy, double gz, double ax, double ay, double az) {
                const Vec3 rate = hil::flight::fifo_rate({gx, gy, gz}), force = hil::flight::fifo_force({ax, ay, az});
                const bool numbers = is_finite(rate) && is_finite(force);
                if (numbers) core.step(t_us, rate, force);
                return numbers;
            },
            "t_us"_a, "gx"_a, "gy"_a, "gz"_a, "ax"_a, "ay"_a, "az"_a,
            "As `step`, with the sample in the steps and limits of an int16 FIFO. Return False, without a step, if one is NaN.")
        .def(
            "update_gps",
            [](FlightCore &core, std::int64_t t_us, double lat, double lon, double alt, double vn, double ve, double vd,
               double eph, double epv) { core.update_gps({t_us, {lat, lon, alt}, {vn, ve, vd}, eph, epv}); },
            "t_us"_a, "lat_deg"_a, "lon_deg"_a, "alt_m"_a, "vn"_a, "ve"_a, "vd"_a, "eph_m"_a, "epv_m"_a,
            "Take a fix that arrived at t_us and was measured EKF_GPS_DELAY before.")
        .def("update_baro", &FlightCore::update_baro, "t_us"_a, "alt_m"_a, "Take a pressure altitude, m.")
        .def(
            "update_mag",
            [](FlightCore &core, std::int64_t t_us, double mx, double my, double mz) { core.update_mag(t_us, {mx, my, mz}); },
            "t_us"_a, "mx"_a, "my"_a, "mz"_a, "Take a magnetic field, gauss, FRD.")
        .def(
            "set_setpoint",
            [](FlightCore &core, int kind, double x, double y, double z, double vx, double vy, double vz, double yaw,
               double yawspeed, double ax, double ay, double az) {
                return core.set_setpoint(
                    Setpoint{static_cast<SetpointKind>(kind), {x, y, z}, {vx, vy, vz}, {ax, ay, az}, yaw, yawspeed});
            },
            "kind"_a, "x"_a = nan, "y"_a = nan, "z"_a = nan, "vx"_a = nan, "vy"_a = nan, "vz"_a = nan, "yaw"_a = nan,
            "yawspeed"_a = nan, "ax"_a = nan, "ay"_a = nan, "az"_a = nan,
            "kind: 0 off, 1 idle, 2 position, 3 velocity, 4 attitude (x roll, y pitch, z thrust), 5 rate (x y z rad/s, vx "
            "thrust). NaN: not commanded. ax ay az: acceleration feed-forward of 2 and 3. Return False, and keep the old "
            "set-point, if a value is infinite or too large.")
        .def(
            "geodetic_to_ned",
            [](const FlightCore &core, double lat, double lon, double alt) {
                const Vec3 p = core.plane().to_ned({lat, lon, alt});
                return nb::make_tuple(p.x, p.y, p.z);
            },
            "lat_deg"_a, "lon_deg"_a, "alt_m"_a, "Return local NED, m, from the estimator's origin.")
        .def(
            "ned_to_geodetic",
            [](const FlightCore &core, double north, double east, double down) {
                const auto g = core.plane().to_geodetic({north, east, down});
                return nb::make_tuple(g.lat_deg, g.lon_deg, g.alt_m);
            },
            "north_m"_a, "east_m"_a, "down_m"_a, "Return latitude deg, longitude deg, altitude m.")
        .def(
            "covariance",
            [](const FlightCore &core, int row, int column) {
                if (row < 0 || row >= hil::flight::kErrors || column < 0 || column >= hil::flight::kErrors) {
                    throw nb::index_error("the covariance is 16x16");
                }
                return core.ekf().covariance(row, column);
            },
            "row"_a, "column"_a,
            "Return an entry of the error covariance: attitude, velocity, position, gyro bias, accelerometer bias (3 each), baro offset.")
        .def_prop_ro(
            "state",
            [](FlightCore &core) {
                return nb::ndarray<nb::numpy, const double, nb::shape<hil::flight::kStateSize>>(core.state(),
                                                                                               {hil::flight::kStateSize});
            },
            nb::rv_policy::reference_internal, "float64[64], laid out by STATE_FIELDS; fetch the view once and keep it.")
        .def_prop_ro(
            "controls",
            [](FlightCore &core) {
                return nb::ndarray<nb::numpy, const double, nb::shape<hil::flight::kControlSize>>(
                    core.controls(), {hil::flight::kControlSize});
            },
            nb::rv_policy::reference_internal, "float64[16], motor commands 0..1; fetch the view once and keep it.")
        .def(
            "motor_commands",
            [](FlightCore &core, int rotors) {
                nb::list commands;
                for (int i = 0; i < hil::flight::kControlSize; ++i) {
                    commands.append(i < rotors ? std::nearbyint(core.controls()[i] * 1000.0) / 1000.0 : 0.0);
                }
                return commands;
            },
            "rotors"_a, "Return the first `rotors` of `controls` in PX4's steps of 1/1000; the other slots are 0.")
        .def_prop_ro("landed", &FlightCore::landed);

    m.def(
        "allocate",
        [](const ParamArray &params, double roll, double pitch, double yaw, double thrust) {
            hil::flight::Mixer mixer;
            mixer.configure(checked(params));
            std::array<double, hil::flight::kMaxRotors> u{};
            const auto s = mixer.allocate(roll, pitch, yaw, thrust, u.data());
            nb::list commands;
            for (int i = 0; i < mixer.rotor_count(); ++i) commands.append(u[static_cast<std::size_t>(i)]);
            return nb::make_tuple(commands, s.roll_pitch, s.yaw);
        },
        "params"_a, "roll"_a, "pitch"_a, "yaw"_a, "thrust"_a,
        "Run the mixer alone. Return (motor commands, share of roll and pitch produced, share of yaw produced).");
}
