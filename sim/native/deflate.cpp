#include "deflate.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

namespace hil::sim {
namespace {

constexpr int kHashBits = 13;
constexpr std::size_t kWindow = 32768;
// Shorter matches cost time and, in noise, more bits than they save: with 8 instead of 6 colour, depth and instances
// shrink by 1 to 2 % more, normals by 5 % less.
constexpr std::size_t kShortest = 8, kLongest = 258;
constexpr std::size_t kAhead = 16;  // bytes compared at once, whether they match or not
constexpr int kEnd = 256;       // symbol that ends a block
constexpr int kSkipShift = 5;   // after 2^5 places without a match every second is tried, and so on
constexpr std::size_t kStored = 65535;
constexpr std::size_t kHead = 1024;  // more than a block's code lengths, its end and a last flush can take
constexpr int kAtOnce = 3;           // literals between two flushes: 7 bits that stayed and 3 x 15

struct Symbol {
    std::uint16_t symbol;
    std::uint8_t bits;     // extra
    std::uint16_t base;
};

// Symbol of each length 3 to 258 and of each distance, by RFC 1951, 3.2.5.
struct Tables {
    std::array<Symbol, 259> length{};
    std::array<Symbol, 256> near{};  // distance - 1 below 256
    std::array<Symbol, 256> far{};   // (distance - 1) >> 7
    std::array<Symbol, 29> by_length_code{};
    std::array<Symbol, 30> by_distance_code{};

    constexpr Tables() {
        int first = 3;
        for (int code = 0; code < 28; ++code) {
            const int bits = code < 8 ? 0 : code / 4 - 1;
            by_length_code[code] = {static_cast<std::uint16_t>(257 + code), static_cast<std::uint8_t>(bits), 0};
            for (int i = 0; i < 1 << bits && first + i < 259; ++i) {
                length[first + i] = {static_cast<std::uint16_t>(257 + code), static_cast<std::uint8_t>(bits),
                                     static_cast<std::uint16_t>(first)};
            }
            first += 1 << bits;
        }
        length[258] = {285, 0, 258};
        by_length_code[28] = length[258];
        first = 1;
        for (int code = 0; code < 30; ++code) {
            const int bits = code < 4 ? 0 : code / 2 - 1;
            const Symbol s{static_cast<std::uint16_t>(code), static_cast<std::uint8_t>(bits),
                           static_cast<std::uint16_t>(first)};
            by_distance_code[code] = s;
            for (int i = 0; i < 1 << bits; ++i) {
                const int distance = first + i;
                if (distance <= 256) near[distance - 1] = s;
                else if ((distance - 1) % 128 == 0) far[(distance - 1) >> 7] = s;
            }
            first += 1 << bits;
        }
    }

    const Symbol &of_distance(std::uint32_t distance) const {
        return distance <= 256 ? near[distance - 1] : far[(distance - 1) >> 7];
    }
};

const Tables kTables;

// The next `kShortest` bytes, of eight that there must be.
std::uint64_t load(const std::uint8_t *p) {
    std::uint64_t value = 0;
    if constexpr (std::endian::native == std::endian::little) std::memcpy(&value, p, 8);
    else for (int i = 0; i < 8; ++i) value |= std::uint64_t{p[i]} << (8 * i);
    return value << (64 - 8 * kShortest);
}

std::uint32_t hash_of(std::uint64_t bytes) {
    return static_cast<std::uint32_t>((bytes * 0x9e3779b97f4a7c15u) >> (64 - kHashBits));
}

std::size_t match_length(const std::uint8_t *a, const std::uint8_t *b, std::size_t most) {
    std::size_t n = 0;
    if constexpr (std::endian::native == std::endian::little) {
        while (n + 8 <= most) {
            std::uint64_t x, y;
            std::memcpy(&x, a + n, 8);
            std::memcpy(&y, b + n, 8);
            if (x != y) return n + static_cast<std::size_t>(std::countr_zero(x ^ y)) / 8;
            n += 8;
        }
    }
    while (n < most && a[n] == b[n]) ++n;
    return n;
}

// How many of the first `kAhead` bytes are the same, without a branch.
std::size_t first_bytes(const std::uint8_t *a, const std::uint8_t *b) {
    if constexpr (std::endian::native != std::endian::little) return match_length(a, b, kAhead);
    std::uint64_t x[2], y[2];
    std::memcpy(x, a, 16);
    std::memcpy(y, b, 16);
    const std::uint64_t low = x[0] ^ y[0], high = x[1] ^ y[1];
    const std::uint64_t first = low ? low : high;
    return (low ? 0 : 8) + static_cast<std::size_t>(std::countr_zero(first)) / 8;
}

// Writes bits, the least significant first, to memory that has room for them and for seven bytes more.
class Bits {
public:
    explicit Bits(std::uint8_t *to) : to_(to) {}

