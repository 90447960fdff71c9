#ifndef _WIN32
#include "realtime_sender.hpp"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

namespace hil::realtime {

namespace {

// Longest sleep without a look at the stop flag.
constexpr std::int64_t kSliceNs = 10'000'000;
constexpr short kGone = POLLHUP | POLLERR | POLLNVAL;

int duplicate_nonblocking(int fd) {
    // Close-on-exec: a process started meanwhile must not keep the port open.
    const int own = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    if (own < 0) throw std::system_error(errno, std::generic_category(), "descriptor to send on");
    const int flags = fcntl(own, F_GETFL);
    if (flags < 0 || fcntl(own, F_SETFL, flags | O_NONBLOCK) < 0) {
        const int code = errno;
        ::close(own);
        throw std::system_error(code, std::generic_category(), "descriptor to send on");
    }
    return own;
}

// While it lives, threads started by this one begin with every signal blocked: Ctrl-C is Python's business, and a
// SIGPIPE of a closed socket becomes EPIPE.
class SignalsBlocked {
   public:
    SignalsBlocked() {
        sigset_t all;
        sigfillset(&all);
        pthread_sigmask(SIG_SETMASK, &all, &before_);
    }
    ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

   private:
    sigset_t before_;
};

}  // namespace

RealtimeSender::RealtimeSender(int fd, const SenderOptions &options)
    : options_(options), pid_(getpid()), frames_(options.slots * options.slot_bytes), slots_(options.slots) {
    fd_ = duplicate_nonblocking(fd);
    try {
        memory_lock_ = std::make_unique<MemoryLock>(frames_.data(), frames_.bytes());
        const SignalsBlocked blocked;
        thread_ = std::make_unique<std::thread>([this] { run(); });
    } catch (...) {
        ::close(fd_);
        throw;
    }
    ready_.wait(false);  // until the thread has said what scheduling it got
}

RealtimeSender::~RealtimeSender() { stop(); }

void RealtimeSender::stop() {
    if (getpid() != pid_) {
        // In a forked child there is no such thread to join; its handle is left alone.
        (void)thread_.release();
        (void)memory_lock_.release();
        if (fd_ >= 0) ::close(fd_);
        fd_ = -1;
        return;
    }
    const std::lock_guard guard(stop_mutex_);
    if (!thread_) return;
    stop_.store(true, std::memory_order_release);
    bell_.fetch_add(1, std::memory_order_acq_rel);
    bell_.notify_all();
    thread_->join();
    thread_.reset();
    memory_lock_.reset();
    ::close(fd_);
    fd_ = -1;
}

RealtimeSender::Push RealtimeSender::push(std::int64_t deadline_ns, std::string_view frame, bool keep) {
    if (frame.size() > options_.slot_bytes) return Push::TooLong;
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    const bool full = head - tail_.load(std::memory_order_acquire) == options_.slots;
    if (full || failed() || stop_.load(std::memory_order_relaxed)) {
        refused_.add(1);
        return Push::NotTaken;
    }
    const std::size_t place = head % options_.slots;
    collect();  // before the place is used again
    slots_[place] = {deadline_ns, frame.size(), keep, kLeftOut};
    std::memcpy(frames_.data() + place * options_.slot_bytes, frame.data(), frame.size());
    head_.store(head + 1, std::memory_order_release);
    // After the head: a sender that saw the old bell and the old head finds the bell changed and looks again.
    bell_.fetch_add(1, std::memory_order_acq_rel);
    bell_.notify_one();
    return Push::Taken;
}

void RealtimeSender::collect() {
    for (const std::uint64_t tail = tail_.load(std::memory_order_acquire); collected_ < tail; ++collected_) {
        const std::int64_t lateness_ns = slots_[collected_ % options_.slots].lateness_ns;
        if (lateness_ns != kLeftOut) lateness_.push_back(lateness_ns);
    }
}

std::vector<std::int64_t> RealtimeSender::take_lateness() {
    collect();
    return std::exchange(lateness_, {});
}

void RealtimeSender::run() {
    scheduling_ = schedule_this_thread() + ", " + memory_lock_->description();
    ready_.store(true, std::memory_order_release);
    ready_.notify_all();
    for (std::uint64_t tail = 0;;) {
        const std::uint32_t bell = bell_.load(std::memory_order_acquire);
        if (stop_.load(std::memory_order_acquire)) return;
        if (head_.load(std::memory_order_acquire) == tail) {
            bell_.wait(bell, std::memory_order_acquire);
            continue;
        }
        const std::size_t place = tail % options_.slots;
        Slot &slot = slots_[place];
        const std::int64_t deadline_ns = slot.deadline_ns;
        if (!sleep_until(deadline_ns)) return;
        if (!send(slot, frames_.data() + place * options_.slot_bytes)) return;
        tail_.store(++tail, std::memory_order_release);
        // A pseudo-terminal whose far end is gone goes on taking bytes. Looked at after the write, so as not to delay it.
        if (hung_up()) {
            fail(EIO, deadline_ns);
            return;
        }
    }
}

// False if asked to stop meanwhile.
bool RealtimeSender::sleep_until(std::int64_t deadline_ns) const noexcept {
    for (;;) {
        if (stop_.load(std::memory_order_relaxed)) return false;
        const std::int64_t now = now_ns();
        if (now >= deadline_ns) return true;
        sleep_until_ns(std::min(deadline_ns, now + kSliceNs));
    }
}

// False if the thread is to end: stopped or failed.
bool RealtimeSender::send(Slot &slot, const std::byte *frame) noexcept {
    std::size_t done = 0;
    bool waited = false;
    std::int64_t now = now_ns();
    if (options_.stale_ns > 0 && !slot.keep && now - slot.deadline_ns > options_.stale_ns) {
        dropped_.add(1);
        return true;
    }
    const std::int64_t give_up_ns = std::max(slot.deadline_ns, now) + options_.period_ns;
    for (;; now = now_ns()) {
        const ssize_t taken = ::write(fd_, frame + done, slot.size - done);
        if (taken > 0) {
            blocked_since_ns_ = 0;
            done += static_cast<std::size_t>(taken);
            if (done == slot.size) break;
            continue;
        }
        if (taken < 0 && errno == EINTR) continue;
        if (taken < 0 && errno != EAGAIN && errno != EWOULDBLOCK) return fail(errno, slot.deadline_ns);
        if (!waited) stalled_.add(1);
        waited = true;
        if (blocked_since_ns_ == 0) blocked_since_ns_ = now;
        if (now - blocked_since_ns_ >= options_.stall_limit_ns) return fail(ETIMEDOUT, slot.deadline_ns);
        if (stop_.load(std::memory_order_relaxed)) return false;
        const bool may_drop = done == 0 && !slot.keep;
        if (may_drop && now >= give_up_ns) {
            dropped_.add(1);
            return true;
        }
        const std::int64_t wait_ns = may_drop ? std::min(kSliceNs, give_up_ns - now) : kSliceNs;
        pollfd poll_fd{fd_, POLLOUT, 0};
        // Milliseconds, rounded up: a short wait must not become a busy loop.
        ::poll(&poll_fd, 1, static_cast<int>((wait_ns + 999'999) / 1'000'000));
        if (poll_fd.revents & kGone) return fail(EIO, slot.deadline_ns);
    }
    // `now` was taken right before the write that took the last byte: a frame is no sample before it is whole.
    slot.lateness_ns = std::max<std::int64_t>(now - slot.deadline_ns, 0);
    sent_.add(1);
    if (!slot.keep) {
        if (last_sent_ns_ != 0) longest_gap_ns_.raise_to(now - last_sent_ns_);
        last_sent_ns_ = now;
    }
    return true;
}

bool RealtimeSender::hung_up() const noexcept {
    pollfd poll_fd{fd_, 0, 0};
    return ::poll(&poll_fd, 1, 0) > 0 && (poll_fd.revents & kGone);
}

// Always false, for `return fail(...)`.
bool RealtimeSender::fail(int code, std::int64_t deadline_ns) noexcept {
    failure_ = {code, deadline_ns};
    failed_.store(true, std::memory_order_release);
    return false;
}

}  // namespace hil::realtime
#endif
