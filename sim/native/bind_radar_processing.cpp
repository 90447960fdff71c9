// sim._kernels: the radar's processing chain. Contracts: radar/processing_map.hpp, cfar.hpp, processing_points.hpp,
// processing_angles.hpp, processing_tracker.hpp.
#include <nanobind/stl/pair.h>

#include "bind_arrays.hpp"
#include "radar/processing_tracker.hpp"

using namespace hil::sim::radar;
using hil::sim::frame::isa_by_name;

namespace {

Clutter clutter_by_name(const std::string &name) {
    if (name == "none") return Clutter::kNone;
    if (name == "mean") return Clutter::kMean;
    if (name == "mti2") return Clutter::kTwoPulse;
    if (name == "mti3") return Clutter::kThreePulse;
    if (name == "background") return Clutter::kBackground;
    throw std::invalid_argument("unknown clutter removal '" + name + "': none, mean, mti2, mti3 or background");
}

CfarKind kind_by_name(const std::string &name) {
    if (name == "ca") return CfarKind::kCellAveraging;
    if (name == "os") return CfarKind::kOrderStatistic;
    throw std::invalid_argument("unknown CFAR '" + name + "': ca or os");
}

template <class Array>
void fits(const Array &array, int rows, int columns) {
    if ((int)array.shape(0) != rows || (int)array.shape(1) != columns) {
        throw std::invalid_argument("the map is " + std::to_string(array.shape(0)) + " x " +
                                    std::to_string(array.shape(1)) + ", not " + std::to_string(rows) + " x " +
                                    std::to_string(columns));
    }
}

}  // namespace

