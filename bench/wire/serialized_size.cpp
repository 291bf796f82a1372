#include "bench/wire/serialized_size.hpp"

#include <chrono>
#include <thread>

#include <dds/ddsi/ddsi_serdata.h>
#include <ddsc/dds.h>

namespace bregma::bench {

std::size_t serialized_size(const dds::Participant &participant, const dds_topic_descriptor_t &descriptor,
                            const void *sample) {
  constexpr const char *kTopic = "SerializedSize";
  const dds::Entity writer = dds::untyped::make_writer(participant, descriptor, kTopic, wire::qos::kState);
  if (!dds::untyped::write(writer, sample)) {
    throw dds::Error("the sample cannot be written");
  }
  const dds::Entity reader = dds::untyped::make_reader(participant, descriptor, kTopic, wire::qos::kState);
  for (int i = 0; i < 100; ++i) {
    ddsi_serdata *data = nullptr;
    dds_sample_info_t info;
    if (dds_takecdr(reader.handle(), &data, 1, &info, DDS_ANY_STATE) == 1) {
      const std::size_t size = ddsi_serdata_size(data);
      ddsi_serdata_unref(data);
      return size;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  throw dds::Error("the sample was not returned");
}

} // namespace bregma::bench
