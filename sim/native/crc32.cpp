#include "crc32.hpp"

#include <array>

#include "frame/isa.hpp"

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HIL_CARRYLESS 1
#include <immintrin.h>
#endif

namespace hil::sim {
namespace {

constexpr std::uint32_t kPolynomial = 0xedb88320u;

constexpr std::uint32_t times_x(std::uint32_t c) { return c & 1 ? kPolynomial ^ (c >> 1) : c >> 1; }

// t[n][b]: what byte b, followed by n bytes of zeros, leaves.
struct Tables {
    std::array<std::array<std::uint32_t, 256>, 8> t{};

    constexpr Tables() {
        for (std::uint32_t i = 0; i < 256; ++i) {
            std::uint32_t c = i;
            for (int k = 0; k < 8; ++k) c = times_x(c);
            t[0][i] = c;
        }
        for (std::size_t n = 1; n < 8; ++n)
            for (std::uint32_t i = 0; i < 256; ++i) t[n][i] = (t[n - 1][i] >> 8) ^ t[0][t[n - 1][i] & 255];
    }
};

constexpr Tables kTables;

std::uint32_t load4(const std::uint8_t *p) {
    return static_cast<std::uint32_t>(p[0]) | static_cast<std::uint32_t>(p[1]) << 8 |
           static_cast<std::uint32_t>(p[2]) << 16 | static_cast<std::uint32_t>(p[3]) << 24;
}

// `c`: the register, not inverted.
std::uint32_t by_tables(const std::uint8_t *p, std::size_t size, std::uint32_t c) {
    const auto &t = kTables.t;
    for (; size >= 8; p += 8, size -= 8) {
        const std::uint32_t low = c ^ load4(p), high = load4(p + 4);
        c = t[7][low & 255] ^ t[6][low >> 8 & 255] ^ t[5][low >> 16 & 255] ^ t[4][low >> 24] ^ t[3][high & 255] ^
            t[2][high >> 8 & 255] ^ t[1][high >> 16 & 255] ^ t[0][high >> 24];
    }
    for (; size; ++p, --size) c = t[0][(c ^ *p) & 255] ^ (c >> 8);
    return c;
}

#ifdef HIL_CARRYLESS

// x^n modulo the polynomial, as a factor of a reflected product: in the upper half of 64 bits.
constexpr std::uint64_t power(int n) {
    std::uint32_t c = 0x80000000u;  // 1: the highest bit stands for x^0
    for (int i = 0; i < n; ++i) c = times_x(c);
    return std::uint64_t{c} << 32;
}

// 16 bytes are a polynomial of 128 coefficients, the first byte the highest ones. What stands `bits` before other bytes
// counts x^bits as much: (first 8 bytes) x^(bits + 64) + (last 8) x^bits, which modulo the polynomial has 96 coefficients
// and is added to them. A carry-less product of reflected factors comes out times x, so the powers are one lower.
template <int bits>
__attribute__((target("pclmul,sse4.1"))) inline __m128i onto(__m128i at, __m128i later) {
    const __m128i factors = _mm_set_epi64x(static_cast<long long>(power(bits - 1)),
                                           static_cast<long long>(power(bits + 63)));
    return _mm_xor_si128(later, _mm_xor_si128(_mm_clmulepi64_si128(at, factors, 0x00),
                                              _mm_clmulepi64_si128(at, factors, 0x11)));
}

// At least 64 bytes.
__attribute__((target("pclmul,sse4.1"))) std::uint32_t by_products(const std::uint8_t *p, std::size_t size,
                                                                   std::uint32_t c) {
    const auto load = [](const std::uint8_t *at) __attribute__((target("pclmul,sse4.1"))) {
        return _mm_loadu_si128(reinterpret_cast<const __m128i *>(at));
    };
    __m128i a0 = _mm_xor_si128(load(p), _mm_cvtsi32_si128(static_cast<int>(c)));
    __m128i a1 = load(p + 16), a2 = load(p + 32), a3 = load(p + 48);
    for (p += 64, size -= 64; size >= 64; p += 64, size -= 64) {
        a0 = onto<512>(a0, load(p));
        a1 = onto<512>(a1, load(p + 16));
        a2 = onto<512>(a2, load(p + 32));
        a3 = onto<512>(a3, load(p + 48));
    }
    __m128i a = onto<128>(onto<128>(onto<128>(a0, a1), a2), a3);
    for (; size >= 16; p += 16, size -= 16) a = onto<128>(a, load(p));
    std::uint8_t rest[16];
    _mm_storeu_si128(reinterpret_cast<__m128i *>(rest), a);
    return by_tables(p, size, by_tables(rest, 16, 0));
}

bool has_products() {
    static const bool has = frame::best_isa() != frame::Isa::kBase && __builtin_cpu_supports("pclmul") &&
                            __builtin_cpu_supports("sse4.1");
    return has;
}

#endif

}  // namespace

std::uint32_t crc32_by_tables(const std::uint8_t *data, std::size_t size, std::uint32_t before) {
    return ~by_tables(data, size, ~before);
}

std::uint32_t crc32(const std::uint8_t *data, std::size_t size, std::uint32_t before) {
#ifdef HIL_CARRYLESS
    if (size >= 64 && has_products()) return ~by_products(data, size, ~before);
#endif
    return crc32_by_tables(data, size, before);
}

}  // namespace hil::sim
