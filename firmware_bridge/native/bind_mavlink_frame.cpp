// firmware_bridge._native.Dialect, FrameParser, FrameEncoder. Contract: codecs/mavlink_frame.py, whose classes these
// are the bases of, and mavlink_frame.hpp.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <cstdint>
#include <string>

#include "mavlink_frame.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using namespace hil::mavlink;

struct PyDialect {
    Dialect shapes;
    nb::type_object frame;  // a NamedTuple
};

PyObject *checked(PyObject *made) {
    if (!made) throw nb::python_error();
    return made;
}

nb::object frame_object(const PyDialect &dialect, const FrameView &view) {
    const auto payload = nb::steal<nb::bytes>(checked(PyBytes_FromStringAndSize(nullptr, view.length)));
    auto *const bytes = reinterpret_cast<std::uint8_t *>(PyBytes_AS_STRING(payload.ptr()));
    std::fill(std::ranges::copy(view.payload, bytes).out, bytes + view.length, std::uint8_t{0});
    const nb::tuple fields = nb::make_tuple(view.msgid, view.sysid, view.compid, view.seq, payload,
                                            nb::bytes(view.raw.data(), view.raw.size()));
    // As `Frame._make` does it, past the NamedTuple's own __new__, which is written in Python.
    const nb::tuple arguments = nb::make_tuple(fields);
    auto *const type = reinterpret_cast<PyTypeObject *>(dialect.frame.ptr());
    return nb::steal(checked(PyTuple_Type.tp_new(type, arguments.ptr(), nullptr)));
}

class FrameParser {
   public:
    explicit FrameParser(const PyDialect &dialect) : scanner(dialect.shapes), dialect_(dialect) {}

    nb::list feed(nb::bytes data) {
        nb::list frames;
        if (pending_.empty()) {
            const Bytes bytes{static_cast<const std::uint8_t *>(data.data()), data.size()};
            const std::size_t end = scan(bytes, 0, frames);
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
        std::size_t end = 0, raw_bytes = 0;
        // Each header that waits for more may itself be false: go on behind each of them in turn.
        while (!frames.size() && end + 1 < pending_.size()) end = scan(held_back(), end + 1, frames, &raw_bytes);
        scanner.bad_crc = bad_crc;
        scanner.garbage_bytes = garbage;
        scanner.unknown = unknown;
        if (frames.size()) {
            scanner.garbage_bytes += end - raw_bytes;
            pending_.erase(0, end);
        }
        return frames;
    }

    std::size_t pending() const { return pending_.size(); }

    FrameScanner scanner;

   private:
    Bytes held_back() const { return {reinterpret_cast<const std::uint8_t *>(pending_.data()), pending_.size()}; }

    std::size_t scan(Bytes bytes, std::size_t pos, nb::list &frames, std::size_t *raw_bytes = nullptr) {
        while (const auto view = scanner.next(bytes, pos)) {
            frames.append(frame_object(dialect_, *view));
            if (raw_bytes) *raw_bytes += view->raw.size();
        }
        return pos;
    }

    const PyDialect &dialect_;
    std::string pending_;
};

class FrameEncoder {
   public:
    FrameEncoder(const PyDialect &dialect, int sysid, int compid) : dialect_(dialect) {
        if (sysid < 1 || sysid > 255 || compid < 1 || compid > 255) {
            throw nb::value_error(("sysid and compid must be 1..255, not " + std::to_string(sysid) + " and " +
                                   std::to_string(compid)).c_str());
        }
        sysid_ = static_cast<std::uint8_t>(sysid);
        compid_ = static_cast<std::uint8_t>(compid);
    }

    nb::bytes frame(std::uint32_t msgid, nb::bytes payload) {
        const auto shape = dialect_.shapes.find(msgid);
        if (shape == dialect_.shapes.end()) throw nb::key_error(std::to_string(msgid).c_str());
        if (payload.size() > 255) throw nb::value_error("a payload has at most 255 bytes");
        std::uint8_t out[kLongestFrame];
        const Bytes bytes{static_cast<const std::uint8_t *>(payload.data()), payload.size()};
        const std::size_t size = encode_frame(msgid, shape->second.crc_extra, sysid_, compid_, seq_++, bytes, out);
        return nb::bytes(out, size);
    }

    int sysid() const { return sysid_; }
    int compid() const { return compid_; }

   private:
    const PyDialect &dialect_;
    std::uint8_t sysid_, compid_, seq_ = 0;
};

template <std::uint64_t FrameScanner::*counter>
std::uint64_t count(const FrameParser &parser) {
    return parser.scanner.*counter;
}

}  // namespace

void bind_mavlink_frame(nb::module_ &m) {
    m.attr("MAX_FRAME_LENGTH") = kLongestFrame;
    nb::class_<PyDialect>(m, "Dialect")
        .def(
            "__init__",
            [](PyDialect *self, nb::dict shapes, nb::type_object frame) {
                new (self) PyDialect{{}, frame};
                for (const auto [msgid, shape] : shapes) {
                    self->shapes[nb::cast<std::uint32_t>(msgid)] = {nb::cast<std::uint8_t>(shape[0]),
                                                                    nb::cast<std::uint8_t>(shape[1]),
                                                                    nb::cast<std::uint8_t>(shape[2])};
                }
            },
            "shapes"_a, "frame"_a,
            "`shapes`: crc_extra and length without and with extension fields, by message id. `frame`: the NamedTuple that "
            "frames are given as.");
    nb::class_<FrameParser>(m, "FrameParser")
        .def(nb::init<const PyDialect &>(), "dialect"_a, nb::keep_alive<1, 2>())
        .def("feed", &FrameParser::feed, "data"_a, "Take `data` and return the frames that it completes.")
        .def("rescan", &FrameParser::rescan,
             "Whole frames inside the bytes held back, or [].\n\n"
             "A damaged length byte makes the parser wait for bytes that never come while a good frame sits inside what it "
             "holds. A caller that sees the line go quiet calls this; if nothing whole is inside, nothing changes, so that "
             "a frame which is merely slow is not lost.")
        .def_prop_ro("pending", &FrameParser::pending, "Bytes held back because they may be the beginning of a frame.")
        .def_prop_ro("senders", [](const FrameParser &p) { return p.scanner.senders(); })
        .def_prop_ro("frames", &count<&FrameScanner::frames>)
        .def_prop_ro("bad_crc", &count<&FrameScanner::bad_crc>)
        .def_prop_ro("unknown", &count<&FrameScanner::unknown>)
        .def_prop_ro("garbage_bytes", &count<&FrameScanner::garbage_bytes>)
        .def_prop_ro("lost", &count<&FrameScanner::lost>);
    nb::class_<FrameEncoder>(m, "FrameEncoder")
        .def(nb::init<const PyDialect &, int, int>(), "dialect"_a, "sysid"_a, "compid"_a, nb::keep_alive<1, 2>())
        .def_prop_ro("sysid", &FrameEncoder::sysid)
        .def_prop_ro("compid", &FrameEncoder::compid)
        .def("frame", &FrameEncoder::frame, "msgid"_a, "payload"_a,
             "The bytes of one frame. `payload` is the whole payload of a message of the dialect (KeyError otherwise).");
}
