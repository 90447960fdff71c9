#include "mavlink_frame.hpp"

#include <algorithm>

namespace hil::mavlink {

namespace {

constexpr std::uint8_t kV2 = 0xFD, kV1 = 0xFE;
constexpr std::size_t kHeaderV2 = 10, kHeaderV1 = 6, kCrcBytes = 2, kSignatureBytes = 13;
constexpr std::uint8_t kSigned = 0x01;  // incompatibility flag
constexpr int kLateGap = 240;           // gaps from this on are late frames, up to 16 behind (modulo 256)

constexpr std::array<std::uint16_t, 256> kCrcTable = [] {
    std::array<std::uint16_t, 256> table{};
    for (unsigned i = 0; i < 256; ++i) {
        unsigned crc = i;
        for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ 0x8408 : crc >> 1;
        table[i] = static_cast<std::uint16_t>(crc);
    }
    return table;
}();

bool starts_frame(std::uint8_t byte) { return byte == kV2 || byte == kV1; }

// What the bytes at a start byte say, not yet checked.
struct Header {
    std::uint32_t msgid;
    std::uint8_t length, incompat, seq, sysid, compid;
    std::size_t body, crc_at, end;  // offsets of payload, checksum and of what follows the frame
    bool v2;
};

// Reads the header at the beginning of `d`, which is a start byte. Nothing if it is not complete.
std::optional<Header> read_header(Bytes d) {
    const bool v2 = d[0] == kV2;
    const std::size_t body = v2 ? kHeaderV2 : kHeaderV1;
    if (d.size() < body) return std::nullopt;
    const std::uint8_t length = d[1], incompat = v2 ? d[2] : 0;
    const std::uint32_t msgid = v2 ? d[7] | d[8] << 8 | d[9] << 16 : d[5];
    const Bytes sender = d.subspan(v2 ? 4 : 2, 3);
    const std::size_t crc_at = body + length;
    const std::size_t end = crc_at + kCrcBytes + (incompat ? kSignatureBytes : 0);
    return Header{msgid, length, incompat, sender[0], sender[1], sender[2], body, crc_at, end, v2};
}

bool checksum_holds(Bytes d, const Header &header, std::uint8_t crc_extra) {
    const std::size_t at = header.crc_at;
    return checksum(d.subspan(1, at - 1), crc_extra) == (d[at] | d[at + 1] << 8);
}

}  // namespace

std::uint16_t checksum(Bytes data, std::uint8_t crc_extra) {
    unsigned crc = 0xFFFF;
    const auto add = [&crc](std::uint8_t byte) { crc = crc >> 8 ^ kCrcTable[(crc ^ byte) & 0xFF]; };
    for (const std::uint8_t byte : data) add(byte);
    add(crc_extra);
    return static_cast<std::uint16_t>(crc);
}

std::optional<FrameView> FrameScanner::next(Bytes data, std::size_t &pos) {
    while (pos < data.size()) {
        const Bytes d = data.subspan(pos);
        if (!starts_frame(d[0])) {
            const auto strays = static_cast<std::size_t>(std::ranges::find_if(d, starts_frame) - d.begin());
            garbage_bytes += strays;
            pos += strays;
            continue;
        }
        const std::optional<Header> read = read_header(d);
        if (!read) break;
        const Header &header = *read;
        const auto known = dialect_.find(header.msgid);
        const bool is_known = known != dialect_.end();
        // Frames with unknown incompatibility flags must be discarded (the standard). MAVLink 1 truncates no zeros, so
        // its length must fit as well.
        const bool compatible = !(header.incompat & ~kSigned);
        const bool fits = !is_known || header.v2 ||
                          (known->second.base_length <= header.length && header.length <= known->second.length);
        if (!is_known || !compatible || !fits) {
            unknown += !is_known && compatible;
            ++garbage_bytes;
            ++pos;
            continue;
        }
        if (header.end > d.size()) break;
        const MessageShape shape = known->second;
        if (!checksum_holds(d, header, shape.crc_extra)) {
            ++bad_crc;
            ++garbage_bytes;
            ++pos;
            continue;
        }
        count_gap(header.sysid, header.compid, header.seq);
        ++frames;
        pos += header.end;
        // A newer sender may have more extension fields than are known here; they are ignored.
        const Bytes payload = d.subspan(header.body, std::min(header.length, shape.length));
        return FrameView{header.msgid, header.sysid, header.compid,       header.seq,
                         shape.length, payload,      d.first(header.end)};
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
        // PX4 sends from two threads: a frame that comes a little late was counted as lost before.
        --lost;
    }
}

std::optional<Unit> next_unit(const Dialect &dialect, Bytes data, std::size_t &pos, bool last) {
    if (pos >= data.size()) return std::nullopt;
    const Bytes d = data.subspan(pos);
    const Unit stray{kNoFrame, d.first(1)};
    Unit unit = stray;
    if (starts_frame(d[0])) {
        const std::optional<Header> header = read_header(d);
        if (header && !(header->incompat & ~kSigned)) {
            if (header->end > d.size()) {
                if (!last) return std::nullopt;
            } else {
                const auto known = dialect.find(header->msgid);
                if (known == dialect.end() || checksum_holds(d, *header, known->second.crc_extra)) {
                    unit = {header->msgid, d.first(header->end)};
                }
            }
        } else if (!header && !last) {
            return std::nullopt;
        }
    }
    pos += unit.bytes.size();
    return unit;
}

std::size_t encode_frame(std::uint32_t msgid, std::uint8_t crc_extra, std::uint8_t sysid, std::uint8_t compid,
                         std::uint8_t seq, Bytes payload, std::array<std::uint8_t, kMaxFrame> &out) {
    std::size_t length = payload.size();
    while (length && !payload[length - 1]) --length;
    // The standard keeps at least one byte, even if it is zero.
    const auto kept = static_cast<std::uint8_t>(std::max<std::size_t>(length, 1));
    const std::uint8_t header[kHeaderV2] = {kV2,
                                            kept,
                                            0,
                                            0,
                                            seq,
                                            sysid,
                                            compid,
                                            static_cast<std::uint8_t>(msgid),
                                            static_cast<std::uint8_t>(msgid >> 8),
                                            static_cast<std::uint8_t>(msgid >> 16)};
    std::ranges::copy(header, out.begin());
    out[kHeaderV2] = 0;
    std::ranges::copy(payload.first(length), out.begin() + kHeaderV2);
    const std::size_t crc_at = kHeaderV2 + kept;
    const std::uint16_t crc = checksum({out.data() + 1, crc_at - 1}, crc_extra);
    out[crc_at] = static_cast<std::uint8_t>(crc);
    out[crc_at + 1] = static_cast<std::uint8_t>(crc >> 8);
    return crc_at + kCrcBytes;
}

}  // namespace hil::mavlink
