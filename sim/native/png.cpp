#include "png.hpp"

#include <cstring>

#include "crc32.hpp"

namespace hil::sim {
namespace {

void put4(std::uint8_t *at, std::uint32_t value) {
    for (int i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

// A chunk begins at the returned place with its length unknown; `close` fills that in and adds the check.
std::size_t open(std::vector<std::uint8_t> &out, const char *name) {
    const std::size_t at = out.size();
    out.resize(at + 8);
    std::memcpy(&out[at + 4], name, 4);
    return at;
}

void close(std::vector<std::uint8_t> &out, std::size_t at) {
    put4(&out[at], static_cast<std::uint32_t>(out.size() - at - 8));
    const std::uint32_t check = crc32(&out[at + 4], out.size() - at - 4);
    out.resize(out.size() + 4);
    put4(&out[out.size() - 4], check);
}

}  // namespace

void PngEncoder::encode(const PngPicture &p, std::vector<std::uint8_t> &out) {
    const std::size_t pixel = static_cast<std::size_t>(p.components) * p.bytes, row = pixel * p.width;
    rows_.resize((row + 1) * p.height);
    big_.assign(2 * row, 0);
    const std::uint8_t *above = big_.data();  // of zeros, above the first row
    for (std::uint32_t y = 0; y < p.height; ++y) {
        const std::uint8_t *here = p.pixels + row * y;
        if (p.bytes == 2) {
            std::uint8_t *swapped = big_.data() + (y & 1 ? 0 : row);
            for (std::size_t i = 0; i < row; i += 2) {
                std::uint16_t value;
                std::memcpy(&value, here + i, 2);
                swapped[i] = static_cast<std::uint8_t>(value >> 8);
                swapped[i + 1] = static_cast<std::uint8_t>(value);
            }
            here = swapped;
        }
        std::uint8_t *to = rows_.data() + (row + 1) * y;
        *to++ = static_cast<std::uint8_t>(p.filter);
        switch (p.filter) {
            case PngFilter::kNone: std::memcpy(to, here, row); break;
            case PngFilter::kSub:
                std::memcpy(to, here, pixel);
                for (std::size_t i = pixel; i < row; ++i) to[i] = static_cast<std::uint8_t>(here[i] - here[i - pixel]);
                break;
            case PngFilter::kUp:
                for (std::size_t i = 0; i < row; ++i) to[i] = static_cast<std::uint8_t>(here[i] - above[i]);
                break;
        }
        above = here;
    }
    constexpr std::uint8_t kSignature[8] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};
    out.insert(out.end(), kSignature, kSignature + 8);
    std::size_t at = open(out, "IHDR");
    out.resize(at + 8 + 13, 0);
    put4(&out[at + 8], p.width);
    put4(&out[at + 12], p.height);
    out[at + 16] = static_cast<std::uint8_t>(8 * p.bytes);
    out[at + 17] = p.palette ? 3 : (p.components == 3 ? 2 : 0);  // indexed, RGB, grey; then compression, filter set,
    close(out, at);                                              // no interlacing: all 0
    if (p.palette) {
        at = open(out, "PLTE");
        out.insert(out.end(), p.palette, p.palette + 3 * static_cast<std::size_t>(p.palette_size));
        close(out, at);
    }
    at = open(out, "IDAT");
    deflater_.compress(rows_.data(), rows_.size(), out);
    close(out, at);
    close(out, open(out, "IEND"));
}

}  // namespace hil::sim
