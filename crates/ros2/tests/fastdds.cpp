// The node against Fast DDS, with the names and types of ROS 2, and messages written by hand.
//
//   fastdds drive DOMAIN SECONDS TIMEOUT   as drive.py, with the same answer
//   fastdds services DOMAIN                asks the node's services as rmw_fastrtps does

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/common/WriteParams.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using Bytes = std::vector<char>;

// A type by its name alone: its bytes are read and written where they are needed.
struct Plain : fast::TopicDataType {
    explicit Plain(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 1 << 16;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, rtps::SerializedPayload_t* to) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        std::memcpy(to->data, bytes.data(), bytes.size());
        to->length = bytes.size();
        to->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t* from, void* data) override {
        static_cast<Bytes*>(data)->assign(from->data, from->data + from->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

[[noreturn]] void fail(const std::string& why) {
    std::fprintf(stderr, "%s\n", why.c_str());
    std::exit(1);
}

template <class T> T* there(T* made, const char* what) {
    if (made == nullptr) fail(std::string("Fast DDS makes no ") + what);
    return made;
}

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void rest() { std::this_thread::sleep_for(std::chrono::microseconds(500)); }

enum class Quality { Reliable, Best, Kept };

struct Peer {
    fast::DomainParticipant* participant;
    fast::Publisher* publisher;
    fast::Subscriber* subscriber;
    std::map<std::string, fast::Topic*> topics;

    explicit Peer(int domain) {
        fast::DomainParticipantQos qos;
        // Loopback alone, which has no multicast: peers find each other by the well-known ports.
        auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
        udp->interfaceWhiteList.push_back("127.0.0.1");
        qos.transport().use_builtin_transports = false;
        qos.transport().user_transports.push_back(udp);
        rtps::Locator_t peer;
        rtps::IPLocator::setIPv4(peer, 127, 0, 0, 1);
        qos.wire_protocol().builtin.initialPeersList.push_back(peer);
        auto factory = fast::DomainParticipantFactory::get_instance();
        participant = there(factory->create_participant(domain, qos), "participant");
        publisher = there(participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT), "publisher");
        subscriber = there(participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT), "subscriber");
    }

    fast::Topic* topic(const std::string& name, const std::string& kind) {
        fast::Topic*& known = topics[name];
        if (known == nullptr) {
            fast::TypeSupport type(new Plain(kind));
            type.register_type(participant);
            known = there(participant->create_topic(name, kind, fast::TOPIC_QOS_DEFAULT), "topic");
        }
        return known;
    }

    fast::DataReader* reader(const std::string& name, const std::string& kind, Quality quality = Quality::Reliable) {
        fast::DataReaderQos qos;
        qos.reliability().kind = quality == Quality::Best ? fast::BEST_EFFORT_RELIABILITY_QOS : fast::RELIABLE_RELIABILITY_QOS;
        qos.durability().kind = quality == Quality::Kept ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
        qos.history().kind = fast::KEEP_ALL_HISTORY_QOS;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        return there(subscriber->create_datareader(topic(name, kind), qos), "reader");
    }

    fast::DataWriter* writer(const std::string& name, const std::string& kind) {
        fast::DataWriterQos qos;
        qos.reliability().kind = fast::RELIABLE_RELIABILITY_QOS;
        qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
        qos.history().depth = 10;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        return there(publisher->create_datawriter(topic(name, kind), qos), "writer");
    }
};

// Writes a message: `fill` adds its fields.
template <class Fill> Bytes message(Fill fill) {
    FastBuffer buffer;
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    fill(cdr);
    return Bytes(buffer.getBuffer(), buffer.getBuffer() + cdr.getSerializedDataLength());
}

// Reads the messages that have come: `take` is given each with what is known of it.
template <class Take> void each(fast::DataReader* reader, Take take) {
    Bytes bytes;
    fast::SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
        if (!info.valid_data) continue;
        FastBuffer buffer(bytes.data(), bytes.size());
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        cdr.read_encapsulation();
        take(cdr, info);
    }
}

