// What an arm's driver reads from the wire, in memory: a test fills the lists, and the driver takes them.
#pragma once

#include <cstdint>
#include <functional>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/frame/io.hpp"
#include "idl/topics.hpp"

namespace bregma::test {

class ArmWire : public driver::Bus {
public:
  void take(std::string_view topic, const std::function<void(const void *)> &visit) final {
    give(topic, visit, commands);
    give(topic, visit, paths);
    give(topic, visit, permits);
    give(topic, visit, deadmen);
    give(topic, visit, healths);
    give(topic, visit, registrations);
  }
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const final { return 1; }

  std::vector<wire::Command> commands;
  std::vector<wire::RobotPath> paths;
  std::vector<wire::RobotPermit> permits;
  std::vector<wire::RobotDeadman> deadmen;
  std::vector<wire::SystemHealth> healths;
  std::vector<wire::RegistrationState> registrations;

private:
  template <class T>
  static void give(std::string_view topic, const std::function<void(const void *)> &visit, std::vector<T> &from) {
    if (topic == wire::Topic<T>::kName) {
      for (const T &sample : std::exchange(from, {})) {
        visit(&sample);
      }
    }
  }
};

} // namespace bregma::test
