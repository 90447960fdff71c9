// sim._kernels.EchoSynthesis: raw radar samples from echoes. Contract: radar/synthesis.hpp. Its only caller,
// sim/radar/synthesis.py, checks the arguments.

#include <nanobind/stl/optional.h>

#include <optional>

#include "bind_arrays.hpp"
#include "radar/synthesis.hpp"

using namespace hil::sim::radar;

namespace {

SynthesisReport synthesize(Synthesis &synthesis, In<double, -1> range, In<double, -1> speed, In<double, -1, 3> direction,
                           In<double, -1> amplitude, std::optional<In<double, -1, 3>> out_direction,
                           Out<double, -1, -1, -1> out) {
    const std::size_t count = range.shape(0);
    const EchoView echoes{count,           range.data(),     speed.data(),
                          direction.data(), amplitude.data(), out_direction ? out_direction->data() : nullptr};
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
               int samples, int chirps, const std::vector<Vec3> &tx_positions_m,
               const std::vector<Vec3> &rx_positions_m, int doppler_bands, bool complex_samples, double hp_cutoff_hz,
               double aaf_cutoff_hz, bool direct, double tolerance, double drop_share, const std::string &isa) {
                const ChirpFigures chirp{center_frequency_hz, bandwidth_hz, sample_rate_hz, repetition_s, samples, chirps};
                const ArrayFigures array{tx_positions_m, rx_positions_m, doppler_bands, complex_samples};
                new (self) Synthesis(chirp, array, hp_cutoff_hz, aaf_cutoff_hz, direct, tolerance, drop_share,
                                     hil::sim::frame::isa_by_name(isa));
            },
            nb::kw_only(), "center_frequency_hz"_a, "bandwidth_hz"_a, "sample_rate_hz"_a, "repetition_s"_a, "samples"_a,
            "chirps"_a, "tx_positions_m"_a, "rx_positions_m"_a, "doppler_bands"_a, "complex_samples"_a,
            "hp_cutoff_hz"_a, "aaf_cutoff_hz"_a, "direct"_a, "tolerance"_a, "drop_share"_a, "isa"_a = "",
            "A cut-off of 0 switches a filter off, 0 bands: time division.")
        .def("synthesize", &synthesize, "range_m"_a.noconvert(), "speed_mps"_a.noconvert(), "direction_R"_a.noconvert(),
             "amplitude"_a.noconvert(),
             "out_direction_R"_a.noconvert().none(), "out"_a.noconvert(), "Overwrite out (channels, chirps, samples).");
}
