// firmware_bridge._native.MavlinkDialect, FrameParser, FrameEncoder (contract: firmware_bridge/codecs/mavlink_frame.py),
// read_actuator_controls.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "mavlink_frame.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using namespace hil::mavlink;

PyObject *checked(PyObject *made) {
    if (!made) throw nb::python_error();
    return made;
}

// Steals `value`.
void set_item(PyObject *tuple, Py_ssize_t index, PyObject *value) {
    if (PyTuple_SetItem(tuple, index, checked(value))) throw nb::python_error();
}

PyObject *bytes_of(Bytes view) {
    return PyBytes_FromStringAndSize(reinterpret_cast<const char *>(view.data()), static_cast<Py_ssize_t>(view.size()));
}

Bytes view_of(const nb::bytes &data) { return {static_cast<const std::uint8_t *>(data.data()), data.size()}; }

class MavlinkDialect {
   public:
    MavlinkDialect(const nb::dict &shapes, const nb::type_object &frame) : frame_(frame) {
        for (const auto [msgid, shape] : shapes) {
            shapes_[nb::cast<std::uint32_t>(msgid)] = {nb::cast<std::uint8_t>(shape[0]), nb::cast<std::uint8_t>(shape[1]),
                                                       nb::cast<std::uint8_t>(shape[2])};
        }
    }

    const Dialect &shapes() const { return shapes_; }

    MessageShape shape(std::uint32_t msgid) const {
        const auto found = shapes_.find(msgid);
        if (found == shapes_.end()) throw nb::key_error(std::to_string(msgid).c_str());
        return found->second;
    }

    nb::object frame(const FrameView &view) const {
        // As tuple.__new__ makes an object of a subclass: without the Python code of the NamedTuple's own __new__.
        const nb::object made =
            nb::steal(checked(PyType_GenericAlloc(reinterpret_cast<PyTypeObject *>(frame_.ptr()), 6)));
        PyObject *const payload = PyBytes_FromStringAndSize(nullptr, view.length);
        set_item(made.ptr(), 0, PyLong_FromUnsignedLong(view.msgid));
        set_item(made.ptr(), 1, PyLong_FromLong(view.sysid));
        set_item(made.ptr(), 2, PyLong_FromLong(view.compid));
        set_item(made.ptr(), 3, PyLong_FromLong(view.seq));
        set_item(made.ptr(), 4, payload);
        set_item(made.ptr(), 5, bytes_of(view.raw));
        auto *const bytes = reinterpret_cast<std::uint8_t *>(PyBytes_AsString(payload));
        std::fill(std::ranges::copy(view.payload, bytes).out, bytes + view.length, std::uint8_t{0});
        return made;
    }

    nb::tuple split(const nb::bytes &data, bool last) const {
        nb::list units;
        std::size_t pos = 0;
        while (const auto unit = next_unit(shapes_, view_of(data), pos, last)) {
            units.append(nb::make_tuple(unit->msgid, nb::steal(checked(bytes_of(unit->bytes)))));
        }
        return nb::make_tuple(units, pos);
    }

    nb::bytes with_checksum(const nb::bytes &body, std::uint32_t msgid) const {
        const std::uint8_t crc_extra = shape(msgid).crc_extra;
        if (!body.size()) throw nb::value_error("a frame has a start byte");
        const std::uint16_t crc = checksum(view_of(body).subspan(1), crc_extra);
        std::string out(body.c_str(), body.size());
        out += {static_cast<char>(crc & 0xFF), static_cast<char>(crc >> 8)};
        return nb::bytes(out.data(), out.size());
    }

   private:
    Dialect shapes_;
    nb::type_object frame_;
};

class FrameParser {
   public:
    explicit FrameParser(const MavlinkDialect &dialect) : scanner(dialect.shapes()), dialect_(dialect) {}

    nb::list feed(const nb::bytes &data) {
        nb::list frames;
        if (pending_.empty()) {
            const std::size_t end = scan(view_of(data), 0, frames);
            pending_.assign(data.c_str() + end, data.size() - end);
        } else {
            pending_.append(data.c_str(), data.size());
            pending_.erase(0, scan(held_back(), 0, frames));
        }
        return frames;
    }

    nb::list rescan() {
        nb::list frames;
        const std::uint64_t bad_crc = scanner.bad_crc, garbage = scanner.garbage_bytes, unknown = scanner.unknown;
        std::size_t end = 0, good = 0;
        // Each header that waits for more bytes may be false: continue after each of them in turn.
        while (!frames.size() && end + 1 < pending_.size()) end = scan(held_back(), end + 1, frames, &good);
        scanner.bad_crc = bad_crc;
        scanner.garbage_bytes = garbage;
        scanner.unknown = unknown;
        if (frames.size()) {
            scanner.garbage_bytes += end - good;
            pending_.erase(0, end);
        }
        return frames;
    }

    std::size_t pending() const { return pending_.size(); }

    FrameScanner scanner;

   private:
    Bytes held_back() const { return {reinterpret_cast<const std::uint8_t *>(pending_.data()), pending_.size()}; }

    // Appends the frames from `pos` on, adds their bytes to `good`, and returns where the bytes begin that must wait.
    std::size_t scan(Bytes bytes, std::size_t pos, nb::list &frames, std::size_t *good = nullptr) {
        while (const auto view = scanner.next(bytes, pos)) {
            frames.append(dialect_.frame(*view));
            if (good) *good += view->raw.size();
        }
        return pos;
    }

