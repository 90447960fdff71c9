// What a thread needs to keep deadlines on an ordinary kernel: the clock, an absolute sleep, a real-time priority,
// memory that is never paged out. Everything that needs a permission is asked for and, if refused, reported in words.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace hil::realtime {

// The clock of Python's time.monotonic_ns(), on every platform.
std::int64_t now_ns() noexcept;

// Sleeps until that clock shows `deadline_ns`; may return early (signal), never on purpose late.
void sleep_until_ns(std::int64_t deadline_ns) noexcept;

// For the calling thread: SCHED_FIFO at 80, above the kernel's interrupt threads (50), or the highest priority the user may
// have, no timer slack, a name, a stack that is there before it is needed. Returns what was granted, and what to do if not.
std::string schedule_this_thread();

// Holds the process's memory in RAM while it lives. Where the process may lock without limit, all of it (present and
// future pages, as they are touched); elsewhere `bytes` at `data` only: locking everything under a limit would make later
// allocations of the whole process fail.
class MemoryLock {
   public:
    MemoryLock(const void *data, std::size_t bytes);
    ~MemoryLock();
    MemoryLock(const MemoryLock &) = delete;
    MemoryLock &operator=(const MemoryLock &) = delete;

    const std::string &description() const { return description_; }

   private:
    bool everything_ = false;
    std::string description_;
};

// Zeroed, page-aligned memory that belongs to nobody else's pages, touched once so that no later access faults.
class Pages {
   public:
    explicit Pages(std::size_t bytes);
    ~Pages();
    Pages(const Pages &) = delete;
    Pages &operator=(const Pages &) = delete;

    std::byte *data() const { return data_; }
    std::size_t bytes() const { return bytes_; }

   private:
    std::byte *data_;
    std::size_t bytes_;
};

}  // namespace hil::realtime
