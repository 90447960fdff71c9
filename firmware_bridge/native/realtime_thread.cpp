#ifndef _WIN32
#include "realtime_thread.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <mutex>
#include <system_error>

#ifdef __linux__
#include <sys/prctl.h>
#else
#include <chrono>
#include <thread>
#endif

namespace hil::realtime {

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr int kPriority = 80;
constexpr std::size_t kStackBytes = 64 * 1024;  // the sender uses a few hundred bytes; the C library's calls some more

// The compiler may not drop the writes, nor inline this into a frame that stays.
[[gnu::noinline]] void touch_stack() {
    volatile char stack[kStackBytes];
    for (std::size_t i = 0; i < kStackBytes; i += 1024) stack[i] = 0;
    static_cast<void>(stack[kStackBytes - 1]);
}

const char *kRemedy =
    "to get it, add `rtprio 90` and `memlock unlimited` for your user to /etc/security/limits.conf and log in again, or "
    "run `sudo setcap cap_sys_nice,cap_ipc_lock+ep` on the Python program";

#ifdef __linux__
// Whether the process may lock any amount of memory: no limit, or CAP_IPC_LOCK.
bool may_lock_everything() {
    rlimit limit{};
    if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY) return true;
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (line.rfind("CapEff:", 0) == 0) {
            constexpr int kCapIpcLock = 14;
            return (std::stoull(line.substr(7), nullptr, 16) >> kCapIpcLock) & 1;
        }
    }
    return false;
}

// mlockall is one switch for the whole process: the first lock turns it on, the last one off.
std::mutex lock_mutex;
int lock_holders = 0;
#endif

}  // namespace

#ifdef __linux__
std::int64_t now_ns() noexcept {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * kSecond + t.tv_nsec;
}

void sleep_until_ns(std::int64_t deadline_ns) noexcept {
    timespec t;
    t.tv_sec = deadline_ns / kSecond;
    t.tv_nsec = deadline_ns % kSecond;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}
#else
std::int64_t now_ns() noexcept {
#ifdef __APPLE__
    return static_cast<std::int64_t>(clock_gettime_nsec_np(CLOCK_UPTIME_RAW));
#else
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * kSecond + t.tv_nsec;
#endif
}

// No absolute sleep on this clock here. The caller looks at the clock again, so errors do not add up.
void sleep_until_ns(std::int64_t deadline_ns) noexcept {
    const std::int64_t left_ns = deadline_ns - now_ns();
    if (left_ns > 0) std::this_thread::sleep_for(std::chrono::nanoseconds(left_ns));
}
#endif

std::string schedule_this_thread() {
#ifdef __linux__
    prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);  // ns; the default of 50 us would be added to every sleep
    pthread_setname_np(pthread_self(), "hil-sender");
#endif
    touch_stack();
    sched_param param{};
    param.sched_priority = kPriority;
    int refusal = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
#ifdef RLIMIT_RTPRIO
    rlimit limit{};
    if (refusal == EPERM && getrlimit(RLIMIT_RTPRIO, &limit) == 0 && limit.rlim_cur > 0) {
        param.sched_priority = static_cast<int>(std::min<rlim_t>(limit.rlim_cur, static_cast<rlim_t>(kPriority)));
        refusal = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
    }
#endif
    if (refusal == 0) return "SCHED_FIFO " + std::to_string(param.sched_priority);
    const std::string asked = "SCHED_FIFO " + std::to_string(kPriority);
    if (refusal == EPERM) return "normal scheduling (no permission for " + asked + ": " + kRemedy + ")";
    return "normal scheduling (" + asked + " refused: " + std::strerror(refusal) + ")";
}

MemoryLock::MemoryLock(const void *data, std::size_t bytes) {
#ifdef __linux__
    if (may_lock_everything()) {
        int flags = MCL_CURRENT | MCL_FUTURE;
#ifdef MCL_ONFAULT
        // Without it every thread's stack, 8 MiB each, would be filled with real memory at once.
        flags |= MCL_ONFAULT;
#endif
        const std::lock_guard guard(lock_mutex);
        if (lock_holders > 0 || mlockall(flags) == 0) {
            ++lock_holders;
            everything_ = true;
            description_ = "memory locked";
            return;
        }
    }
#endif
    // The pages are the caller's own and are unlocked with their unmapping.
    description_ = mlock(data, bytes) == 0 ? "of the memory only the ring of frames locked" : "memory not locked (no permission)";
}

MemoryLock::~MemoryLock() {
#ifdef __linux__
    if (!everything_) return;
    const std::lock_guard guard(lock_mutex);
    if (--lock_holders == 0) munlockall();
#endif
}

Pages::Pages(std::size_t bytes) : bytes_(bytes) {
    void *memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANON, -1, 0);
    if (memory == MAP_FAILED) throw std::system_error(errno, std::generic_category(), "ring of frames to send");
    data_ = static_cast<std::byte *>(memory);
    std::memset(memory, 0, bytes);
}

Pages::~Pages() { munmap(data_, bytes_); }

}  // namespace hil::realtime
#endif
