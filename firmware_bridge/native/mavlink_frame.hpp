// MAVLink framing: bytes to checked frames and back. Format and contract: firmware_bridge/codecs/mavlink_frame.py.
//
// Plain bytes in and out; nothing is allocated but one entry for each new sender. Views point into the caller's bytes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>

namespace hil::mavlink {

// The facts of a message that framing needs: lengths [bytes] without and with extension fields.
struct MessageShape {
    std::uint8_t crc_extra, base_length, length;
};

using Dialect = std::unordered_map<std::uint32_t, MessageShape>;  // by message id
using Bytes = std::span<const std::uint8_t>;

inline constexpr std::size_t kMaxPayload = 255;
inline constexpr std::size_t kMaxFrame = 10 + kMaxPayload + 2 + 13;  // header, payload, checksum, signature
inline constexpr std::uint32_t kNoFrame = 0xFFFFFFFF;                // message id of bytes outside of frames

// CRC-16/MCRF4XX of `data` and then of the message's crc_extra.
std::uint16_t checksum(Bytes data, std::uint8_t crc_extra);

struct FrameView {
    std::uint32_t msgid;
    std::uint8_t sysid, compid, seq;
    std::uint8_t length;  // of the message's full payload
    Bytes payload;        // as on the wire: shorter than `length` where zeros are truncated, never longer
    Bytes raw;            // the whole frame
};

// Finds the frames of one byte stream. The dialect must outlive it.
class FrameScanner {
   public:
    explicit FrameScanner(const Dialect &dialect) : dialect_(dialect) {}

    // Returns the first good frame at or after `pos`, and moves `pos` to its end. Without one, moves `pos` to where the
    // bytes begin that may be a frame once more of them have come.
    std::optional<FrameView> next(Bytes data, std::size_t &pos);

    std::uint64_t frames = 0;         // good ones
    std::uint64_t bad_crc = 0;        // plausible headers whose checksum failed
    std::uint64_t unknown = 0;        // headers with a message id outside the dialect
    std::uint64_t garbage_bytes = 0;  // outside of good frames
    std::uint64_t lost = 0;           // gaps in the sequence numbers, per sender

   private:
    void count_gap(std::uint8_t sysid, std::uint8_t compid, std::uint8_t seq);

    const Dialect &dialect_;
    std::unordered_map<std::uint16_t, std::uint8_t> next_seq_;  // by system and component
};

struct Unit {
    std::uint32_t msgid;  // kNoFrame: a single byte between frames
    Bytes bytes;
};

// Returns the unit at `pos`, a whole frame or a single byte, and moves `pos` to its end. Frames of messages outside the
// dialect are taken by their length. Nothing if more bytes are needed, unless these are the last ones.
std::optional<Unit> next_unit(const Dialect &dialect, Bytes data, std::size_t &pos, bool last);

// Writes a MAVLink 2 frame, unsigned, the zeros at the payload's end truncated; returns its size. `payload` has at most
// kMaxPayload bytes.
std::size_t encode_frame(std::uint32_t msgid, std::uint8_t crc_extra, std::uint8_t sysid, std::uint8_t compid,
                         std::uint8_t seq, Bytes payload, std::array<std::uint8_t, kMaxFrame> &out);

}  // namespace hil::mavlink