void bind_radar_processing(nb::module_ &m) {
    nb::class_<ProcessingMap>(m, "RadarMap")
        .def(nb::new_([](int receivers, int chirps, int samples, int pad_chirps, int pad_samples,
                         const std::string &clutter, bool chirp_mean, std::vector<double> fast_window,
                         std::vector<double> slow_window, const std::string &isa) {
                 return new ProcessingMap(receivers, chirps, samples, pad_chirps, pad_samples, clutter_by_name(clutter),
                                          chirp_mean, std::move(fast_window), std::move(slow_window), isa_by_name(isa));
             }),
             nb::kw_only(), "receivers"_a, "chirps"_a, "samples"_a, "pad_chirps"_a, "pad_samples"_a, "clutter"_a,
             "remove_chirp_mean"_a, "fast_window"_a, "slow_window"_a, "isa"_a = "")
        .def_prop_ro("shape",
                     [](const ProcessingMap &map) { return std::make_pair(map.shape().rows, map.shape().columns); })
        .def(
            "compute",
            [](ProcessingMap &map, In<std::uint16_t, -1, -1, -1> raw, double background_gain, Out<float, -1, -1> power) {
                const MapShape &s = map.shape();
                if ((int)raw.shape(0) != s.receivers || (int)raw.shape(1) != s.chirps || (int)raw.shape(2) != s.samples) {
                    throw std::invalid_argument("raw samples have another shape than (receivers, chirps, samples)");
                }
                fits(power, s.rows, s.columns);
                nb::gil_scoped_release unlocked;
                map.compute(raw.data(), background_gain, power.data());
            },
            "raw"_a.noconvert(), "background_gain"_a, "power"_a.noconvert())
        .def(
            "spectrum",
            [](const ProcessingMap &map, int receiver, Out<double, -1, -1> re, Out<double, -1, -1> im) {
                const MapShape &s = map.shape();
                fits(re, s.rows, s.columns);
                fits(im, s.rows, s.columns);
                if (receiver < 0 || receiver >= s.receivers) throw std::invalid_argument("no such receiver");
                for (int row = 0; row < s.rows; ++row) {
                    for (int column = 0; column < s.columns; ++column) {
                        map.cell(receiver, row, column, &re(row, column), &im(row, column));
                    }
                }
            },
            "receiver"_a, "re"_a.noconvert(), "im"_a.noconvert(), "X of the last frame, rows as in the map.")
        .def("reset", &ProcessingMap::reset);

    nb::class_<Cfar>(m, "RadarCfar")
        .def(nb::new_([](int rows, int columns, const std::string &kind, std::pair<int, int> guard,
                         std::pair<int, int> train, double rank, double false_alarm, int receivers, double likeness,
                         std::vector<bool> quiet_rows, int quiet_columns) {
                 return new Cfar(rows, columns,
                                 {kind_by_name(kind), guard.first, guard.second, train.first, train.second, rank,
                                  false_alarm, receivers, quiet_columns, likeness},
                                 std::move(quiet_rows));
             }),
             nb::kw_only(), "rows"_a, "columns"_a, "kind"_a, "guard"_a, "train"_a, "rank"_a, "false_alarm"_a,
             "receivers"_a, "likeness"_a, "quiet_rows"_a, "quiet_columns"_a)
        .def(
            "detect",
            [](Cfar &cfar, In<float, -1, -1> power, Out<std::uint8_t, -1, -1> mask, Out<double, -1, -1> noise) {
                fits(power, cfar.rows(), cfar.columns());
                fits(mask, cfar.rows(), cfar.columns());
                fits(noise, cfar.rows(), cfar.columns());
                nb::gil_scoped_release unlocked;
                cfar.look_at(power.data());
                for (int row = 0; row < cfar.rows(); ++row) {
                    for (int column = 0; column < cfar.columns(); ++column) {
                        const std::size_t at = (std::size_t)row * cfar.columns() + column;
                        noise.data()[at] = cfar.noise(row, column);
                        mask.data()[at] = power.data()[at] > cfar.threshold(row, column) * noise.data()[at];
                    }
                }
            },
            "power"_a.noconvert(), "mask"_a.noconvert(), "noise"_a.noconvert());
    m.def("cell_averaging_factor", &cell_averaging_factor, "cells"_a, "receivers"_a, "false_alarm"_a);
    m.def("order_statistic_factor", &order_statistic_factor, "cells"_a, "rank"_a, "receivers"_a, "false_alarm"_a);

    m.def(
        "radar_direction",
        [](std::vector<Vec3> positions_m, double wavelength_m, In<double, -1> re, In<double, -1> im) {
            const Direction direction(positions_m, wavelength_m);
            if (re.size() != positions_m.size() || im.size() != positions_m.size()) {
                throw std::invalid_argument("one value a receiver");
            }
            return direction.find(re.data(), im.data());
        },
        "positions_m"_a, "wavelength_m"_a, "re"_a.noconvert(), "im"_a.noconvert());

    nb::class_<PeakFinder>(m, "RadarPeaks")
        .def(nb::new_([](const Cfar &cfar, std::vector<Vec3> positions_m, double wavelength_m,
                         double range_step_m, double speed_step_mps, double coupling_s, int first_column,
                         std::vector<double> range_ratio, std::vector<double> speed_ratio,
                         std::vector<double> range_lobes, std::vector<double> speed_lobes,
                         std::pair<int, int> nulls) {
                 return new PeakFinder({range_step_m, speed_step_mps, coupling_s, first_column, std::move(range_ratio),
                                        std::move(speed_ratio), std::move(range_lobes), std::move(speed_lobes),
                                        nulls.first, nulls.second},
                                       cfar, Direction(positions_m, wavelength_m));
             }),
             "cfar"_a, nb::kw_only(), "positions_m"_a, "wavelength_m"_a, "range_step_m"_a, "speed_step_mps"_a,
             "coupling_s"_a, "first_column"_a, "range_ratio"_a, "speed_ratio"_a, "range_lobes"_a,
             "speed_lobes"_a, "nulls"_a)
        .def(
            "find",
            [](PeakFinder &peaks, const ProcessingMap &map, In<float, -1, -1> power, Out<float, -1, 8> out) {
                fits(power, map.shape().rows, map.shape().columns);
                nb::gil_scoped_release unlocked;
                return peaks.find(map, power.data(), reinterpret_cast<RadarPoint *>(out.data()), (int)out.shape(0));
            },
            "map"_a, "power"_a.noconvert(), "out"_a.noconvert());

    nb::class_<Tracker>(m, "RadarTracker")
        .def(nb::new_([](double whole_speed_mps, Vec3 cluster, Vec3 gate,
                         double birth_speed_mps, double birth_snr_db, Vec3 sigma,
                         std::array<double, 2> acceleration, std::pair<int, int> confirm, double coast_s,
                         double pause_s) {
                 return new Tracker({whole_speed_mps, cluster[0], cluster[1], cluster[2], gate[0], gate[1], gate[2],
                                     birth_speed_mps, birth_snr_db, sigma[0], sigma[1], sigma[2], acceleration[0],
                                     acceleration[1], confirm.first, confirm.second, coast_s, pause_s});
             }),
             nb::kw_only(), "whole_speed_mps"_a, "cluster"_a, "gate"_a, "birth_speed_mps"_a, "birth_snr_db"_a,
             "sigma"_a, "acceleration"_a, "confirm"_a, "coast_s"_a, "pause_s"_a)
        .def(
            "step",
            [](Tracker &tracker, double dt_s, In<float, -1, 8> points, Out<std::uint8_t, -1, 64> out) {
                nb::gil_scoped_release unlocked;
                return tracker.step(dt_s, reinterpret_cast<const RadarPoint *>(points.data()), (int)points.shape(0),
                                    reinterpret_cast<RadarTrack *>(out.data()), (int)out.shape(0));
            },
            "dt_s"_a, "points"_a.noconvert(), "out"_a.noconvert())
        .def("reset", &Tracker::reset);
}