int64_t stamp(Cdr& cdr) {
    int32_t seconds = 0;
    uint32_t nanoseconds = 0;
    cdr >> seconds >> nanoseconds;
    return int64_t{seconds} * 1000000000 + nanoseconds;
}

std::string text(Cdr& cdr) {
    std::string text;
    cdr >> text;
    return text;
}

std::vector<double> numbers(Cdr& cdr, int count) {
    std::vector<double> numbers(count);
    for (double& one : numbers) cdr >> one;
    return numbers;
}

struct Odometry {
    int64_t stamp;
    double x, y, yaw, forward, turn;
};

Odometry odometry(Cdr& cdr) {
    Odometry one{};
    one.stamp = stamp(cdr);
    if (text(cdr) != "odom" || text(cdr) != "base_link") fail("odometry in other frames");
    auto pose = numbers(cdr, 7 + 36), twist = numbers(cdr, 6 + 36);
    one.x = pose[0], one.y = pose[1], one.yaw = 2 * std::atan2(pose[5], pose[6]);
    one.forward = twist[0], one.turn = twist[5];
    if (pose[2] != 0 || twist[2] != 0 || !(pose[7] > 0) || !(twist[6] > 0)) fail("odometry that is none");
    return one;
}

struct Transform {
    std::string frame, child;
    double x;
};

std::vector<Transform> transforms(Cdr& cdr) {
    uint32_t count = 0;
    cdr >> count;
    std::vector<Transform> all;
    for (uint32_t k = 0; k < count; ++k) {
        stamp(cdr);
        Transform one{text(cdr), text(cdr), 0};
        one.x = numbers(cdr, 7)[0];
        all.push_back(one);
    }
    return all;
}

struct Joints {
    int64_t stamp;
    std::map<std::string, double> rates;
};

Joints joints(Cdr& cdr) {
    Joints one{stamp(cdr), {}};
    text(cdr);
    std::vector<std::string> names;
    std::vector<double> angles, rates;
    cdr >> names >> angles >> rates;
    for (size_t k = 0; k < names.size(); ++k) one.rates[names[k]] = rates.at(k);
    return one;
}

const char* const TWIST = "geometry_msgs::msg::dds_::Twist_";
const char* const ODOMETRY = "nav_msgs::msg::dds_::Odometry_";

