// MAVLink frames: found and checked in bytes, and made. Format: firmware_bridge/codecs/mavlink_frame.py.
//
// Plain bytes in and out; nothing is allocated but one entry for each new sender. A view that is returned points into the
// caller's bytes. The exact reference in Python is tests/reference/mavlink_frame_reference.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>

namespace hil::mavlink {

// What framing needs to know of a message: lengths in bytes without and with extension fields.
struct MessageShape {
    std::uint8_t crc_extra, base_length, length;
};

using Dialect = std::unordered_map<std::uint32_t, MessageShape>;  // by message id
using Bytes = std::span<const std::uint8_t>;

inline constexpr std::size_t kLongestFrame = 10 + 255 + 2 + 13;  // header, payload, checksum, signature

struct FrameView {
    std::uint32_t msgid;
    std::uint8_t sysid, compid, seq;
    std::uint8_t length;  // of the message's full payload
    Bytes payload;        // as it was on the wire: shorter than `length` where zeros were cut, never longer
    Bytes raw;            // the whole frame
};

// Finds the frames of one byte stream. The dialect must outlive it.
class FrameScanner {
   public:
    explicit FrameScanner(const Dialect &dialect) : dialect_(dialect) {}

    // The first good frame at or behind `pos`, which goes on to its end; without one, to where the bytes begin that may
    // be a frame once more of them are there.
    std::optional<FrameView> next(Bytes data, std::size_t &pos);

    std::size_t senders() const { return next_seq_.size(); }

    std::uint64_t frames = 0;         // good ones
    std::uint64_t bad_crc = 0;        // headers that made sense but whose checksum failed
    std::uint64_t unknown = 0;        // headers with a message id outside the dialect
    std::uint64_t garbage_bytes = 0;  // that belong to no good frame
    std::uint64_t lost = 0;           // gaps in the sequence numbers, per sender

   private:
    void count_gap(std::uint8_t sysid, std::uint8_t compid, std::uint8_t seq);

    const Dialect &dialect_;
    std::unordered_map<std::uint16_t, std::uint8_t> next_seq_;  // by system and component
};

// Writes a MAVLink 2 frame, unsigned, the payload's zeros at the end cut; returns its size. `payload` has at most 255
// bytes, `out` room for kLongestFrame.
std::size_t encode_frame(std::uint32_t msgid, std::uint8_t crc_extra, std::uint8_t sysid, std::uint8_t compid,
                         std::uint8_t seq, Bytes payload, std::uint8_t *out);

}  // namespace hil::mavlink
