// sim._kernels.EchoSynthesis: raw radar samples from echoes. Contract: radar/synthesis.hpp.

#include "bind_arrays.hpp"
#include "radar/synthesis.hpp"

using namespace hil::sim::radar;

namespace {

SynthesisReport synthesize(Synthesis &synthesis, In<double, -1> range, In<double, -1> speed, In<double, -1, 3> direction, In<double, -1> amplitude, Out<double, -1, -1, -1> out) {
    const std::size_t count = range.shape(0);
    if (speed.shape(0) != count || direction.shape(0) != count || amplitude.shape(0) != count) {
        throw std::invalid_argument("the arrays of the echoes differ in length");
    }
    if (count > 0x7fffffff) throw std::invalid_argument("at most 2^31 - 1 echoes at once");
    const EchoModel &model = synthesis.model();
    if (out.shape(0) != static_cast<std::size_t>(model.receivers) || out.shape(1) != static_cast<std::size_t>(model.chirps) ||
        out.shape(2) != static_cast<std::size_t>(model.samples)) {
        throw std::invalid_argument("out is not (receivers, chirps, samples)");
    }
    const EchoView echoes{count, range.data(), speed.data(), direction.data(), amplitude.data()};
    nb::gil_scoped_release release;
    return synthesis.synthesize(echoes, out.data());
}

}  // namespace

void bind_radar_synthesis(nb::module_ &m) {
    nb::class_<SynthesisReport>(m, "EchoSynthesisReport")
        .def_ro("echoes", &SynthesisReport::echoes)
        .def_ro("dropped", &SynthesisReport::dropped)
        .def_ro("dropped_bound", &SynthesisReport::dropped_bound)
        .def_ro("error_bound", &SynthesisReport::error_bound)
        .def_ro("terms", &SynthesisReport::terms)
        .def_ro("panels", &SynthesisReport::panels)
        .def_ro("width", &SynthesisReport::width)
        .def_ro("direct", &SynthesisReport::direct)
        .def_ro("rounds", &SynthesisReport::rounds);
    nb::class_<Synthesis>(m, "EchoSynthesis", "Raw samples of a frame from its echoes (radar/synthesis.hpp).")
        .def(
            "__init__",
            [](Synthesis *self, double center_frequency_hz, double bandwidth_hz, double sample_rate_hz, double repetition_s,
               int samples, int chirps, const std::vector<Vec3> &rx_positions_m, double hp_cutoff_hz,
               double aaf_cutoff_hz, bool direct, double tolerance, double drop_share, const std::string &isa) {
                if (rx_positions_m.empty() || rx_positions_m.size() > static_cast<std::size_t>(kMaxReceivers)) {
                    throw std::invalid_argument("there must be 1 to 16 receivers");
                }
                if (samples < 2 || chirps < 2 || samples > 4096 || chirps > 4096) {
                    throw std::invalid_argument("samples and chirps must be 2 to 4096");
                }
                if (!(tolerance >= kMinTolerance && tolerance <= kMaxTolerance)) {
                    throw std::invalid_argument("tolerance must lie in [1e-12, 0.1]");
                }
                for (const double figure : {center_frequency_hz, bandwidth_hz, sample_rate_hz, repetition_s}) {
                    if (!(figure > 0.0 && figure <= 1e15)) throw std::invalid_argument("a chirp's figures must lie in (0, 1e15]");
                }
                for (const double cutoff : {hp_cutoff_hz, aaf_cutoff_hz}) {
                    if (!(cutoff >= 0.0 && cutoff <= 1e15)) throw std::invalid_argument("cut-offs must lie in [0, 1e15]");
                }
                if (!(drop_share >= 0.0 && drop_share < 1.0)) throw std::invalid_argument("drop_share must lie in [0, 1)");
                for (const auto &position : rx_positions_m) {
                    for (const double x : position) {
                        if (!(x >= -10.0 && x <= 10.0)) throw std::invalid_argument("receivers must lie within 10 m");
                    }
                }
                const ChirpFigures chirp{center_frequency_hz, bandwidth_hz, sample_rate_hz, repetition_s, samples, chirps};
                new (self) Synthesis(chirp, rx_positions_m, hp_cutoff_hz, aaf_cutoff_hz, direct, tolerance, drop_share,
                                     hil::sim::frame::isa_by_name(isa));
            },
            nb::kw_only(), "center_frequency_hz"_a, "bandwidth_hz"_a, "sample_rate_hz"_a, "repetition_s"_a, "samples"_a,
            "chirps"_a, "rx_positions_m"_a, "hp_cutoff_hz"_a, "aaf_cutoff_hz"_a, "direct"_a, "tolerance"_a, "drop_share"_a,
            "isa"_a = "", "Cut-offs of 0 switch a filter off.")
        .def("synthesize", &synthesize, "range_m"_a.noconvert(), "speed_mps"_a.noconvert(), "direction_R"_a.noconvert(),
             "amplitude"_a.noconvert(), "out"_a.noconvert(), "Overwrites out (receivers, chirps, samples).");
}
