// Python face of the real-time sender. Thin: what is refused is refused here, with what to do.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cerrno>
#include <string>
#include <system_error>

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
                 std::int64_t stall_limit_ns, std::int64_t stale_ns) {
    constexpr std::size_t kMost = 1 << 20;
    if (period_ns <= 0) throw nb::value_error("period_ns must be above 0");
    if (slots < 1 || slots > kMost) throw nb::value_error("slots must be from 1 to 1048576");
    if (slot_bytes < 1 || slot_bytes > kMost) throw nb::value_error("slot_bytes must be from 1 to 1048576");
    if (stall_limit_ns <= 0) throw nb::value_error("stall_limit_ns must be above 0");
    if (stale_ns < 0) throw nb::value_error("stale_ns must not be below 0");
    const SenderOptions options{slots, slot_bytes, period_ns, stall_limit_ns, stale_ns};
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

nb::object error(const RealtimeSender &sender) {
    if (!sender.failed()) return nb::none();
    return nb::make_tuple(sender.failure().code, sender.failure().deadline_ns);
}

}  // namespace

void bind_realtime_sender(nb::module_ &m) {
    nb::class_<RealtimeSender>(
        m, "RealtimeSender",
        "Writes frames to a descriptor at absolute deadlines of time.monotonic_ns(), from a native thread with real-time "
        "priority where the user has the right to one. `push` belongs to one thread; all else may be called from any.")
        .def("__init__", &make_sender, "fd"_a, nb::kw_only(), "period_ns"_a, "slots"_a = 64, "slot_bytes"_a = 4096,
             "stall_limit_ns"_a = std::int64_t{5'000'000'000}, "stale_ns"_a = 0,
             "Makes `fd` non-blocking and sends on a duplicate of it until `stop`. OSError if it is no descriptor.")
        .def("push", &push, "deadline_ns"_a, "frame"_a.noconvert(), "keep"_a = false,
             "Puts one frame in line; never waits. False: the ring is full, or the sender stopped or failed (see `error`). "
             "`keep`: send it however late (commands); others are left out once stale.")
        .def("stop", &RealtimeSender::stop, nb::call_guard<nb::gil_scoped_release>(),
             "Ends the thread; frames whose deadline has not come stay unsent (`pending`). Any number of times.")
        .def_prop_ro("error", &error, nb::for_getter(nb::sig("def error(self) -> tuple[int, int] | None")),
                     "None, or (errno, deadline_ns of the frame that met it) of what ended the sending. ETIMEDOUT: the line "
                     "took nothing for stall_limit_ns; EIO: the device failed, or hung up.")
        .def_prop_ro("scheduling", &RealtimeSender::scheduling, "What the thread was granted, in words, with the remedy.")
        .def_prop_ro("pushed", &RealtimeSender::pushed, "Frames taken from the producer.")
        .def_prop_ro("refused", &RealtimeSender::refused, "Frames for which `push` was False.")
        .def_prop_ro("pending", &RealtimeSender::pending, "Frames taken but neither sent nor dropped.")
        .def_prop_ro("sent", &RealtimeSender::sent, "Frames written whole.")
        .def_prop_ro("stalled", &RealtimeSender::stalled, "Frames that met a full line and had to wait for room.")
        .def_prop_ro("dropped", &RealtimeSender::dropped, "Frames left out: stale, or no room until a period after their deadline.")
        .def_prop_ro("longest_gap_ns", &RealtimeSender::longest_gap_ns,
                     "Longest time from one frame written to the next, kept ones not counted.")
        .def("take_lateness", &RealtimeSender::take_lateness,
             "How late each frame left that was sent since the last call [ns], in order.");
}
#endif
