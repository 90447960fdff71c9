// A subscriber of another maker's DDS (eProsima Fast DDS) for the tests of ROS 2 output.
//
//   listener DOMAIN IDLE_S [--slow_ms N] TOPIC=TYPE[=best_effort] ...
//
// Prints "ready" once every topic has a publisher, and "receiving" at the first message. Ends IDLE_S seconds after the
// last message, or on SIGTERM, and prints for each topic: name, messages, gaps in the sequence numbers of the writer,
// first and last stamp [ns], smallest and largest step between stamps [ns], sum of the CRC-32 of all messages,
// encapsulations other than little-endian CDR.

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

namespace fdds = eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<uint8_t>;
using Clock = std::chrono::steady_clock;

static std::atomic<bool> stopped{false};
static std::atomic<int64_t> newest_ms{0};

static int64_t now_ms() {
    return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now().time_since_epoch()).count();
}

// Type whose messages stay the bytes that came over the wire, with the encapsulation header.
class RawType : public fdds::TopicDataType {
   public:
    explicit RawType(const std::string &name) {
        setName(name.c_str());
        m_typeSize = 64u << 20;
        m_isGetKeyDefined = false;
    }
    bool serialize(void *, SerializedPayload_t *) override { return false; }
    bool deserialize(SerializedPayload_t *payload, void *data) override {
        static_cast<Bytes *>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override {
        return [] { return 0u; };
    }
    void *createData() override { return new Bytes; }
    void deleteData(void *data) override { delete static_cast<Bytes *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

static uint32_t crc32(const Bytes &bytes) {
    static const std::array<uint32_t, 256> table = [] {
        std::array<uint32_t, 256> made{};
        for (uint32_t i = 0; i < 256; i++) {
            uint32_t c = i;
            for (int k = 0; k < 8; k++) c = c & 1 ? 0xEDB88320u ^ (c >> 1) : c >> 1;
            made[i] = c;
        }
        return made;
    }();
    uint32_t crc = 0xFFFFFFFFu;
    for (uint8_t byte : bytes) crc = table[(crc ^ byte) & 0xFF] ^ (crc >> 8);
    return ~crc;
}

class Tally : public fdds::DataReaderListener {
   public:
    std::string name;
    int slow_ms = 0;
    std::atomic<int> publishers{0};
    uint64_t messages = 0, gaps = 0, sum = 0, foreign = 0;
    int64_t sequence = 0, first_ns = 0, last_ns = 0, least_ns = INT64_MAX, most_ns = 0;

    void on_subscription_matched(fdds::DataReader *, const fdds::SubscriptionMatchedStatus &status) override {
        publishers = status.current_count;
    }
    void on_data_available(fdds::DataReader *reader) override {
        Bytes bytes;
        fdds::SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            newest_ms = now_ms();
            const int64_t sequence_now = info.sample_identity.sequence_number().to64long();
            if (messages && sequence_now != sequence + 1) gaps += sequence_now - sequence - 1;
            sequence = sequence_now;
            int32_t seconds;
            uint32_t nanoseconds;
            std::memcpy(&seconds, bytes.data() + 4, 4);
            std::memcpy(&nanoseconds, bytes.data() + 8, 4);
            const int64_t stamp_ns = seconds * 1000000000LL + nanoseconds;
            if (messages == 0) {
                first_ns = stamp_ns;
            } else {
                least_ns = std::min(least_ns, stamp_ns - last_ns);
                most_ns = std::max(most_ns, stamp_ns - last_ns);
            }
            last_ns = stamp_ns;
            foreign += !(bytes[0] == 0 && bytes[1] == 1);
            bytes[3] = 0;  // number of padding bytes, which a writer may state here
            sum += crc32(bytes);
            messages++;
            if (slow_ms) std::this_thread::sleep_for(std::chrono::milliseconds(slow_ms));
        }
    }
};

int main(int argc, char **argv) {
    std::signal(SIGTERM, [](int) { stopped = true; });
    const int domain = std::atoi(argv[1]);
    const double idle_s = std::atof(argv[2]);
    int first = 3, slow_ms = 0;
    if (argc > 4 && std::string(argv[3]) == "--slow_ms") {
        slow_ms = std::atoi(argv[4]);
        first = 5;
    }
    auto *participant = fdds::DomainParticipantFactory::get_instance()->create_participant(domain, fdds::PARTICIPANT_QOS_DEFAULT);
    if (!participant) return 2;
    auto *subscriber = participant->create_subscriber(fdds::SUBSCRIBER_QOS_DEFAULT);
    std::vector<std::unique_ptr<Tally>> tallies;
    std::vector<fdds::DataReader *> readers;
    for (int i = first; i < argc; i++) {
        const std::string text = argv[i];
        const auto equals = text.find('='), second = text.find('=', equals + 1);
        const std::string name = text.substr(0, equals);
        const std::string type_name = text.substr(equals + 1, second == std::string::npos ? second : second - equals - 1);
        fdds::TypeSupport type(new RawType(type_name));
        type.register_type(participant);
        auto *topic = participant->create_topic("rt" + name, type_name, fdds::TOPIC_QOS_DEFAULT);
        fdds::DataReaderQos qos = fdds::DATAREADER_QOS_DEFAULT;
        qos.reliability().kind =
            second == std::string::npos ? fdds::RELIABLE_RELIABILITY_QOS : fdds::BEST_EFFORT_RELIABILITY_QOS;
        qos.history().kind = slow_ms ? fdds::KEEP_ALL_HISTORY_QOS : fdds::KEEP_LAST_HISTORY_QOS;
        qos.history().depth = 10;
        qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        tallies.push_back(std::make_unique<Tally>());
        tallies.back()->name = name;
        tallies.back()->slow_ms = slow_ms;
        readers.push_back(subscriber->create_datareader(topic, qos, tallies.back().get()));
        if (!readers.back()) return 3;
    }
    for (const auto &tally : tallies)
        while (!tally->publishers && !stopped) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::printf("ready\n");
    std::fflush(stdout);
    bool told = false;
    while (!stopped && (!newest_ms || now_ms() - newest_ms < idle_s * 1000)) {
        if (newest_ms && !told) {
            told = true;
            std::printf("receiving\n");
            std::fflush(stdout);
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    for (auto *reader : readers) reader->set_listener(nullptr);
    for (const auto &t : tallies)
        std::printf("%s %llu %llu %lld %lld %lld %lld %llu %llu\n", t->name.c_str(), (unsigned long long)t->messages,
                    (unsigned long long)t->gaps, (long long)t->first_ns, (long long)t->last_ns, (long long)t->least_ns,
                    (long long)t->most_ns, (unsigned long long)t->sum, (unsigned long long)t->foreign);
    std::fflush(stdout);
    std::_Exit(0);
}
