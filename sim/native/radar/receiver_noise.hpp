// Impairments of a radar's receivers and ADC, added to the beat signal one frame at a time:
//
//   x[k,m,n]    = signal[k,m,n] + fixed[k,n] + decay[m] start[k,n] + wander[k] d[k,m] + g[k,n] sum_j h[k,(n-j) mod N] w[k,m,j]
//   out[k,m,n]  = code(x)        2i     where x lies in [2i - e/2, 2i + e/2),     e = 2 - o  (even codes)
//                                2i + 1 where x lies in [2i + 1 - o/2, 2i + 1 + o/2)          (odd codes)
//
// clipped to [0, 2^bits - 1]. w and d are standard normals. h colours w: the power of bin b of one chirp's N samples is
// |DFT(h)[b]|^2. g, the envelope, scales the coloured noise over the chirp. o is the width of an odd code in counts; 1
// for a converter with equal widths.
//
// Noise is counter-based (image_noise.hpp): w[k,m,n] is normal m N + n of picture `seq` under the receiver's key, d[k,m]
// normal m under a second key. Any frame can be computed without the frames before it.
//
// Determinism: + - * and comparisons, sums in the order written: the same bits with every instruction set. Scratch is
// allocated at construction; digitise allocates nothing. One object must not be used by two threads at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "../frame/isa.hpp"
#include "../image_noise.hpp"

namespace hil::sim::radar {

// Impairments of one receiver. An empty vector adds nothing.
struct ReceiverNoise {
    std::vector<double> fixed;   // (N)
    std::vector<double> start;   // (N)
    std::vector<double> colour;  // (N) h; or (1), h[0], for white noise, whose other h are 0
    std::vector<double> envelope;  // (N) g; needed with a colour
    double wander = 0.0;
    ImageKey colour_key{};
    ImageKey wander_key{};
};

struct Converter {
    double odd_width;  // o, 0 < o <= 1
    double top;        // 2^bits - 1
};

// One chirp of one receiver. Arrays of `padded` doubles, of which the first `samples` count; `colour_from` has
// samples + padded: h[(i - samples) mod samples] at i.
struct ChirpTask {
    std::size_t samples, padded;
    const double *signal;       // (samples), the caller's
    const double *fixed;        // (padded)
    const double *start;        // (padded) or null
    double decay;
    double offset;              // the chirp's own DC
    const double *colour_from;  // or null
    double white_sigma;         // without colour_from: deviation of white noise, 0 for none
    const double *envelope;     // (padded), with colour_from
    const float *white;         // (samples)
    Converter converter;
    double *work;               // (padded)
    std::uint16_t *out;         // (samples), the caller's
};

struct ReceiverKernel {
    // Returns false if a sample of the signal is not finite.
    bool (*chirp)(const ChirpTask &task);
};
const ReceiverKernel &receiver_kernel(frame::Isa isa);

class ReceiverChain {
  public:
    static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

    // decay: (chirps), or empty if no receiver has a start. Throws std::invalid_argument if sizes do not match.
    ReceiverChain(std::size_t chirps, std::size_t samples, const std::vector<ReceiverNoise> &receivers,
                  std::vector<double> decay, Converter converter, frame::Isa isa);

    std::size_t receivers() const { return channels_.size(); }
    std::size_t chirps() const { return chirps_; }
    std::size_t samples() const { return samples_; }

    // signal, out: (receivers, chirps, samples), C order. Returns kNone, or the index of the first sample of the signal
    // that is not finite; `out` is then undefined from that index on.
    std::size_t digitise(const double *signal, std::uint64_t seq, std::uint16_t *out);

  private:
    struct Channel {
        std::vector<double> fixed, start, colour_from, envelope;
        double wander, white_sigma;
        ImageKey colour_key, wander_key;
    };

    std::size_t chirps_, samples_, padded_;
    std::vector<Channel> channels_;
    std::vector<double> decay_, work_;
    std::vector<float> white_, steps_;
    Converter converter_;
    const ReceiverKernel *kernel_;
};

}  // namespace hil::sim::radar
