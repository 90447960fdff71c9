#include "mavlink_frame.hpp"

#include <algorithm>
#include <array>

namespace hil::mavlink {

namespace {

constexpr std::uint8_t kV2 = 0xFD, kV1 = 0xFE;
constexpr std::size_t kHeaderV2 = 10, kHeaderV1 = 6, kCrcBytes = 2, kSignatureBytes = 13;
constexpr std::uint8_t kSigned = 0x01;  // incompatibility flag
constexpr int kLateGap = 240;           // a sequence number this far ahead is one that is up to 16 behind

constexpr std::array<std::uint16_t, 256> kCrcTable = [] {
    std::array<std::uint16_t, 256> table{};
    for (unsigned i = 0; i < 256; ++i) {
        unsigned crc = i;
        for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ 0x8408 : crc >> 1;
        table[i] = static_cast<std::uint16_t>(crc);
    }
    return table;
}();

// CRC-16/MCRF4XX of `data` and then of the message's crc_extra.
std::uint16_t checksum(Bytes data, std::uint8_t crc_extra) {
    unsigned crc = 0xFFFF;
    const auto add = [&crc](std::uint8_t byte) { crc = crc >> 8 ^ kCrcTable[(crc ^ byte) & 0xFF]; };
    for (const std::uint8_t byte : data) add(byte);
    add(crc_extra);
    return static_cast<std::uint16_t>(crc);
}

}  // namespace

std::optional<FrameView> FrameScanner::next(Bytes data, std::size_t &pos) {
    while (pos < data.size()) {
        const Bytes d = data.subspan(pos);
        const bool v2 = d[0] == kV2;
        if (!v2 && d[0] != kV1) {
            const auto start = std::ranges::find_if(d, [](std::uint8_t byte) { return byte == kV2 || byte == kV1; });
            garbage_bytes += start - d.begin();
            pos += start - d.begin();
            continue;
        }
        const std::size_t header = v2 ? kHeaderV2 : kHeaderV1;
        if (d.size() < header) break;
        const std::uint8_t length = d[1];
        const std::uint8_t incompat = v2 ? d[2] : 0;
        const std::uint32_t msgid = v2 ? d[7] | d[8] << 8 | d[9] << 16 : d[5];
        const auto known = dialect_.find(msgid);
        // The standard: frames with incompatibility flags that one does not know must be thrown away. MAVLink 1 cuts no
        // zeros, so there the length tells too.
        const bool plausible = v2 ? !(incompat & ~kSigned)
                                  : known == dialect_.end() ||
                                        (known->second.base_length <= length && length <= known->second.length);
        if (known == dialect_.end() || !plausible) {
            unknown += plausible;
            ++garbage_bytes;
            ++pos;
            continue;
        }
        const MessageShape shape = known->second;
        const std::size_t crc_at = header + length;
        const std::size_t end = crc_at + kCrcBytes + (incompat ? kSignatureBytes : 0);
        if (end > d.size()) break;
        if (checksum(d.subspan(1, crc_at - 1), shape.crc_extra) != (d[crc_at] | d[crc_at + 1] << 8)) {
            ++bad_crc;
            ++garbage_bytes;
            ++pos;
            continue;
        }
        const std::uint8_t *const sender = d.data() + (v2 ? 4 : 2);
        const std::uint8_t seq = sender[0], sysid = sender[1], compid = sender[2];
        count_gap(sysid, compid, seq);
        ++frames;
        pos += end;
        // A newer sender may know more extension fields: what is behind those known here is not ours.
        const Bytes payload = d.subspan(header, std::min(length, shape.length));
        return FrameView{msgid, sysid, compid, seq, shape.length, payload, d.first(end)};
    }
    return std::nullopt;
}

void FrameScanner::count_gap(std::uint8_t sysid, std::uint8_t compid, std::uint8_t seq) {
    const auto key = static_cast<std::uint16_t>(sysid << 8 | compid);
    const auto after = static_cast<std::uint8_t>(seq + 1);
    const auto [expected, is_new] = next_seq_.try_emplace(key, after);
    if (is_new) return;
    const auto gap = static_cast<std::uint8_t>(seq - expected->second);
    if (gap < kLateGap) {
        lost += gap;
        expected->second = after;
    } else if (lost) {
        // PX4 sends from two threads: a frame that comes a little late was counted as lost, and is not.
        --lost;
    }
}

std::size_t encode_frame(std::uint32_t msgid, std::uint8_t crc_extra, std::uint8_t sysid, std::uint8_t compid,
                         std::uint8_t seq, Bytes payload, std::uint8_t *out) {
    std::size_t length = payload.size();
    while (length && !payload[length - 1]) --length;
    const std::uint8_t header[kHeaderV2] = {kV2,
                                            // At least one byte stays, even if it is zero: the standard's rule.
                                            static_cast<std::uint8_t>(std::max<std::size_t>(length, 1)),
                                            0,
                                            0,
                                            seq,
                                            sysid,
                                            compid,
                                            static_cast<std::uint8_t>(msgid),
                                            static_cast<std::uint8_t>(msgid >> 8),
                                            static_cast<std::uint8_t>(msgid >> 16)};
    std::copy_n(header, kHeaderV2, out);
    out[kHeaderV2] = 0;
    std::copy_n(payload.data(), length, out + kHeaderV2);
    const std::size_t crc_at = kHeaderV2 + header[1];
    const std::uint16_t crc = checksum({out + 1, crc_at - 1}, crc_extra);
    out[crc_at] = static_cast<std::uint8_t>(crc);
    out[crc_at + 1] = static_cast<std::uint8_t>(crc >> 8);
    return crc_at + kCrcBytes;
}

}  // namespace hil::mavlink
