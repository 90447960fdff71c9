// Writes prepared frames to a descriptor, each at its absolute deadline, from a thread of its own.
//
//   producer (one thread)   push(deadline, bytes) -> copied into a slot of a ring made beforehand
//   sender   (one thread)   sleep until the deadline; write; note how late the write was
//
// A free-running autopilot stamps samples on arrival, so a late write is a wrong sample. Between its deadlines the sender
// neither allocates, nor locks, nor needs Python's interpreter lock. First in, first out: a deadline that lies before the
// one in front of it, or in the past, is simply late.
//
// A stale sample is worse than a missing one. A frame that is more than `stale_ns` late before its turn comes (the thread
// itself was held up) is left out, rather than sent in a burst with those behind it. On a full line (EAGAIN) the sender
// waits for room until one period after the deadline, then leaves the frame out. Neither goes for frames pushed with
// `keep` (commands), and a frame of which the line took a part is always finished. A line that takes
// nothing for `stall_limit_ns`, or fails or hangs up, ends the sending: `error`.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "realtime_thread.hpp"

namespace hil::realtime {

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

struct SenderOptions {
    std::size_t slots = 64;
    std::size_t slot_bytes = 4096;
    std::int64_t period_ns = 0;
    std::int64_t stall_limit_ns = 5'000'000'000;
    std::int64_t stale_ns = 0;  // 0: no frame is ever stale
};

class RealtimeSender {
   public:
    // Makes `fd` non-blocking (also for its other users) and keeps a duplicate of its own until stop(): closing `fd`
    // elsewhere cannot make it write to whatever gets the number next. Throws std::system_error.
    RealtimeSender(int fd, const SenderOptions &options);
    ~RealtimeSender();
    RealtimeSender(const RealtimeSender &) = delete;
    RealtimeSender &operator=(const RealtimeSender &) = delete;

    enum class Push { Taken, NotTaken, TooLong };
    // Never waits. NotTaken: no slot is free, or the sender has stopped or failed.
    Push push(std::int64_t deadline_ns, std::string_view frame, bool keep = false);

    // How late each frame left that was sent since the last call [ns], in order. Of the pushing thread.
    std::vector<std::int64_t> take_lateness();

    // Ends the thread within some 10 ms; frames whose deadline has not come are not sent. Any number of times.
    void stop();

    struct Failure {
        int code;  // errno; ETIMEDOUT: took nothing for stall_limit_ns; EIO also for a hang-up
        std::int64_t deadline_ns;  // of the frame that met it
    };
    bool failed() const noexcept { return failed_.load(std::memory_order_acquire); }
    Failure failure() const noexcept { return failure_; }  // meaningful once failed()

    const SenderOptions &options() const noexcept { return options_; }
    const std::string &scheduling() const noexcept { return scheduling_; }
    std::int64_t pushed() const noexcept { return static_cast<std::int64_t>(head_.load(std::memory_order_acquire)); }
    std::int64_t sent() const noexcept { return sent_.get(); }
    std::int64_t refused() const noexcept { return refused_.get(); }
    std::int64_t stalled() const noexcept { return stalled_.get(); }
    std::int64_t dropped() const noexcept { return dropped_.get(); }
    std::int64_t longest_gap_ns() const noexcept { return longest_gap_ns_.get(); }
    std::int64_t pending() const noexcept {
        const std::uint64_t tail = tail_.load(std::memory_order_acquire);
        return static_cast<std::int64_t>(head_.load(std::memory_order_acquire) - tail);
    }

   private:
    struct Slot {
        std::int64_t deadline_ns;
        std::size_t size;
        bool keep;
        std::int64_t lateness_ns;  // written by the sender; kLeftOut: not sent
    };
    static constexpr std::int64_t kLeftOut = -1;

    void run();
    void collect();
    bool sleep_until(std::int64_t deadline_ns) const noexcept;
    bool send(Slot &slot, const std::byte *frame) noexcept;
    bool hung_up() const noexcept;
    bool fail(int code, std::int64_t deadline_ns) noexcept;

    const SenderOptions options_;
    const int pid_;
    int fd_ = -1;
    Pages frames_;
    std::vector<Slot> slots_;
    std::unique_ptr<MemoryLock> memory_lock_;
    std::string scheduling_;

    // The ring. head_: frames put in so far, tail_: taken out so far; bell_ changes when there is something to look at.
    alignas(64) std::atomic<std::uint64_t> head_{0};
    alignas(64) std::atomic<std::uint64_t> tail_{0};
    alignas(64) std::atomic<std::uint32_t> bell_{0};
    std::atomic<bool> ready_{false}, stop_{false}, failed_{false};

    Failure failure_{0, 0};
    std::int64_t last_sent_ns_ = 0;     // 0: none yet
    std::int64_t blocked_since_ns_ = 0;  // 0: the line took what was last offered
    Counter sent_, refused_, stalled_, dropped_, longest_gap_ns_;

    // Of the pushing thread: frames whose lateness it has read, and what it read since it was last asked.
    std::uint64_t collected_ = 0;
    std::vector<std::int64_t> lateness_;

    std::mutex stop_mutex_;
    std::unique_ptr<std::thread> thread_;
};

}  // namespace hil::realtime