    const MavlinkDialect &dialect_;
    std::string pending_;
};

class FrameEncoder {
   public:
    FrameEncoder(const MavlinkDialect &dialect, int sysid, int compid) : dialect_(dialect) {
        if (sysid < 1 || sysid > 255 || compid < 1 || compid > 255) {
            const std::string given = std::to_string(sysid) + " and " + std::to_string(compid);
            throw nb::value_error(("sysid and compid must be 1..255, not " + given).c_str());
        }
        sysid_ = static_cast<std::uint8_t>(sysid);
        compid_ = static_cast<std::uint8_t>(compid);
    }

    nb::bytes frame(std::uint32_t msgid, const nb::bytes &payload) {
        const std::uint8_t crc_extra = dialect_.shape(msgid).crc_extra;
        if (payload.size() > kMaxPayload) throw nb::value_error("a payload has at most 255 bytes");
        std::array<std::uint8_t, kMaxFrame> out;
        const std::size_t size = encode_frame(msgid, crc_extra, sysid_, compid_, seq_++, view_of(payload), out);
        return nb::bytes(out.data(), size);
    }

    int sysid() const { return sysid_; }
    int compid() const { return compid_; }

   private:
    const MavlinkDialect &dialect_;
    std::uint8_t sysid_, compid_, seq_ = 0;
};

// HIL_ACTUATOR_CONTROLS on the wire, little-endian: time_usec, flags, controls, mode.
constexpr std::size_t kControls = 16, kControlsAt = 16, kModeAt = kControlsAt + 4 * kControls;

std::uint64_t little_endian(Bytes bytes) {
    std::uint64_t value = 0;
    for (std::size_t i = bytes.size(); i-- > 0;) value = value << 8 | bytes[i];
    return value;
}

nb::tuple read_actuator_controls(const nb::bytes &payload) {
    const Bytes bytes = view_of(payload);
    if (bytes.size() <= kModeAt) throw nb::value_error("the payload is too short for HIL_ACTUATOR_CONTROLS");
    nb::object controls = nb::steal(checked(PyTuple_New(kControls)));
    bool in_range = true;
    for (std::size_t i = 0; i < kControls; ++i) {
        const auto word = static_cast<std::uint32_t>(little_endian(bytes.subspan(kControlsAt + 4 * i, 4)));
        const double control = std::bit_cast<float>(word);
        in_range = in_range && -1.0 <= control && control <= 1.0;  // false for NaN
        set_item(controls.ptr(), static_cast<Py_ssize_t>(i), PyFloat_FromDouble(control));
    }
    return nb::make_tuple(little_endian(bytes.first(8)), controls, bytes[kModeAt], in_range);
}

template <std::uint64_t FrameScanner::*counter>
std::uint64_t count(const FrameParser &parser) {
    return parser.scanner.*counter;
}

}  // namespace

void bind_mavlink_frame(nb::module_ &m) {
    nb::class_<MavlinkDialect>(m, "MavlinkDialect", "The messages that framing knows.")
        .def(nb::init<const nb::dict &, const nb::type_object &>(), "shapes"_a, "frame"_a,
             "`shapes`: crc_extra and lengths without and with extension fields, by message id. `frame`: the NamedTuple of "
             "a frame.")
        .def("split", &MavlinkDialect::split, "data"_a, "last"_a,
             "Return (message id, unit) of each unit of `data`, and the index of bytes that must wait, unless `last`.")
        .def("with_checksum", &MavlinkDialect::with_checksum, "body"_a, "msgid"_a,
             "Return a frame, given from start byte to payload, with its checksum appended.");
    nb::class_<FrameParser>(m, "FrameParser", "Incremental parser of one byte stream.")
        .def(nb::init<const MavlinkDialect &>(), "dialect"_a, nb::keep_alive<1, 2>())
        .def("feed", &FrameParser::feed, "data"_a, "Take `data` and return the frames that it completes.")
        .def("rescan", &FrameParser::rescan, "Return whole frames inside the bytes held back, or [].")
        .def_prop_ro("pending", &FrameParser::pending,
                     "Number of bytes held back because they may begin a frame.")
        .def_prop_ro("frames", &count<&FrameScanner::frames>)
        .def_prop_ro("bad_crc", &count<&FrameScanner::bad_crc>)
        .def_prop_ro("unknown", &count<&FrameScanner::unknown>)
        .def_prop_ro("garbage_bytes", &count<&FrameScanner::garbage_bytes>)
        .def_prop_ro("lost", &count<&FrameScanner::lost>);
    nb::class_<FrameEncoder>(m, "FrameEncoder", "Makes the frames of one sender and holds its sequence number.")
        .def(nb::init<const MavlinkDialect &, int, int>(), "dialect"_a, "sysid"_a, "compid"_a, nb::keep_alive<1, 2>())
        .def_prop_ro("sysid", &FrameEncoder::sysid)
        .def_prop_ro("compid", &FrameEncoder::compid)
        .def("frame", &FrameEncoder::frame, "msgid"_a, "payload"_a, "Return the bytes of one frame.");
    m.def("read_actuator_controls", &read_actuator_controls, "payload"_a,
          "Return time [us], the 16 controls, mode and whether all controls are within -1..1, of HIL_ACTUATOR_CONTROLS.");
}
