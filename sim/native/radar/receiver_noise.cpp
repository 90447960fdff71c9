#include "receiver_noise.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace hil::sim::radar {

using frame::Isa;
HIL_BY_ISA(ReceiverKernel, receiver_kernel, kReceiverKernel)

namespace {

constexpr std::size_t kBlock = 64;  // greatest number of samples coloured at once (receiver_noise.isa.cpp)

std::vector<double> padded_to(const std::vector<double> &values, std::size_t samples, std::size_t padded) {
    if (values.size() != samples)
        throw std::invalid_argument("fixed, start and envelope of a receiver need one value per sample");
    std::vector<double> row(values);
    row.resize(padded, 0.0);
    return row;
}

}  // namespace

ReceiverChain::ReceiverChain(std::size_t chirps, std::size_t samples, const std::vector<ReceiverNoise> &receivers,
                             std::vector<double> decay, Converter converter, Isa isa)
    : chirps_(chirps),
      samples_(samples),
      padded_((samples + kBlock - 1) / kBlock * kBlock),
      decay_(std::move(decay)),
      work_(padded_),
      white_(chirps * samples),
      steps_(chirps),
      converter_(converter),
      kernel_(&receiver_kernel(isa)) {
    if (chirps == 0 || samples == 0 || receivers.empty())
        throw std::invalid_argument("a frame needs at least one receiver, chirp and sample");
    if (!(converter.odd_width >= 0.0 && converter.odd_width <= 1.0 && converter.top >= 1.0 && converter.top <= 65535.0)) {
        throw std::invalid_argument("the converter needs odd_width in [0, 1] and bits in 1 to 16");
    }
    for (const ReceiverNoise &given : receivers) {
        Channel channel{};
        channel.fixed = given.fixed.empty() ? std::vector<double>(padded_, 0.0)
                                            : padded_to(given.fixed, samples_, padded_);
        if (!given.start.empty()) {
            if (decay_.size() != chirps_) throw std::invalid_argument("decay needs one value per chirp");
            channel.start = padded_to(given.start, samples_, padded_);
        }
        if (given.colour.size() == 1) {
            channel.envelope = padded_to(given.envelope, samples_, padded_);
            channel.white_sigma = given.colour[0];
        } else if (!given.colour.empty()) {
            if (given.colour.size() != samples_) throw std::invalid_argument("colour needs one value per sample");
            channel.envelope = padded_to(given.envelope, samples_, padded_);
            channel.colour_from.resize(samples_ + padded_);
            for (std::size_t i = 0; i < channel.colour_from.size(); ++i) {
                channel.colour_from[i] = given.colour[i % samples_];
            }
        }
        channel.wander = given.wander;
        channel.colour_key = given.colour_key;
        channel.wander_key = given.wander_key;
        channels_.push_back(std::move(channel));
    }
}

std::size_t ReceiverChain::digitise(const double *signal, std::uint64_t seq, std::uint16_t *out) {
    for (std::size_t k = 0; k < channels_.size(); ++k) {
        const Channel &channel = channels_[k];
        const bool coloured = !channel.colour_from.empty();
        if (coloured || channel.white_sigma > 0.0) image_normals(channel.colour_key, seq, white_.data(), white_.size());
        if (channel.wander > 0.0) image_normals(channel.wander_key, seq, steps_.data(), steps_.size());
        for (std::size_t m = 0; m < chirps_; ++m) {
            const std::size_t first = (k * chirps_ + m) * samples_;
            ChirpTask task{};
            task.samples = samples_;
            task.padded = padded_;
            task.signal = signal + first;
            task.fixed = channel.fixed.data();
            task.start = channel.start.empty() ? nullptr : channel.start.data();
            task.decay = channel.start.empty() ? 0.0 : decay_[m];
            task.offset = channel.wander > 0.0 ? channel.wander * static_cast<double>(steps_[m]) : 0.0;
            task.colour_from = coloured ? channel.colour_from.data() : nullptr;
            task.white_sigma = channel.white_sigma;
            task.envelope = channel.envelope.data();
            task.white = white_.data() + m * samples_;
            task.converter = converter_;
            task.work = work_.data();
            task.out = out + first;
            if (kernel_->chirp(task)) continue;
            for (std::size_t n = 0; n < samples_; ++n) {
                if (!std::isfinite(signal[first + n])) return first + n;
            }
        }
    }
    return kNone;
}

}  // namespace hil::sim::radar
