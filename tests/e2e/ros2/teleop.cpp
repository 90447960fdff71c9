// A teleop of another maker's DDS (eProsima Fast DDS): publishes geometry_msgs/Twist on /cmd_vel at 20 Hz.
//
//   teleop DOMAIN UP_S      climbs at 1 m/s for UP_S seconds from the first matched subscription on, then flies ahead

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

namespace fdds = eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

struct Twist {
    double linear[3], angular[3];
};

class TwistType : public fdds::TopicDataType {
   public:
    TwistType() {
        setName("geometry_msgs::msg::dds_::Twist_");
        m_typeSize = 4 + sizeof(Twist);
        m_isGetKeyDefined = false;
    }
    bool serialize(void *data, SerializedPayload_t *payload) override {
        const unsigned char header[4] = {0, 1, 0, 0};
        std::memcpy(payload->data, header, 4);
        std::memcpy(payload->data + 4, data, sizeof(Twist));
        payload->length = 4 + sizeof(Twist);
        return true;
    }
    bool deserialize(SerializedPayload_t *, void *) override { return false; }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override {
        return [] { return uint32_t(4 + sizeof(Twist)); };
    }
    void *createData() override { return new Twist; }
    void deleteData(void *data) override { delete static_cast<Twist *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

int main(int, char **argv) {
    auto *participant = fdds::DomainParticipantFactory::get_instance()->create_participant(
        std::atoi(argv[1]), fdds::PARTICIPANT_QOS_DEFAULT);
    if (!participant) return 2;
    fdds::TypeSupport type(new TwistType);
    type.register_type(participant);
    auto *topic = participant->create_topic("rt/cmd_vel", type.get_type_name(), fdds::TOPIC_QOS_DEFAULT);
    auto *writer = participant->create_publisher(fdds::PUBLISHER_QOS_DEFAULT)
                       ->create_datawriter(topic, fdds::DATAWRITER_QOS_DEFAULT);
    if (!writer) return 3;
    fdds::PublicationMatchedStatus status;
    do {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        writer->get_publication_matched_status(status);
    } while (!status.current_count);
    const int climbing = int(std::atof(argv[2]) * 20);
    for (int i = 0;; i++) {
        Twist twist{};
        twist.linear[i < climbing ? 2 : 0] = 1.0;
        writer->write(&twist);
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
}