int drive(int domain, double seconds, double timeout) {
    Peer peer(domain);
    auto clock = peer.reader("rt/clock", "rosgraph_msgs::msg::dds_::Clock_", Quality::Best);
    auto odom = peer.reader("rt/odom", ODOMETRY);
    auto tf = peer.reader("rt/tf", "tf2_msgs::msg::dds_::TFMessage_");
    auto fixed_tf = peer.reader("rt/tf_static", "tf2_msgs::msg::dds_::TFMessage_", Quality::Kept);
    auto states = peer.reader("rt/joint_states", "sensor_msgs::msg::dds_::JointState_");
    auto command = peer.writer("rt/cmd_vel", TWIST);
    Bytes twist = message([](Cdr& cdr) { cdr << 0.2 << 0.0 << 0.0 << 0.0 << 0.0 << 1.0; });

    std::vector<Odometry> odometries;
    std::vector<Joints> held;
    std::map<std::string, std::string> frames;
    std::vector<Transform> fixed;
    int64_t time = -1, began = -1, stopped = -1, next = 0;
    for (double deadline = now() + seconds + 60;; rest()) {
        if (now() > deadline) fail("timed out with " + std::to_string(odometries.size()) + " odometries");
        each(clock, [&](Cdr& cdr, auto&) { time = stamp(cdr); });
        each(odom, [&](Cdr& cdr, auto&) { odometries.push_back(odometry(cdr)); });
        each(tf, [&](Cdr& cdr, auto&) { for (auto& t : transforms(cdr)) frames[t.child] = t.frame; });
        each(fixed_tf, [&](Cdr& cdr, auto&) { fixed = transforms(cdr); });
        each(states, [&](Cdr& cdr, auto&) { held.push_back(joints(cdr)); });
        // What was said before all had met does not count.
        if (began < 0 && time >= 0 && !odometries.empty() && !held.empty() && !frames.empty() && !fixed.empty()) {
            began = std::max(time, odometries.back().stamp) + 500000000;
            next = time;
        }
        if (began < 0) continue;
        if (stopped < 0 && time >= next) {
            command->write(&twist);
            next += 66666667;
            if (double(time - began) > seconds * 1e9) stopped = time;
        }
        if (stopped >= 0 && double(time - stopped) > (timeout + 1.5) * 1e9) break;
    }

    std::printf("{\"stamps\": [");
    const char* comma = "";
    double spread = 0;
    double center[2] = {NAN, NAN};
    for (const Odometry& one : odometries) {
        if (one.stamp < began || one.stamp > stopped) continue;
        std::printf("%s%lld", comma, (long long)one.stamp);
        comma = ", ";
        if (double(one.stamp) < began + 2e9) continue;
        // The circle's centre is a radius to the left of each pose.
        double x = one.x - 0.2 * std::sin(one.yaw), y = one.y + 0.2 * std::cos(one.yaw);
        if (std::isnan(center[0])) center[0] = x, center[1] = y;
        spread = std::max(spread, std::hypot(x - center[0], y - center[1]));
    }
    std::printf("]");
    for (const char* wheel : {"left", "right"}) {
        double least = INFINITY, most = -INFINITY;
        for (const Joints& one : held) {
            if (double(one.stamp) < began + 2e9 || one.stamp > stopped) continue;
            least = std::min(least, one.rates.at(wheel)), most = std::max(most, one.rates.at(wheel));
        }
        std::printf(", \"%s\": [%.17g, %.17g]", wheel, least, most);
    }
    double still = 0, fell = NAN;
    for (const Joints& one : held) {
        double rate = std::abs(one.rates.at("left")) + std::abs(one.rates.at("right"));
        if (double(one.stamp) > stopped + (timeout + 1) * 1e9) still = std::max(still, rate);
        if (one.stamp > stopped && std::isnan(fell) && rate < 1e-9) fell = double(one.stamp - stopped) / 1e9;
    }
    std::printf(", \"spread\": %.17g, \"still\": %.17g, \"stopped_after\": %.17g, \"frames\": {", spread, still, fell);
    comma = "";
    for (auto& [child, frame] : frames) {
        std::printf("%s\"%s\": \"%s\"", comma, child.c_str(), frame.c_str());
        comma = ", ";
    }
    std::printf("}, \"fixed\": [[\"%s\", \"%s\", %.17g]]}\n", fixed[0].frame.c_str(), fixed[0].child.c_str(), fixed[0].x);
    return 0;
}

// A client of a service, as rmw_fastrtps is one: whose request it was stands beside the answer, not in it.
struct Client {
    fast::DataWriter* ask;
    fast::DataReader* answers;

