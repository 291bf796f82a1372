// The bus over DDS: one writer or reader per topic of the device, created when the driver starts.
//
// Threads: one per topic. The loop uses the device's topics, the supervisor uses DriverHealth.
#pragma once

#include <tuple>

#include "drivers/frame/device.hpp"
#include "drivers/frame/io.hpp"
#include "idl/dds.hpp"

namespace bregma::driver {

template <class Writes, class Reads> class DdsBus;

template <class... Written, class... Read> class DdsBus<Topics<Written...>, Topics<Read...>> final : public Bus {
public:
  // Throws dds::Error.
  explicit DdsBus(std::uint32_t domain)
      : participant_(domain, dds::Role::kServer),
        writers_(dds::Writer<Written>(participant_)..., dds::Writer<wire::DriverHealth>(participant_)),
        readers_(dds::Reader<Read>(participant_)...) {}

  [[nodiscard]] bool write(std::string_view topic, const void *sample) override {
    bool written = false;
    const auto try_writer = [&]<class T>(const dds::Writer<T> &writer) {
      if (topic == wire::Topic<T>::kName) {
        written = writer.write(*static_cast<const T *>(sample));
      }
    };
    std::apply([&](const auto &...writer) { (try_writer(writer), ...); }, writers_);
    return written;
  }

  void take(std::string_view topic, const std::function<void(const void *)> &visit) override {
    const auto try_reader = [&]<class T>(dds::Reader<T> &reader) {
      if (topic == wire::Topic<T>::kName) {
        reader.take_each([&](const T &sample, const dds::SampleInfo &) { visit(&sample); });
      }
    };
    std::apply([&](auto &...reader) { (try_reader(reader), ...); }, readers_);
  }

  [[nodiscard]] std::uint32_t matched(std::string_view topic) const override {
    std::uint32_t count = 0;
    const auto count_readers = [&]<class T>(const dds::Writer<T> &writer) {
      count += topic == wire::Topic<T>::kName ? writer.matched_readers() : 0;
    };
    const auto count_writers = [&]<class T>(const dds::Reader<T> &reader) {
      count += topic == wire::Topic<T>::kName ? reader.matched_writers() : 0;
    };
    std::apply([&](const auto &...writer) { (count_readers(writer), ...); }, writers_);
    std::apply([&](const auto &...reader) { (count_writers(reader), ...); }, readers_);
    return count;
  }

private:
  dds::Participant participant_;
  std::tuple<dds::Writer<Written>..., dds::Writer<wire::DriverHealth>> writers_;
  std::tuple<dds::Reader<Read>...> readers_;
};

} // namespace bregma::driver