    // `count` up to 56 between two flushes.
    void put(std::uint64_t value, int count) {
        held_ |= value << fill_;
        fill_ += count;
    }

    // Bits with their count in the top byte.
    void put(std::uint32_t packed) { put(packed & 0xffffff, static_cast<int>(packed >> 24)); }

    // Whole bytes go to memory; at most seven bits stay.
    void flush() {
        if constexpr (std::endian::native == std::endian::little) std::memcpy(to_, &held_, 8);
        else for (int i = 0; i < 8; ++i) to_[i] = static_cast<std::uint8_t>(held_ >> (8 * i));
        const int whole = fill_ >> 3;
        to_ += whole;
        held_ >>= 8 * whole;
        fill_ &= 7;
    }

    // Where the stream ends, filled up to a whole byte.
    std::uint8_t *end() {
        flush();
        return fill_ ? to_ + 1 : to_;
    }

private:
    std::uint8_t *to_;
    std::uint64_t held_ = 0;
    int fill_ = 0;
};

// A canonical Huffman code of up to 288 symbols.
struct Code {
    std::array<std::uint8_t, 288> length{};
    std::array<std::uint16_t, 288> bits{};  // least significant first, as they are written

    Code(const std::uint32_t *count, int symbols, int longest) {
        struct Node {
            std::uint64_t weight;
            int parent;
        };
        std::array<int, 288> order;
        int used = 0;
        for (int s = 0; s < symbols; ++s)
            if (count[s]) order[used++] = s;
        // At least two codes: some readers refuse a code of one symbol.
        for (int s = 0; used < 2; ++s)
            if (!count[s]) order[used++] = s;
        std::sort(order.begin(), order.begin() + used, [&](int a, int b) {
            return count[a] != count[b] ? count[a] < count[b] : a < b;
        });
        // Two queues: leaves in order of weight, and the nodes made of them, which come out in order too.
        std::array<Node, 576> node;
        for (int i = 0; i < used; ++i) node[i] = {std::max<std::uint64_t>(count[order[i]], 1), -1};
        int leaf = 0, inner = used, made = used;
        const auto lightest = [&] {
            if (leaf < used && (inner >= made || node[leaf].weight <= node[inner].weight)) return leaf++;
            return inner++;
        };
        while (made < 2 * used - 1) {
            const int a = lightest(), b = lightest();
            node[made] = {node[a].weight + node[b].weight, -1};
            node[a].parent = node[b].parent = made++;
        }
        // How many codes of each length, the too long ones cut off; then Kraft's sum brought back to one.
        std::array<int, 576> depth;
        std::array<int, 64> of_length{};
        depth[made - 1] = 0;
        for (int i = made - 2; i >= 0; --i) {
            depth[i] = depth[node[i].parent] + 1;
            if (i < used) ++of_length[std::min(depth[i], longest)];
        }
        std::int64_t sum = 0;
        for (int n = 1; n <= longest; ++n) sum += static_cast<std::int64_t>(of_length[n]) << (longest - n);
        while (sum > std::int64_t{1} << longest) {  // one leaf moves down beside one of the longest
            --of_length[longest];
            int n = longest - 1;
            while (!of_length[n]) --n;
            --of_length[n];
            of_length[n + 1] += 2;
            --sum;
        }
        for (int n = longest, i = 0; n >= 1; --n)
            for (int k = 0; k < of_length[n]; ++k) length[order[i++]] = static_cast<std::uint8_t>(n);
        std::array<int, 17> next{};
        for (int n = 1, code = 0; n <= longest; ++n) next[n] = code = (code + (n > 1 ? of_length[n - 1] : 0)) << 1;
        for (int s = 0; s < symbols; ++s) {
            if (!length[s]) continue;
            int code = next[length[s]]++;
            for (int i = 0; i < length[s]; ++i, code >>= 1)
                bits[s] = static_cast<std::uint16_t>(bits[s] << 1 | (code & 1));
        }
    }

    void put(Bits &to, int symbol) const { to.put(bits[symbol], length[symbol]); }

    std::uint64_t size(const std::uint32_t *count, int symbols) const {
        std::uint64_t sum = 0;
        for (int s = 0; s < symbols; ++s) sum += std::uint64_t{count[s]} * length[s];
        return sum;
    }
};

// Codes with how many bits they have in the top byte, those of lengths with their extra bits.
struct Packed {
    std::array<std::uint32_t, 256> literal;
    std::array<std::uint32_t, kLongest + 1> length;

