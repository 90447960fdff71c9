// sim._kernels: impairments and ADC of a radar. Contract: radar/receiver_noise.hpp.

#include "bind_arrays.hpp"
#include "radar/receiver_noise.hpp"

namespace {

using Rows = std::vector<std::vector<double>>;

using hil::sim::radar::Converter;
using hil::sim::radar::ReceiverChain;
using hil::sim::radar::ReceiverNoise;

// Returns the value of a receiver. `values` is empty, for a default value, or holds one value per receiver.
template <typename T>
T one_of(const std::vector<T> &values, std::size_t receiver, std::size_t receivers, const char *what) {
    if (values.empty()) return T{};
    if (values.size() != receivers) throw std::invalid_argument(std::string(what) + " needs one value per receiver");
    return values[receiver];
}

template <typename A>
void fits(const ReceiverChain &chain, const A &array, const char *what) {
    if (array.shape(0) != chain.receivers() || array.shape(1) != chain.chirps() || array.shape(2) != chain.samples()) {
        throw std::invalid_argument(std::string(what) + " must be (" + std::to_string(chain.receivers()) + ", " +
                                    std::to_string(chain.chirps()) + ", " + std::to_string(chain.samples()) + ")");
    }
}

}  // namespace

void bind_radar_receiver(nb::module_ &m) {
    nb::class_<ReceiverChain>(m, "RadarReceiver")
        .def(
            "__init__",
            [](ReceiverChain *self, std::size_t receivers, std::size_t chirps, std::size_t samples, const Rows &fixed,
               const Rows &start, std::vector<double> decay, const Rows &colour, const Rows &envelope, const std::vector<Key> &colour_key,
               const std::vector<double> &wander, const std::vector<Key> &wander_key, double odd_width, int bits,
               const std::string &isa) {
                if (bits < 2 || bits > 16) throw std::invalid_argument("bits must be 2 to 16");
                std::vector<ReceiverNoise> noises(receivers);
                for (std::size_t k = 0; k < receivers; ++k) {
                    noises[k].fixed = one_of(fixed, k, receivers, "fixed");
                    noises[k].start = one_of(start, k, receivers, "start");
                    noises[k].colour = one_of(colour, k, receivers, "colour");
                    noises[k].wander = one_of(wander, k, receivers, "wander");
                    noises[k].envelope = one_of(envelope, k, receivers, "envelope");
                    const Key c = one_of(colour_key, k, receivers, "colour_key");
                    const Key w = one_of(wander_key, k, receivers, "wander_key");
                    noises[k].colour_key = {{c[0], c[1]}};
                    noises[k].wander_key = {{w[0], w[1]}};
                }
                const Converter converter{odd_width, static_cast<double>((1 << bits) - 1)};
                new (self) ReceiverChain(chirps, samples, noises, std::move(decay), converter,
                                         hil::sim::frame::isa_by_name(isa));
            },
            nb::kw_only(), "receivers"_a, "chirps"_a, "samples"_a, "fixed"_a, "start"_a, "decay"_a, "colour"_a, "envelope"_a,
            "colour_key"_a, "wander"_a, "wander_key"_a, "odd_width"_a, "bits"_a, "isa"_a = "")
        .def(
            "digitise",
            [](ReceiverChain &self, In<double, -1, -1, -1> signal, std::uint64_t seq, Out<std::uint16_t, -1, -1, -1> out) {
                fits(self, signal, "the signal");
                fits(self, out, "the output");
                std::size_t bad;
                {
                    nb::gil_scoped_release unlocked;
                    bad = self.digitise(signal.data(), seq, out.data());
                }
                return bad == ReceiverChain::kNone ? -1L : static_cast<long>(bad);
            },
            "signal"_a.noconvert(), "seq"_a, "out"_a.noconvert());
}