    Client(Peer& peer, const std::string& name, const std::string& package, const std::string& kind) {
        std::string type = package + "::srv::dds_::" + kind;
        ask = peer.writer("rq/" + name + "Request", type + "_Request_");
        answers = peer.reader("rr/" + name + "Reply", type + "_Response_");
        fast::PublicationMatchedStatus out;
        fast::SubscriptionMatchedStatus in;
        for (double deadline = now() + 30;; rest()) {
            ask->get_publication_matched_status(out);
            answers->get_subscription_matched_status(in);
            // rmw_fastrtps takes a service for there when both sides are, and as many.
            if (out.current_count > 0 && out.current_count == in.current_count) break;
            if (now() > deadline) fail(name + ": no service");
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
    }

    template <class Fill, class Take> void operator()(Fill fill, Take take) {
        Bytes request = message(fill);
        rtps::WriteParams of;
        of.related_sample_identity().writer_guid() = answers->guid();
        if (!ask->write(&request, of)) fail("not asked");
        auto asked = of.sample_identity().sequence_number();
        bool done = false;
        for (double deadline = now() + 20; !done; rest()) {
            if (now() > deadline) fail("no answer");
            each(answers, [&](Cdr& cdr, fast::SampleInfo& info) {
                auto& about = info.related_sample_identity;
                bool mine = about.writer_guid() == answers->guid() || about.writer_guid() == ask->guid();
                if (!mine || about.sequence_number() != asked || done) fail("an answer to another");
                take(cdr);
                done = true;
            });
        }
        // One request, one answer.
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        each(answers, [&](Cdr&, fast::SampleInfo&) { fail("answered twice"); });
    }
};

void demand(bool holds, const char* what) {
    if (!holds) fail(what);
}

int services(int domain) {
    Peer peer(domain);
    auto truth = peer.reader("rt/ground_truth", ODOMETRY);
    Client pause(peer, "appell/pause", "std_srvs", "SetBool"), step(peer, "appell/step", "std_srvs", "Trigger"),
        reset(peer, "appell/reset", "std_srvs", "Empty"), place(peer, "set_pose", "robot_localization", "SetPose"),
        change(peer, "controller_manager/switch_controller", "controller_manager_msgs", "SwitchController");
    auto nothing = [](Cdr& cdr) { cdr << uint8_t{0}; };
    auto ignore = [](Cdr&) {};
    std::string said;
    auto done = [&](bool expected) {
        return [&said, expected](Cdr& cdr) {
            bool success = false;
            cdr >> success >> said;
            demand(success == expected, said.c_str());
        };
    };
    // The latest truth: time, place, speed.
    struct { int64_t stamp = -1; double x = 0, y = 0, speed = 0; } last;
    auto look = [&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
        each(truth, [&](Cdr& cdr, auto&) {
            last.stamp = stamp(cdr), text(cdr), text(cdr);
            auto pose = numbers(cdr, 7 + 36), twist = numbers(cdr, 6);
            last.x = pose[0], last.y = pose[1], last.speed = twist[0];
        });
    };
    auto change_to = [&](std::vector<std::string> on, std::vector<std::string> off, bool expected) {
        change([&](Cdr& cdr) { cdr << on << off << int32_t{2} << true << int32_t{0} << uint32_t{0}; }, done(expected));
    };
    look();
    demand(last.stamp == -1, "it does not rest");
    step(nothing, done(true));
    step(nothing, done(true));
    look();
    demand(last.stamp >= 0 && last.stamp < 50000000, "not stepped");
    pause([](Cdr& cdr) { cdr << false; }, done(true));
    step(nothing, done(false));
    demand(said.find("paused") != std::string::npos, "steps while it goes on");
    // Its own controller drives, and then nobody.
    change_to({"scenario"}, {}, true);
    for (double deadline = now() + 20; last.speed < 0.3; look()) demand(now() < deadline, "the controller does not drive");
    change_to({"nobody"}, {}, false);
    demand(said.find("nobody") != std::string::npos, said.c_str());
    change_to({}, {"scenario"}, true);
    for (double deadline = now() + 20; std::abs(last.speed) > 1e-3; look()) demand(now() < deadline, "it does not stop");
    int64_t before = last.stamp;
    place([](Cdr& cdr) {
        cdr << int32_t{0} << uint32_t{0} << std::string("world") << 1.0 << 3.0;
        for (int k = 0; k < 4; ++k) cdr << 0.0;
        cdr << 1.0;
        for (int k = 0; k < 36; ++k) cdr << 0.0;
    }, ignore);
    look();
    demand(std::abs(last.x - 1) < 1e-3 && std::abs(last.y - 3) < 1e-3 && last.stamp > before, "not put there");
    pause([](Cdr& cdr) { cdr << true; }, done(true));
    reset(nothing, ignore);
    look();
    step(nothing, done(true));
    look();
    demand(last.stamp == 0, "not begun anew");
    std::printf("all asked\n");
    return 0;
}

int main(int count, char** words) {
    if (count == 5 && std::string(words[1]) == "drive") return drive(std::atoi(words[2]), std::atof(words[3]), std::atof(words[4]));
    if (count == 3 && std::string(words[1]) == "services") return services(std::atoi(words[2]));
    fail("drive DOMAIN SECONDS TIMEOUT, or services DOMAIN");
}
