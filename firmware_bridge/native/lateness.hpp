// Statistics of lateness, written by one thread and read by any other at any time, without locks: the writer is a
// real-time thread and must never wait for a reader.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace hil::realtime {

// Bins of hil/signals/latency.py: a duration with its highest bit at position b falls in the bin of its top 6 bits, so
// that bins are at most 3.2 % wide; below 64 ns bins are exact; durations below zero count as zero.
constexpr int kSubBits = 5;
constexpr std::size_t kBins = (64 - kSubBits) << kSubBits;

constexpr std::size_t lateness_bin(std::int64_t duration_ns) noexcept {
    if (duration_ns <= 0) return 0;
    const auto d = static_cast<std::uint64_t>(duration_ns);
    const int shift = std::bit_width(d) - 1 - kSubBits;
    if (shift <= 0) return static_cast<std::size_t>(d);
    return (static_cast<std::size_t>(shift) << kSubBits) + static_cast<std::size_t>(d >> shift);
}

// A counter with one writer: a plain load and store, no bus lock.
class Counter {
   public:
    void add(std::int64_t n) noexcept { value_.store(value_.load(std::memory_order_relaxed) + n, std::memory_order_relaxed); }
    void raise_to(std::int64_t n) noexcept {
        if (n > get()) value_.store(n, std::memory_order_relaxed);
    }
    std::int64_t get() const noexcept { return value_.load(std::memory_order_relaxed); }

   private:
    std::atomic<std::int64_t> value_{0};
};

struct LateSend {
    std::int64_t index, deadline_ns, lateness_ns;
};

// The worst of what was added, at most kCapacity of them. A sequence lock: a reader that met a write reads again.
class WorstSends {
   public:
    static constexpr std::size_t kCapacity = 256;

    void add(const LateSend &late) noexcept {
        std::size_t place = count_.load(std::memory_order_relaxed);
        if (place == kCapacity) {
            place = 0;
            for (std::size_t i = 1; i < kCapacity; ++i) {
                if (lateness(i) < lateness(place)) place = i;
            }
            if (late.lateness_ns <= lateness(place)) return;
        }
        const std::uint32_t version = version_.load(std::memory_order_relaxed);
        version_.store(version + 1, std::memory_order_relaxed);  // odd: being written
        std::atomic_thread_fence(std::memory_order_release);
        words_[3 * place].store(late.index, std::memory_order_relaxed);
        words_[3 * place + 1].store(late.deadline_ns, std::memory_order_relaxed);
        words_[3 * place + 2].store(late.lateness_ns, std::memory_order_relaxed);
        if (place == count_.load(std::memory_order_relaxed)) count_.store(place + 1, std::memory_order_relaxed);
        version_.store(version + 2, std::memory_order_release);
    }

    // In no particular order.
    std::vector<LateSend> read() const {
        std::vector<LateSend> out;
        for (;;) {
            const std::uint32_t before = version_.load(std::memory_order_acquire);
            if (before & 1) continue;
            out.clear();
            const std::size_t count = count_.load(std::memory_order_relaxed);
            for (std::size_t i = 0; i < count; ++i) {
                out.push_back({words_[3 * i].load(std::memory_order_relaxed),
                               words_[3 * i + 1].load(std::memory_order_relaxed), lateness(i)});
            }
            std::atomic_thread_fence(std::memory_order_acquire);
            if (version_.load(std::memory_order_relaxed) == before) return out;
        }
    }

   private:
    std::int64_t lateness(std::size_t i) const noexcept { return words_[3 * i + 2].load(std::memory_order_relaxed); }

    std::array<std::atomic<std::int64_t>, 3 * kCapacity> words_{};
    std::atomic<std::size_t> count_{0};
    std::atomic<std::uint32_t> version_{0};
};

class LatenessStats {
   public:
    static constexpr std::int64_t kLateNs = 2'000'000;       // half a period of 250 Hz
    static constexpr std::int64_t kHarmfulNs = 20'000'000;  // what PX4's estimator was seen to suffer from

    void add(std::int64_t index, std::int64_t deadline_ns, std::int64_t lateness_ns) noexcept {
        if (lateness_ns < 0) lateness_ns = 0;
        bins_[lateness_bin(lateness_ns)].add(1);
        total_ns.add(lateness_ns);
        max_ns.raise_to(lateness_ns);
        if (lateness_ns > kLateNs) {
            over_2ms.add(1);
            if (lateness_ns > kHarmfulNs) over_20ms.add(1);
            worst.add({index, deadline_ns, lateness_ns});
        }
        count.add(1);
    }
    std::int64_t bin(std::size_t i) const noexcept { return bins_[i].get(); }

    Counter count, total_ns, max_ns, over_2ms, over_20ms;
    WorstSends worst;  // of those over 2 ms

   private:
    std::array<Counter, kBins> bins_{};
};

}  // namespace hil::realtime
