// Python face of the real-time sender. Thin: what is refused is refused here, with what to do.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <system_error>
#include <vector>

#ifndef _WIN32
#include "realtime_sender.hpp"
#endif

namespace nb = nanobind;
using namespace nb::literals;

#ifdef _WIN32
void bind_realtime_sender(nb::module_ &) {}  // no POSIX descriptors to send on
#else

using hil::realtime::RealtimeSender;
using hil::realtime::SenderOptions;

namespace {

void make_sender(RealtimeSender *self, int fd, std::int64_t period_ns, std::size_t slots, std::size_t slot_bytes,
                 std::int64_t spin_ns, std::int64_t stall_limit_ns, std::int64_t stale_ns,
                 int priority, bool lock_memory) {
    constexpr std::size_t kMost = 1 << 20;
    if (period_ns <= 0) throw nb::value_error("period_ns must be above 0");
    if (slots < 1 || slots > kMost) throw nb::value_error("slots must be from 1 to 1048576");
    if (slot_bytes < 1 || slot_bytes > kMost) throw nb::value_error("slot_bytes must be from 1 to 1048576");
    if (spin_ns < 0 || spin_ns >= period_ns) throw nb::value_error("spin_ns must be from 0 to below period_ns");
    if (stall_limit_ns <= 0) throw nb::value_error("stall_limit_ns must be above 0");
    if (stale_ns < 0) throw nb::value_error("stale_ns must not be below 0");
    if (priority < 0 || priority > 99) throw nb::value_error("priority must be from 0 (normal scheduling) to 99");
    const SenderOptions options{slots, slot_bytes, period_ns, spin_ns, stall_limit_ns, stale_ns, priority,
                                lock_memory};
    try {
        const nb::gil_scoped_release release;
        new (self) RealtimeSender(fd, options);
    } catch (const std::system_error &error) {
        errno = error.code().value();
        PyErr_SetFromErrno(PyExc_OSError);
        throw nb::python_error();
    }
}

bool push(RealtimeSender &sender, std::int64_t deadline_ns, const nb::bytes &frame, bool keep) {
    if (frame.size() == 0) throw nb::value_error("there is nothing to send");
    switch (sender.push(deadline_ns, {frame.c_str(), frame.size()}, keep)) {
        case RealtimeSender::Push::Taken: return true;
        case RealtimeSender::Push::NotTaken: return false;
        case RealtimeSender::Push::TooLong: break;
    }
    throw nb::value_error((std::to_string(frame.size()) + " bytes in one frame, a slot holds " +
                           std::to_string(sender.options().slot_bytes) + ": give the sender a larger slot_bytes")
                              .c_str());
}

nb::list lateness_bins(const RealtimeSender &sender) {
    nb::list bins;
    for (std::size_t i = 0; i < hil::realtime::kBins; ++i) bins.append(sender.lateness().bin(i));
    return bins;
}

nb::list worst(const RealtimeSender &sender) {
    auto sends = sender.lateness().worst.read();
    std::sort(sends.begin(), sends.end(), [](const auto &a, const auto &b) { return a.index < b.index; });
    nb::list out;
    for (const auto &s : sends) out.append(nb::make_tuple(s.index, s.deadline_ns, s.lateness_ns));
    return out;
}

nb::object error(const RealtimeSender &sender) {
    if (!sender.failed()) return nb::none();
    return nb::make_tuple(sender.failure().code, sender.failure().deadline_ns);
}

}  // namespace

void bind_realtime_sender(nb::module_ &m) {
    m.def("lateness_bin", &hil::realtime::lateness_bin, "duration_ns"_a,
          "Number of the bin a duration is counted in; the bins are those of hil.signals.latency.LatencyHistogram.");
    nb::class_<RealtimeSender>(
        m, "RealtimeSender",
        "Writes frames to a descriptor at absolute deadlines of time.monotonic_ns(), from a native thread with real-time "
        "priority where the user has the right to one. `push` belongs to one thread; all else may be called from any.")
        .def("__init__", &make_sender, "fd"_a, nb::kw_only(), "period_ns"_a, "slots"_a = 64, "slot_bytes"_a = 4096,
             "spin_ns"_a = 0, "stall_limit_ns"_a = std::int64_t{5'000'000'000}, "stale_ns"_a = 0,
             "priority"_a = 80, "lock_memory"_a = true,
             "Makes `fd` non-blocking and sends on a duplicate of it until `stop`. OSError if it is no descriptor.")
        .def("push", &push, "deadline_ns"_a, "frame"_a.noconvert(), "keep"_a = false,
             "Puts one frame in line; never waits. False: the ring is full, or the sender stopped or failed (see `error`). "
             "`keep`: send it however late (commands); others are left out once stale.")
        .def("stop", &RealtimeSender::stop, nb::call_guard<nb::gil_scoped_release>(),
             "Ends the thread; frames whose deadline has not come stay unsent (`pending`). Any number of times.")
        .def_prop_ro("error", &error,
                     "None, or (errno, deadline_ns of the frame that met it) of what ended the sending. ETIMEDOUT: the line "
                     "took nothing for stall_limit_ns; EIO: the device failed, or hung up.")
        .def_prop_ro("scheduling", &RealtimeSender::scheduling, "What the thread was granted, in words, with the remedy.")
        .def_prop_ro("pushed", &RealtimeSender::pushed, "Frames taken from the producer.")
        .def_prop_ro("refused", &RealtimeSender::refused, "Frames for which `push` was False.")
        .def_prop_ro("pending", &RealtimeSender::pending, "Frames taken but neither sent nor dropped.")
        .def_prop_ro("sent", [](const RealtimeSender &s) { return s.lateness().count.get(); }, "Frames written whole.")
        .def_prop_ro("stalled", &RealtimeSender::stalled, "Frames that met a full line and had to wait for room.")
        .def_prop_ro("dropped", &RealtimeSender::dropped, "Frames left out: stale, or no room until a period after their deadline.")
        .def_prop_ro("stale", &RealtimeSender::stale, "Frames left out because they were more than stale_ns late.")
        .def_prop_ro("longest_gap_ns", &RealtimeSender::longest_gap_ns,
                     "Longest time from one frame written to the next, kept ones not counted.")
        .def_prop_ro("max_lateness_ns", [](const RealtimeSender &s) { return s.lateness().max_ns.get(); })
        .def_prop_ro("total_lateness_ns", [](const RealtimeSender &s) { return s.lateness().total_ns.get(); })
        .def_prop_ro("late_2ms", [](const RealtimeSender &s) { return s.lateness().over_2ms.get(); },
                     "Frames written more than 2 ms late.")
        .def_prop_ro("late_20ms", [](const RealtimeSender &s) { return s.lateness().over_20ms.get(); },
                     "Frames written more than 20 ms late.")
        .def("lateness_bins", &lateness_bins, "Count of every bin of LatencyHistogram, empty ones included.")
        .def("worst", &worst,
             "(index, deadline_ns, lateness_ns) of the up to 256 worst of the sends over 2 ms, by index. Index 0 is the "
             "first frame taken.");
}
#endif