    explicit Packed(const Code &literals) {
        for (int i = 0; i < 256; ++i) literal[i] = literals.bits[i] | std::uint32_t{literals.length[i]} << 24;
        for (std::size_t n = kShortest; n <= kLongest; ++n) {
            const Symbol &s = kTables.length[n];
            const std::uint32_t bits = literals.length[s.symbol];
            length[n] = literals.bits[s.symbol] | static_cast<std::uint32_t>(n - s.base) << bits | (bits + s.bits) << 24;
        }
    }
};

struct Step {
    std::uint8_t symbol, extra, extra_bits;
};

// Code lengths as runs (RFC 1951, 3.2.7).
int run_lengths(const std::uint8_t *lengths, int count, Step *out) {
    int steps = 0;
    for (int i = 0; i < count;) {
        int run = 1;
        while (i + run < count && lengths[i + run] == lengths[i]) ++run;
        const std::uint8_t value = lengths[i];
        i += run;
        if (value) {
            out[steps++] = {value, 0, 0};
            --run;
        }
        while (run >= 3) {
            const int most = value ? 6 : 138;
            const int n = std::min(run, most);
            if (value) out[steps++] = {16, static_cast<std::uint8_t>(n - 3), 2};
            else if (n <= 10) out[steps++] = {17, static_cast<std::uint8_t>(n - 3), 3};
            else out[steps++] = {18, static_cast<std::uint8_t>(n - 11), 7};
            run -= n;
        }
        while (run-- > 0) out[steps++] = {value, 0, 0};
    }
    return steps;
}

void put_code_lengths(Bits &to, const Code &literals, const Code &distances) {
    int n_literals = 286, n_distances = 30;
    while (n_literals > 257 && !literals.length[n_literals - 1]) --n_literals;
    while (n_distances > 1 && !distances.length[n_distances - 1]) --n_distances;
    std::array<std::uint8_t, 320> lengths;
    std::copy_n(literals.length.begin(), n_literals, lengths.begin());
    std::copy_n(distances.length.begin(), n_distances, lengths.begin() + n_literals);
    std::array<Step, 320> steps;
    const int count = run_lengths(lengths.data(), n_literals + n_distances, steps.data());
    std::uint32_t used[19] = {};
    for (int i = 0; i < count; ++i) ++used[steps[i].symbol];
    const Code code(used, 19, 7);
    constexpr int kOrder[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    int n_codes = 19;
    while (n_codes > 4 && !code.length[kOrder[n_codes - 1]]) --n_codes;
    to.put(static_cast<std::uint64_t>(n_literals - 257), 5);
    to.put(static_cast<std::uint64_t>(n_distances - 1), 5);
    to.put(static_cast<std::uint64_t>(n_codes - 4), 4);
    to.flush();
    for (int i = 0; i < n_codes; ++i) {
        to.put(code.length[kOrder[i]], 3);
        to.flush();
    }
    for (int i = 0; i < count; ++i) {
        code.put(to, steps[i].symbol);
        to.put(steps[i].extra, steps[i].extra_bits);
        to.flush();
    }
}

// Byte by byte each sum waits for the one before; over a block both are sums of products that wait for nothing:
// a' = a + sum d_i, b' = b + n a + sum (n - i) d_i. Whole numbers, so the same in any order.
std::uint32_t adler32(const std::uint8_t *data, std::size_t size) {
    constexpr std::size_t kBlock = 32, kBlocks = 173;  // 5536 bytes: sums stay below 2^32
    std::uint32_t a = 1, b = 0;
    std::size_t i = 0;
    while (i + kBlock <= size) {
        const std::size_t blocks = std::min(kBlocks, (size - i) / kBlock);
        for (std::size_t k = 0; k < blocks; ++k, i += kBlock) {
            std::uint32_t plain = 0, weighted = 0;
            for (std::size_t j = 0; j < kBlock; ++j) {
                const auto value = static_cast<std::int16_t>(data[i + j]);
                plain += static_cast<std::uint32_t>(value);
                weighted += static_cast<std::uint32_t>(value * static_cast<std::int16_t>(kBlock - j));
            }
            b += static_cast<std::uint32_t>(kBlock) * a + weighted;
            a += plain;
        }
        a %= 65521;
        b %= 65521;
    }
    for (; i < size; ++i) {
        a = (a + data[i]) % 65521;
        b = (b + a) % 65521;
    }
    return b << 16 | a;
}

}  // namespace

void Deflater::find_matches(const std::uint8_t *data, std::size_t size) {
    head_.assign(std::size_t{1} << kHashBits, 0);
    const std::size_t most = size / kShortest + 1;
    if (matches_.size() < most) matches_.resize(most);
    Match *match = matches_.data();
    std::fill(std::begin(literal_count_), std::end(literal_count_), 0);
    // Of four counters in turn each has time to be written before it is read again, when one byte comes often.
    std::uint32_t bytes_seen[4][256] = {};
    std::uint32_t length_seen[kLongest + 1] = {};
    std::fill(std::begin(distance_count_), std::end(distance_count_), 0);
    std::size_t at = 0, after = 0, missed = 0;  // `after`: the last match
    const auto count_literals = [&](std::size_t end) {
        for (std::size_t i = after; i < end; ++i) ++bytes_seen[i % 4][data[i]];
    };
    std::uint32_t *const head = head_.data();
    // What was never seen has place 0, which is as good a candidate as any other: bytes are compared anyway.
    while (at + kAhead <= size) {
        std::uint32_t &seen = head[hash_of(load(data + at))];
        const std::size_t before = seen, distance = at - before;
        seen = static_cast<std::uint32_t>(at);
        std::size_t length = first_bytes(data + at, data + before);
        if ((length >= kShortest) & (distance - 1 < kWindow)) {
            if (length == kAhead) {
                length += match_length(data + at + kAhead, data + before + kAhead,
                                       std::min(kLongest, size - at) - kAhead);
            }
            *match++ = {static_cast<std::uint32_t>(at - after), static_cast<std::uint16_t>(length),
                        static_cast<std::uint16_t>(distance)};
            count_literals(at);
            ++length_seen[length];
            ++distance_count_[kTables.of_distance(static_cast<std::uint32_t>(distance)).symbol];
            after = at += length;
            missed = 0;
            if (at + 7 <= size) head[hash_of(load(data + at - 1))] = static_cast<std::uint32_t>(at - 1);
        } else {
            at += 1 + (missed++ >> kSkipShift);
        }
    }
    count_literals(size);
    for (int value = 0; value < 256; ++value)
        for (const auto &counted : bytes_seen) literal_count_[value] += counted[value];
    for (std::size_t length = kShortest; length <= kLongest; ++length)
        literal_count_[kTables.length[length].symbol] += length_seen[length];
    ++literal_count_[kEnd];
    n_matches_ = static_cast<std::size_t>(match - matches_.data());
}

void Deflater::compress(const std::uint8_t *data, std::size_t size, std::vector<std::uint8_t> &out) {
    const std::size_t start = out.size();
    out.push_back(0x78);  // deflate, window of 32 KiB
    out.push_back(0x01);  // no dictionary, the fastest level
    find_matches(data, size);
    const Code literals(literal_count_, 286, 15), distances(distance_count_, 30, 15);
    std::uint64_t bits = literals.size(literal_count_, 286) + distances.size(distance_count_, 30);
    for (const Symbol &of : kTables.by_length_code) bits += std::uint64_t{literal_count_[of.symbol]} * of.bits;
    for (const Symbol &of : kTables.by_distance_code) bits += std::uint64_t{distance_count_[of.symbol]} * of.bits;
    out.resize(start + 2 + kHead + static_cast<std::size_t>(bits / 8));
    Bits to(out.data() + start + 2);
    to.put(1, 1);  // the last block
    to.put(2, 2);  // of codes of its own
    put_code_lengths(to, literals, distances);
    const Packed packed(literals);
    const std::uint8_t *next = data;
    const auto put_literals = [&](const std::uint8_t *end) {
        for (; end - next >= kAtOnce; next += kAtOnce) {
            for (int i = 0; i < kAtOnce; ++i) to.put(packed.literal[next[i]]);
            to.flush();
        }
        for (; next < end; ++next) to.put(packed.literal[*next]);
        to.flush();
    };
    for (const Match *match = matches_.data(), *end = match + n_matches_; match < end; ++match) {
        if (match->literals) put_literals(next + match->literals);
        const Symbol &by_distance = kTables.of_distance(match->distance);
        to.put(packed.length[match->length]);  // with what stayed 7 + 15 + 5 + 15 + 13 bits at most
        distances.put(to, by_distance.symbol);
        to.put(match->distance - by_distance.base, by_distance.bits);
        to.flush();
        next += match->length;
    }
    put_literals(data + size);
    literals.put(to, kEnd);
    out.resize(static_cast<std::size_t>(to.end() - out.data()));
    const std::size_t blocks = size ? (size + kStored - 1) / kStored : 1;
    if (out.size() - start - 2 > size + 5 * blocks) {
        out.resize(start + 2);
        for (std::size_t block = 0, at = 0; block < blocks; ++block) {
            const std::size_t n = std::min(kStored, size - at);
            out.push_back(block + 1 == blocks);
            for (const std::size_t value : {n, ~n}) {
                out.push_back(static_cast<std::uint8_t>(value));
                out.push_back(static_cast<std::uint8_t>(value >> 8));
            }
            out.insert(out.end(), data + at, data + at + n);
            at += n;
        }
    }
    const std::uint32_t check = adler32(data, size);
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(check >> shift));
}

}  // namespace hil::sim
